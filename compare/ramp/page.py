"""The page of a run-up."""

import pandas as pd

from rattle.compare.ramp.result import RunUp
from rattle.compare.report.json_text import Facts
from rattle.compare.report.report import Report
from rattle.compare.report.texts import wheel_label


def make_report(found: RunUp, record: Facts) -> Report:
    """The report on a run-up."""
    parts = found.table["quantity"].str.partition("_mesh")
    by_mesh = parts[2] != ""
    labels = [wheel_label(found.scene, int(mesh)) for mesh in parts[2][by_mesh]]
    rows_by_mesh = found.table[by_mesh].assign(quantity=parts[0][by_mesh], wheel=labels)
    return Report(
        "run-up",
        f"The run-up of {record['name']}",
        found.answer,
        record | found.facts,
        {
            "found": found,
            "rows": found.table[~by_mesh],
            "rows_by_mesh": rows_by_mesh,
            "drags": list_drags(found),
        },
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


def list_drags(found: RunUp) -> pd.DataFrame:
    """Drag and threshold of every wheel at every speed, a row each."""
    parts = [
        pd.DataFrame(
            {
                "wheel": wheel_label(found.scene, wheel),
                "rpm": found.points["rpm"],
                "drag": found.points[f"drag{wheel}"],
                "threshold": found.points[f"threshold{wheel}"],
            }
        )
        for wheel in range(1, found.scene.stages + 1)
    ]
    return pd.concat(parts)
