"""Compares a claim with a simulation: one row for each check, with its interval and outcome."""

import numpy as np
import pandas as pd
from scipy.special import ndtr

from rattle.compare.thresholds.claim import Claim
from rattle.compare.validation.section_errors import Claimed, Simulated, remarks, section_errors
from rattle.compare.validation.verdict import RULE, Tolerances, judge
from rattle.montecarlo.long_run.intervals import half_width
from rattle.scene.errors import InputError

OUTCOMES = {"accurate": "pass", "inaccurate": "fail", "undecided": "undecided", "not predicted": "undecided"}
"""Outcome of a row by its verdict."""


def errors_of(prediction: Claimed, run: Simulated, claim: Claim) -> pd.DataFrame:
    """Compute the error of every row of a claim with one standard error; see `judge_errors`.

    A tolerance in units of the sd has a sampling error as well: an error d is within w sds if ``d - w sd`` is negative,
    and the standard error of this difference is at most ``se(d) + w se(sd)``.

    Returns: Columns as of `rattle.compare.validation.section_errors`; ``error`` is absolute, ``unit`` the
    sd of the quantity (1 if it does not vary), ``noise`` one standard error.  Without rows that are not judged
    (`rattle.compare.validation.verdict.RULE`).
    """
    table = section_errors(prediction, run, 1.0, Tolerances(0.0, 0.0, 0.0))
    places = pd.MultiIndex.from_frame(table[["moment", "quantity", "impact"]])
    rows = table.iloc[places.get_indexer(pd.MultiIndex.from_tuples(claim.rows))].reset_index(drop=True)
    rows = rows[rows["judged"]].reset_index(drop=True)
    if rows.empty:
        raise InputError("quantities", claim.quantities, f"not one row of them is judged; add tau or y1. {RULE}")
    error = rows["moment"].map({m: a.error for m, a in claim.allowed.items()}).astype(float)
    in_sd = rows["moment"].map({m: a.in_sd for m, a in claim.allowed.items()}).astype(bool)
    rows["noise"] += np.where(in_sd, error * rows["se_unit"], 0.0)
    rows["tolerance"] = np.where(in_sd, np.maximum(error * rows["unit"], rows["still"]), error)
    rows["unit"] = rows["unit"].where(rows["still"] == 0.0, 1.0)
    rows["still"] = rows["still"].where(in_sd, 0.0)
    return rows


def judge_errors(errors: pd.DataFrame, z: float) -> pd.DataFrame:
    """Add intervals and outcomes to the errors of a claim.

    Returns: With ``low, high`` (interval of the error), ``verdict`` and ``outcome`` (``pass, fail`` or
    ``undecided``).

    Examples
    --------
    >>> from pathlib import Path
    >>> from rattle.compare.validation.verdict import widest
    >>> from rattle.compare.thresholds.claim import read_claim
    >>> from rattle.compare.thresholds.prediction import predict
    >>> from rattle.montecarlo import simulate
    >>> from rattle.scene import DAT21, Scene
    >>> claim = read_claim({"scene": Scene.from_gears(DAT21, sigma=0.01), "impacts": 1, "quantities": "y1"}, Path())
    >>> run = simulate(claim.scene, paths=4096, impacts=1, scheme="exact-flight", control=True)
    >>> z = widest(len(claim.rows), 0.01)
    >>> both = ("saltation", "corrected")
    >>> [judge_errors(errors_of(predict(r, claim), run, claim), z)["outcome"].tolist() for r in both]
    [['pass', 'pass'], ['fail', 'pass']]
    """
    rows = errors.assign(noise=z * errors["noise"])
    student = half_width(rows["paths"], float(ndtr(-z))) * errors["noise"]
    half = student + rows["rest"]
    lean = student * rows["lean"] * (2.0 * z**2 + 1.0) / (6.0 * z)
    rows["low"] = rows["error"] - half - lean.clip(lower=0.0) - rows["unseen_low"]
    rows["high"] = rows["error"] + half - lean.clip(upper=0.0) + rows["unseen_high"]
    rows = judge(rows)
    rows["remark"] = remarks(rows)
    rows["outcome"] = rows["verdict"].map(OUTCOMES)
    return rows
