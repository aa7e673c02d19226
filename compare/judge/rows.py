"""The heart of every comparison: predicted moments against rows of a reference, with intervals and
verdicts.

A reference is a table with a row for each moment: a label (an impact, a time, a dose), a quantity
and a moment, its simulated value, and what is known of the error of that value.  Whoever simulated,
this project or somebody else, the rows are judged by the same rules.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtr

from rattle.compare.judge.verdict import JUDGED, Tolerances, Verdict, judge
from rattle.montecarlo.diagnostics.unseen_text import unseen_text
from rattle.montecarlo.statistics.intervals import ABSOLUTE, FEWEST_FOR_SD, half_width
from rattle.scene.table_entries import pick

PREFIX = {"mean": "", "sd": "sd_", "skew": "skew_", "kurt": "kurt_", "rho": ""}
"""What stands before a quantity in the name of the column of each moment; a correlation is named as
it is."""


def split_column(name: str) -> tuple[str, str]:
    """The moment that a column has, and the rest of its name: the quantity, of a correlation
    both."""
    for moment in ("sd", "skew", "kurt", "rho"):
        if name.startswith(f"{moment}_"):
            return moment, name.removeprefix(f"{moment}_")
    return "mean", name


WORTH_A_WORD = 0.05
"""Share of a tolerance from which on what a branch could change is told."""

TOO_FEW_FOR_INTERVAL = f"too few paths for an interval; that of an sd needs {FEWEST_FOR_SD}"
"""Remark on a row whose interval the sample cannot have."""

BY_STEP = (
    "more paths do not decide it: what the step changes is not known better; take a shorter step"
)
"""Remark where the bias of the step is not known to the tolerance."""
BY_SIZE = f"sd is 0, or too small for doubles: compared with {ABSOLUTE:g} of the quantity's size"
"""Remark on the rows of such quantities."""


class Claimed(Protocol):
    """Moments that a closure or a user's own model predicts, in the columns of
    `rattle.closure.MeanMap.section`."""

    @property
    def closure(self) -> str:
        """Its name; a run may have the agreement with its itinerary under this name."""

    @property
    def section(self) -> pd.DataFrame:
        """A row for each label, such as an impact; NaN where a moment is not predicted."""


class NamedSection(NamedTuple):
    """Moments under a name, to be judged as those of a closure are."""

    closure: str
    section: pd.DataFrame


def compare_rows(
    predictions: Sequence[Claimed], reference: pd.DataFrame, tolerances: Tolerances, label: str
) -> pd.DataFrame:
    """The rows of a reference for each prediction, with its error, before they are judged.

    `reference`: A row for each moment.  ``simulated`` with its standard error ``se`` and the
    measured step ``bias``; ``corrected``, the value without that bias, its standard error ``noise``
    (NaN where an interval cannot be had) and ``rest``, which bounds the bias that is left;
    ``unit``, the sd of the quantity, and ``still``, the tolerance of what does not vary, 0 where it
    varies; ``judged``, ``agreement``, ``paths``, ``lean``, ``unseen_low``, ``unseen_high``,
    ``unseen_share``, ``unseen_paths`` as `rattle.compare.validation.errors.section_errors` has
    them. `label`: Its column that names the rows of the predictions.
    """
    of_moment = reference["moment"].map(tolerances._asdict())
    rows = reference.assign(
        tolerance=np.maximum(of_moment * reference["unit"], reference["still"]).astype(float)
    )
    column = reference["moment"].map(PREFIX) + reference["quantity"]  # of the predictions
    parts = [
        rows.assign(
            closure=prediction.closure,
            predicted=pick(prediction.section, reference[label], column),
        )
        for prediction in predictions
    ]
    table = pd.concat(parts, ignore_index=True)
    return table.assign(error=table["predicted"] - table["corrected"])


def judge_errors(table: pd.DataFrame, z: float) -> pd.DataFrame:
    """Give each row of `compare_rows` its interval of `z` standard errors, its verdict, and a
    remark where it has none.

    Student's t stands in place of the normal distribution, of as many paths as the error rests on
    (``effective_paths`` where the table has it, else ``paths``).
    """
    rows = table.assign(noise=z * table["noise"])
    counted = table.get("effective_paths", table["paths"])
    student = half_width(counted, float(ndtr(-z))) * table["noise"]
    half = student + rows["rest"]
    # Hall's correction, see `rattle.montecarlo.diagnostics.accuracy.skewness_gains`
    lean = student * rows["lean"] * (2.0 * z**2 + 1.0) / (6.0 * z)
    rows["low"] = rows["error"] - half - lean.clip(lower=0.0) - rows["unseen_low"]
    rows["high"] = rows["error"] + half - lean.clip(upper=0.0) + rows["unseen_high"]
    rows = judge(rows)
    rows["remark"] = rows["remark"].where(rows["remark"] != "", remarks(rows))
    return rows


def remarks(table: pd.DataFrame) -> NDArray[Any]:
    """What decides a row besides its sd, in words: the size of what does not vary, and what the
    sample has not seen."""
    undecided = table["verdict"] == Verdict.UNDECIDED
    by_size = (table["still"] > 0.0) & table["verdict"].isin(JUDGED)
    few = table["low"].isna() & undecided
    by_step = (table["rest"] >= table["tolerance"]) & undecided
    texts = np.select([few, by_size, by_step], [TOO_FEW_FOR_INTERVAL, BY_SIZE, BY_STEP], "")
    out = texts.astype(object)
    waits = waits_for_branch(table)
    if waits.any():
        rows = table[waits].assign(change=largest_unseen(table) / table["unit"])
        told = rows[["moment", "unseen_share", "change", "unseen_paths"]]
        out[waits] = [unseen_text(*row) for row in told.itertuples(index=False)]
    return out


def largest_unseen(table: pd.DataFrame) -> "pd.Series[float]":
    """How far branches that the sample cannot have seen widen an interval, on the wider side."""
    return table[["unseen_low", "unseen_high"]].max(axis=1)


def waits_for_branch(table: pd.DataFrame) -> "pd.Series[bool]":
    """Whether a row is undecided for a rare branch that the sample cannot have seen."""
    open_row = (table["verdict"] == Verdict.UNDECIDED) & table["low"].notna()
    return open_row & (largest_unseen(table) > WORTH_A_WORD * table["tolerance"])
