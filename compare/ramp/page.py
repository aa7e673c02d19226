"""The page of a run-up."""

from typing import Any

import pandas as pd

from rattle.compare.ramp.result import RunUp
from rattle.compare.report.report import Report


def make_report(found: RunUp, record: dict[str, Any]) -> Report:
    """The report on a run-up."""
    by_mesh = found.table["quantity"].str.contains("_mesh")
    facts = {
        name: value
        for name, value in found.to_dict().items()
        if name != "answer" and not isinstance(getattr(found, name), pd.DataFrame)
    }
    return Report(
        "run-up",
        f"The run-up of {record['name']}",
        found.answer,
        record | facts,
        {"found": found, "rows": found.table[~by_mesh], "rows_by_mesh": found.table[by_mesh]},
        figures={"run-up": found.plot()},
        tables={
            "run-up": found.table,
            "points": found.points,
            "thresholds": found.thresholds,
            "overall": found.overall,
        },
        digits="%.6g",
        template="ramp/page.j2",
    )
