"""Errors of a closure's section moments, with their intervals, and the three-way verdict."""

from typing import Any, NamedTuple, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtri

from rattle.scene.scene import Scene

__all__ = [
    "ABSOLUTE", "JUDGED", "NOT_JUDGED", "RULE", "VERDICTS", "Claimed", "Simulated", "Tolerances", "at_wall", "judge",
    "section_errors", "to_absolute_time", "widest",
]  # fmt: skip

JUDGED = ("accurate", "inaccurate", "undecided")
"""Verdicts on what is judged and predicted: all that counts and sentences speak of."""

NOT_JUDGED = "not judged"
VERDICTS = (*JUDGED, "not predicted", NOT_JUDGED)

RULE = (
    "At each impact the displacement at the mesh that most simulated paths strike is not judged, in any table, count "
    "or sentence: there it is the wall itself, known beforehand, and its spread says only how many paths have left the "
    "itinerary (with a random tolerance, what was drawn besides)."
)
"""What `at_wall` leaves out, and why, as pages state it."""

SIDES = ("predicted", "simulated")

ABSOLUTE = 1e-6
"""Tolerance where a quantity does not vary (the displacement at the mesh that every path strikes, say), in its size."""


class Tolerances(NamedTuple):
    """What counts as accurate: errors of means and of sds in units of the quantity's sd, errors of rho as they are."""

    mean: float = 0.05
    sd: float = 0.10
    rho: float = 0.05


def widest(checks: int, family_error: float = 0.05) -> float:
    """Number of standard errors at which `checks` two-sided intervals all hold with the stated family error.

    Bonferroni.

    Examples
    --------
    >>> round(widest(1), 2), round(widest(100), 2)
    (1.96, 3.48)
    """
    return float(-ndtri(0.5 * family_error / max(checks, 1)))


def at_wall(quantity: Any, mesh: Any) -> Any:
    """Whether a quantity is the displacement at the mesh that is struck, see `RULE`; either may be an array.

    Examples
    --------
    >>> at_wall(np.array(["x1", "x2", "y1"]), np.array([1, 1, 1])).tolist()
    [True, False, False]
    """
    return ((quantity == "x1") & (mesh == 1)) | ((quantity == "x2") & (mesh == 2))


def judge(table: pd.DataFrame) -> pd.DataFrame:
    """Add ``verdict`` and ``paths_needed`` to rows that have ``error, low, high, tolerance, noise, paths``.

    ``accurate``: the whole interval of the error lies within the tolerance; ``inaccurate``: all of it outside;
    ``undecided``: neither; ``not judged``: where the rows have a column ``judged`` that says so.  ``noise`` is the part
    of the interval's half width that more paths would shrink; ``paths_needed`` is the number that would decide, NaN
    where only a smaller step can.
    """
    out = table.copy()
    numbers = ["predicted", "error", "low", "high", "noise", "tolerance"]
    out[numbers] = out[numbers].astype(float)  # a part without rows has columns of no type
    tolerance = out["tolerance"]
    inside = (out["low"] >= -tolerance) & (out["high"] <= tolerance)
    outside = (out["low"] > tolerance) | (out["high"] < -tolerance)
    absent = out["predicted"].isna() | out["low"].isna()
    spared = ~out["judged"].astype(bool) if "judged" in out else np.zeros(len(out), bool)
    out["verdict"] = np.select(
        [spared, absent, inside, outside], [NOT_JUDGED, "not predicted", "accurate", "inaccurate"], "undecided"
    )
    margin = (out["error"].abs() - tolerance).abs() - (0.5 * (out["high"] - out["low"]) - out["noise"])
    with np.errstate(invalid="ignore", divide="ignore"):
        needed = out["paths"] * (out["noise"] / margin) ** 2
    undecided = out["verdict"] == "undecided"
    out["paths_needed"] = np.where(undecided & (margin > 0.0), np.ceil(needed), np.nan)
    return out


class Claimed(Protocol):
    """Section moments that somebody claims, in the columns of `closure.MeanMap.section`; what is missing is NaN."""

    @property
    def closure(self) -> str:
        """Name, under which a run may have counted its itinerary."""
        ...

    @property
    def section(self) -> pd.DataFrame:
        """Index ``impact``."""
        ...


class Simulated(Protocol):
    """Section moments of a simulation: an `montecarlo.Ensemble`, or what has been stored of one."""

    @property
    def section(self) -> pd.DataFrame:
        """As `Ensemble.section`."""
        ...

    @property
    def step_bias(self) -> pd.DataFrame:
        """As `Ensemble.step_bias`."""
        ...

    @property
    def agreement(self) -> pd.DataFrame:
        """As `Ensemble.agreement`."""
        ...


def section_errors(prediction: Claimed, run: Simulated, z: float, tolerances: Tolerances) -> pd.DataFrame:
    """One row per impact, quantity and moment: closure against Monte Carlo at each path's own impact; tidy.

    ``simulated`` is the simulated value with its sampling error ``se`` and the measured step ``bias``; ``error`` is
    the closure minus the bias-corrected value; ``low`` and ``high`` bound it by `z` standard errors of the corrected
    value and what the correction may have left.  ``unit`` is the sd of the quantity, ``se_unit`` its standard error;
    ``still`` is the sd from which a quantity varies: `ABSOLUTE` of its largest value over the impacts (of a flight, for
    times); ``agreement`` speaks of the closure's itinerary where the run has counted it, else of the noise-free one.
    ``judged`` is False where `RULE` says so.
    """
    section, steps = run.section, run.step_bias
    impact, quantity, is_mean = steps["impact"], steps["quantity"], steps["moment"] == "mean"
    name = quantity.where(is_mean, "sd_" + quantity)
    sd = steps[~is_mean].set_index(["impact", "quantity"])
    own = sd.loc[pd.MultiIndex.from_arrays([impact, quantity])].reset_index(drop=True)
    unit = own["corrected"].where(own["corrected"] > 0.0, _picked(section, impact, "sd_" + quantity))
    agreement = run.agreement.get(prediction.closure, section["agreement"])
    predicted = _picked(prediction.section, impact, name)
    sizes = {q: float(np.hypot(section[q], section["sd_" + q]).max()) for q in quantity.unique() if q != "tau"}
    still = ABSOLUTE * quantity.map(sizes | {"tau": sizes["flight"]}).astype(float).fillna(0.0)
    table = pd.DataFrame(
        {
            "closure": prediction.closure,
            "kind": "section",
            "impact": impact,
            "quantity": quantity,
            "moment": steps["moment"],
            "predicted": predicted,
            "simulated": _picked(section, impact, name),
            "se": _picked(section, impact, "se_" + name),
            "bias": steps["bias"],
            "error": predicted - steps["corrected"],
            "noise": z * steps["se_corrected"],
            "rest": steps["rest"],
            "unit": unit,
            "se_unit": own["se_corrected"],
            "tolerance": np.maximum(np.where(is_mean, tolerances.mean, tolerances.sd) * unit, still),
            "still": still,
            "judged": ~at_wall(quantity, section["mesh"].loc[impact].to_numpy()),
            "agreement": agreement.loc[impact].to_numpy(),
            "paths": section["paths"].loc[impact].to_numpy(),
        }
    )
    half = table["noise"] + table["rest"]
    table["low"], table["high"] = table["error"] - half, table["error"] + half
    return judge(table)


def to_absolute_time(table: pd.DataFrame, scene: Scene) -> pd.DataFrame:
    """Errors that were found near the start's phase (`Scene.near`), with their times as the scene states them.

    Errors, intervals and verdicts are what they are: only what is read as a time has the start's own added back.
    """
    late = (table["quantity"] == "tau") & (table["moment"] == "mean")
    columns = {name: np.where(late, scene.to_absolute_time(table[name].to_numpy(float)), table[name]) for name in SIDES}
    if "time" in table:
        columns["time"] = scene.to_absolute_time(table["time"].to_numpy(float))
    return table.assign(**columns)


def _picked(table: pd.DataFrame, impact: pd.Series, column: pd.Series) -> NDArray[np.float64]:
    """Entries of a table by row and column; NaN where it has none."""
    names = list(dict.fromkeys(column))
    values = table.reindex(index=range(1, int(impact.max()) + 1), columns=names).to_numpy(float)
    return np.asarray(values[impact.to_numpy() - 1, pd.Index(names).get_indexer(column)])
