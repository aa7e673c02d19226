"""A claim held against a simulation: one row for each check, its interval, and whether it passes."""

import numpy as np
import pandas as pd

from rattle.compare.thresholds.claim import Claim
from rattle.compare.validation.verdict import RULE, Claimed, Simulated, Tolerances, judge, section_errors
from rattle.scene.errors import InputError

__all__ = ["OUTCOMES", "errors_of", "judged"]

OUTCOMES = {"accurate": "pass", "inaccurate": "fail", "undecided": "undecided", "not predicted": "undecided"}
"""Outcome of a row by its verdict; what the simulation has not seen it cannot decide."""


def errors_of(prediction: Claimed, run: Simulated, claim: Claim) -> pd.DataFrame:
    """Error of every row of a claim with one standard error of it; see `judged`.

    A tolerance in units of the sd is measured too: that an error d of a mean or an sd is within w sd is to say that
    ``d - w sd`` is negative, whose standard error is at most ``se(d) + w se(sd)``.

    Returns
    -------
    DataFrame
        Columns as of `rattle.compare.validation.verdict.section_errors`; ``error`` is absolute, ``unit`` the sd of the
        quantity (1 where it does not vary), ``noise`` one standard error.  Only rows that are judged
        (`rattle.compare.validation.verdict.RULE`).

    Raises
    ------
    InputError
        If not one of the rows is judged.
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
    rows["unit"] = rows["unit"].where(rows["unit"] > rows["still"], 1.0)
    return rows


def judged(errors: pd.DataFrame, z: float) -> pd.DataFrame:
    """Rows from `errors_of` with intervals of `z` standard errors and their ``outcome``: pass, fail or undecided.

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
    >>> [judged(errors_of(predict(r, claim), run, claim), z)["outcome"].tolist() for r in ("saltation", "corrected")]
    [['pass', 'pass'], ['fail', 'pass']]
    """
    rows = errors.assign(noise=z * errors["noise"])
    half = rows["noise"] + rows["rest"]
    rows["low"], rows["high"] = rows["error"] - half, rows["error"] + half
    rows = judge(rows)
    rows["outcome"] = rows["verdict"].map(OUTCOMES)
    return rows
