"""The fixture for samples of one's own: judges predictions, and fails or skips the test that does
not pass.  It needs no scene and loads no compiler."""

from collections.abc import Mapping
from typing import Any, NoReturn

import pandas as pd
import pytest

from rattle.compare.judge.judge import judge
from rattle.compare.judge.result import Judgement
from rattle.compare.judge.verdict import Tolerances, Verdict
from rattle.scene.errors import RattleError, check_keys, choice, positive
from rattle.scene.text import harmless

JUDGED_OPTIONS = ("within", "undecided")
"""Options of the marker that a test without a scene may have."""

MOST_ROWS_SHOWN = 40
TABLE_COLUMNS = (
    ("predicted", "predicted", "{:.7g}"),
    ("sampled", "simulated", "{:.7g}"),
    ("error/sd", "error", "{:+.4g}"),
    ("low", "low", "{:+.4g}"),
    ("high", "high", "{:+.4g}"),
    ("allowed", "tolerance", "{:.4g}"),
    ("paths", "paths", "{:,.0f}"),
)
"""Columns of a message: head, column of the verdicts, and how its numbers are written."""


def fail(text: str) -> NoReturn:
    """Fail the test."""
    pytest.fail(harmless(f"rattle: {text}"), pytrace=False)


class Judge:
    """The value of the fixture ``judge``."""

    def __init__(self, item: pytest.Item, rate: float, undecided: str) -> None:
        self._item = item
        self._rate = rate
        self._undecided = undecided

    def __call__(self, predicted: Any, samples: Any, **options: Any) -> Judgement:
        """Judge predictions as `rattle.judge` does, with the session's rate of false alarms.

        The test fails if a moment is inaccurate.  One that stays undecided fails too, unless the
        marker's ``undecided`` or ``--rattle-undecided`` is ``skip``.

        `options`: Those of `rattle.judge`; ``tolerances`` take the place of the marker's
        ``within``.
        """
        try:
            marked = self._read_markers()
            limits = options.pop("tolerances", None) or _tolerances(marked.get("within"))
            undecided = choice(
                "undecided", marked.get("undecided", self._undecided), ("fail", "skip")
            )
            level = options.pop("level", 1.0 - self._rate)
            judgement = judge(predicted, samples, tolerances=limits, level=level, **options)
        except RattleError as error:
            refusal = str(error)
        else:
            self._decide(judgement, undecided)
            return judgement
        fail(refusal)

    def _read_markers(self) -> dict[str, Any]:
        """The options of the markers; a nearer one refines that of the class or module."""
        options: dict[str, Any] = {}
        for mark in reversed(list(self._item.iter_markers("rattle"))):
            options |= mark.kwargs
        check_keys("option of the marker rattle", options, JUDGED_OPTIONS)
        return options

    def _decide(self, found: Judgement, undecided: str) -> None:
        """Record the verdicts, and fail or skip the test that they do not pass."""
        table = found.table
        wrong = table[table["verdict"] == Verdict.INACCURATE]
        open_rows = table[table["verdict"] == Verdict.UNDECIDED]
        judged = int(found.counts.to_numpy().sum())
        facts = {
            "kind": "judge",
            "rows": judged,
            "failed": len(wrong),
            "undecided": len(open_rows),
            "rate": 1.0 - found.level,
            "z": found.z,
        }
        self._item.user_properties.append(("rattle", facts))
        if judged == 0:
            fail("nothing was judged: predictions and samples have no moment in common")
        if len(wrong):
            head = f"{len(wrong)} of {judged} moments are inaccurate"
            fail(f"{head}\n{_describe(found, wrong)}")
        if len(open_rows):
            head = f"{len(open_rows)} of {judged} moments are undecided"
            text = f"{head}\n{_describe(found, open_rows)}"
            if undecided == "skip":
                pytest.skip(harmless(f"rattle: {text}"))
            fail(
                f"{text}\nUndecided is not passed: give more paths, allow a larger error (within),"
                ' or accept that it is undecided (undecided="skip" in its marker, or'
                " --rattle-undecided=skip)."
            )


def _tolerances(within: Any) -> Tolerances:
    """What counts as accurate, from the marker: one number for means and sds, or one for each
    moment."""
    if within is None:
        return Tolerances()
    of_moments = within if isinstance(within, Mapping) else {"mean": within, "sd": within}
    check_keys("moment of within", of_moments, Tolerances._fields)
    for moment, error in of_moments.items():
        positive(f"within of the {moment}", error)
    return Tolerances()._replace(**of_moments)


def _describe(found: Judgement, rows: pd.DataFrame) -> str:
    """Rows with their errors and intervals, in units of the quantity, and their remarks."""
    share = (rows["error"] / rows["tolerance"]).abs().sort_values(ascending=False)
    shown = rows.loc[share.index[:MOST_ROWS_SHOWN]]
    in_sds = ["error", "low", "high", "tolerance"]
    values = shown.assign(**shown[in_sds].div(shown["unit"], axis=0))
    table = pd.DataFrame({head: values[n].map(form.format) for head, n, form in TABLE_COLUMNS})
    table.index = pd.Index(
        [
            f"{row['closure']}: {row['moment']} {row['quantity']} at {row[found.label]}"
            for row in shown.to_dict("records")
        ]
    )
    remarks = "".join(f"{remark}\n" for remark in dict.fromkeys(shown["remark"]) if remark)
    return (
        f"{remarks}intervals of {found.z:.2f} standard errors; errors in sds of the quantity"
        f"\n{table.to_string(col_space=8)}"
    )
