"""Decides a claim: its errors with their intervals, with more and more paths until all rows are decided.

The sizes of all looks are fixed beforehand, and the intervals have simultaneous coverage over all rows of the claim at
all looks (Bonferroni).  Therefore looks may be skipped depending on earlier ones, and the first decision on a row is
final.  Other claims do not widen them: a verdict does not depend on which tests run beside it.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.special import ndtr

from rattle.compare.study.cells import Sample
from rattle.compare.thresholds.claim import Claim
from rattle.compare.thresholds.prediction import ModelPrediction
from rattle.compare.thresholds.sessions import Thresholds, TimedRun
from rattle.compare.validation.section_errors import Claimed, Simulated, remarks, section_errors
from rattle.compare.validation.verdict import RULE, Tolerances, judge, widest
from rattle.montecarlo.long_run.intervals import half_width
from rattle.scene.errors import InputError

OUTCOMES = {"accurate": "pass", "inaccurate": "fail", "undecided": "undecided", "not predicted": "undecided"}
"""Outcome of a row by its verdict."""


class Decision(NamedTuple):
    """The decision on a claim."""

    table: pd.DataFrame  # its rows, each as of the look that decided it
    runs: tuple[TimedRun, ...]  # the simulation of each look that was taken
    z: float  # half width of the intervals in standard errors


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
        raise InputError("quantities", claim.quantities, f"none of these rows has a verdict; add tau or y1. {RULE}")
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
    >>> from rattle.montecarlo import Sampling, simulate
    >>> from rattle.scene import DAT21, Scene
    >>> claim = read_claim({"scene": Scene.from_gears(DAT21, sigma=0.01), "impacts": 1, "quantities": "y1"}, Path())
    >>> run = simulate(claim.scene, paths=4096, impacts=1, sampling=Sampling(control=True))
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


def choose_next(later: Sequence[int], table: pd.DataFrame) -> int | None:
    """Choose the number of paths of the next look: the first that should decide every row, or the last.

    Returns: None if no look is left, the claim has failed, or no number of paths would decide any row.

    Examples
    --------
    >>> table = pd.DataFrame({"outcome": ["pass", "undecided"], "paths_needed": [float("nan"), 3000.0]})
    >>> choose_next([2048, 4096, 8192], table), choose_next([2048], table), choose_next([], table)
    (4096, 2048, None)
    """
    needed = table.loc[table["outcome"] == "undecided", "paths_needed"].max()  # NaN where there is none
    if not later or (table["outcome"] == "fail").any() or pd.isna(needed):
        return None
    return next((paths for paths in later if paths >= needed), later[-1])


def merge_looks(before: pd.DataFrame, now: pd.DataFrame) -> pd.DataFrame:
    """Combine the rows of two looks: decided rows are kept, undecided ones are taken from the later look."""
    return before.where(before["outcome"] != "undecided", now)


def look_until_decided(
    sizes: Sequence[int | None], look: Callable[[int | None], tuple[pd.DataFrame, TimedRun]]
) -> tuple[pd.DataFrame, tuple[TimedRun, ...]]:
    """The rows, each as of the look that decided it, and the simulation of each look that was taken."""
    table, first = look(sizes[0])
    runs, later = [first], [paths for paths in sizes[1:] if paths is not None]
    while (paths := choose_next(later, table)) is not None:
        now, run = look(paths)
        table, runs = merge_looks(table, now), [*runs, run]
        later = [size for size in later if size > paths]
    return table, tuple(runs)


def decide(prediction: ModelPrediction, claim: Claim, session: Thresholds) -> Decision:
    """Compare a prediction with the simulation, with more paths while the claim is undecided."""
    settings = session.settings
    # an accuracy determines the number of paths itself
    sizes = settings.sizes(claim.paths, claim.budget) if claim.accuracy is None else (None,)
    z = widest(len(claim.rows) * len(sizes), settings.false_alarm)

    def look(paths: int | None) -> tuple[pd.DataFrame, TimedRun]:
        run = session.simulate(
            Sample(claim.scene, claim.impacts[-1], settings.seed, claim.scheme, paths, claim.accuracy)
        )
        return judge_errors(errors_of(prediction, run.run, claim), z), run

    return Decision(*look_until_decided(sizes, look), z)
