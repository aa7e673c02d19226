"""The page of an assessment."""

import pandas as pd

from rattle.compare.assess.assessment import Assessment
from rattle.compare.report.json_text import Facts
from rattle.compare.report.report import Report
from rattle.compare.report.texts import glossary
from rattle.compare.stationary.page import tabulate_meshes
from rattle.compare.study.parameters import PERCENT


def make_report(found: Assessment, record: Facts) -> Report:
    """The report on an assessment."""
    gears = found.scene.gears
    tables = {"thresholds": pd.DataFrame([t._asdict() for t in found.thresholds])}
    content: Facts = {"found": found, "change": PERCENT}
    if found.motion is not None and found.rattles:
        tables["motion"] = found.table.reset_index()
        content["by_mesh"] = tabulate_meshes(found.motion, found.table)
    if found.levers is not None:
        tables["levers"] = found.levers.table
    for boundary in found.closures:
        tables[boundary.closure] = boundary.points
    return Report(
        "assess",
        f"Does it rattle? {record['name']}",
        found.answer,
        record | found.to_dict(),
        content,
        glossary("assess", gears=gears),
        figures=found.figures(),
        tables=tables,
        digits="%.6g",
    )
