"""Assertions that the checks share."""

import numpy as np

from rattle.scene import section_names

FAINTEST = 1e-289  # smallest power of an sd that can be a divisor
SLACK = 1e-9  # relative rounding error of a correlation and of an eigenvalue
JUDGED = ["accurate", "inaccurate", "undecided"]


def refused(error, name):
    """An error of ours that names what it is about."""
    must(str(error) and name in str(error), repr(error), "does not name", repr(name))
    must(len(str(error)) <= 2000, "a message of", len(str(error)), "characters")
    return "refused", getattr(error, "field", type(error).__name__)


def must(holds, *what):
    """An invariant; what it is about goes into the message."""
    if not np.all(holds):
        raise AssertionError(" ".join(map(str, what)))


def own(scene):
    """The section quantities that a scene has."""
    return list(section_names(scene.stages))


def semidefinite(covariance, scales=None):
    """No eigenvalue is negative but for rounding."""
    for k, matrix in enumerate(covariance):
        must(np.isfinite(matrix), "covariance is not finite")
        scale = np.sqrt(np.abs(np.diagonal(matrix))) if scales is None else scales[k]
        scale = np.where(scale > 0.0, scale, 1.0)
        # as correlations: a small stage counts as much as a large one
        shape = matrix / scale / scale[:, None]
        must(np.linalg.eigvalsh(shape)[0] >= -SLACK, "covariance is not semidefinite")


def has_verdicts(table):
    """Every row of a comparison has a verdict; where it says more than that there is nothing to
    say, numbers do too."""
    must(table["verdict"].isin([*JUDGED, "not predicted", "excluded"]), table["verdict"].unique())
    judged = table[table["verdict"].isin(JUDGED)]
    numbers = judged[["predicted", "simulated", "error", "tolerance", "agreement"]]
    must(np.isfinite(numbers.to_numpy(float)), "judged without a number")
    told = judged[~judged["remark"].str.contains("too few paths for an interval")]
    ordered = (told["low"] <= told["high"]) & (told["se"] >= 0.0)
    must(ordered & np.isfinite(told["high"] - told["low"]), "interval")
    known = table[["predicted", "low"]].notna().all(axis=1)
    must(~(known & (table["verdict"] == "not predicted")), "predicted, and not judged")
