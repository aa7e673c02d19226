"""Errors of a closure's section moments, with their intervals, and the three-way verdict."""

from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.special import ndtri

from closure import MeanMap
from montecarlo import Ensemble
from scene.moments import SECTION, STATE

__all__ = ["ABSOLUTE", "VERDICTS", "Tolerances", "judge", "section_errors", "widest"]

VERDICTS = ("accurate", "inaccurate", "undecided", "not predicted")

ABSOLUTE = 1e-6
"""Tolerance where a quantity does not vary: the displacement at the mesh that every path strikes, say."""


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


def judge(table: pd.DataFrame) -> pd.DataFrame:
    """Add ``verdict`` and ``paths_needed`` to rows that have ``error, low, high, tolerance, noise, paths``.

    ``accurate``: the whole interval of the error lies within the tolerance; ``inaccurate``: all of it outside;
    ``undecided``: neither.  ``noise`` is the part of the interval's half width that more paths would shrink;
    ``paths_needed`` is the number that would decide, NaN where only a smaller step can.
    """
    out = table.copy()
    tolerance = out["tolerance"]
    inside = (out["low"] >= -tolerance) & (out["high"] <= tolerance)
    outside = (out["low"] > tolerance) | (out["high"] < -tolerance)
    absent = out["closure"].isna() | out["low"].isna()
    out["verdict"] = np.select([absent, inside, outside], ["not predicted", "accurate", "inaccurate"], "undecided")
    margin = (out["error"].abs() - tolerance).abs() - (0.5 * (out["high"] - out["low"]) - out["noise"])
    with np.errstate(invalid="ignore", divide="ignore"):
        needed = out["paths"] * (out["noise"] / margin) ** 2
    undecided = out["verdict"] == "undecided"
    out["paths_needed"] = np.where(undecided & (margin > 0.0), np.ceil(needed), np.nan)
    return out


def section_errors(closure: MeanMap, run: Ensemble, z: float, tolerances: Tolerances) -> pd.DataFrame:
    """One row per impact, quantity and moment: closure against Monte Carlo at each path's own impact; tidy.

    ``monte_carlo`` is the simulated value with its sampling error ``se`` and the measured step ``bias``; ``error`` is
    the closure minus the bias-corrected value; ``low`` and ``high`` bound it by `z` standard errors of the corrected
    value and what the correction may have left.  ``unit`` is the sd of the quantity.
    """
    steps = {key: group.set_index("impact") for key, group in run.step_bias.groupby(["moment", "quantity"])}
    agreement = run.agreement[closure.reading]
    parts = []
    for moment, prefix, share in (("mean", "", tolerances.mean), ("sd", "sd_", tolerances.sd)):
        for quantity in SECTION:
            if run.scene.stages == 1 and quantity in STATE[2:]:
                continue
            step = steps[moment, quantity]
            corrected_sd = steps["sd", quantity]["corrected"]
            unit = corrected_sd.where(corrected_sd > 0.0, run.section["sd_" + quantity])
            name = prefix + quantity
            part = pd.DataFrame(
                {
                    "reading": closure.reading,
                    "kind": "section",
                    "impact": run.section.index,
                    "quantity": quantity,
                    "moment": moment,
                    "closure": closure.section[name],
                    "monte_carlo": run.section[name],
                    "se": run.section["se_" + name],
                    "bias": step["bias"],
                    "error": closure.section[name] - step["corrected"],
                    "noise": z * step["se_corrected"],
                    "rest": step["rest"],
                    "unit": unit,
                    "tolerance": np.maximum(share * unit, ABSOLUTE),
                    "agreement": agreement,
                    "paths": run.section["paths"],
                }
            )
            parts.append(part)
    table = pd.concat(parts, ignore_index=True)
    half = table["noise"] + table["rest"]
    table["low"], table["high"] = table["error"] - half, table["error"] + half
    return judge(table)
