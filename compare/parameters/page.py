"""The pages of boundaries, maps, crossings and sensitivities, each with a template beside this
module."""

from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from rattle.compare.judge import verdict
from rattle.compare.parameters import crossing, search
from rattle.compare.parameters.boundary import Boundary
from rattle.compare.parameters.figures import tornado
from rattle.compare.parameters.finding import PARAMETER_TEXTS, by_error
from rattle.compare.parameters.map import BoundaryMap
from rattle.compare.parameters.of_closure import SIMULATED_CHANGES, ClosureSensitivity
from rattle.compare.parameters.sensitivity import EFFECTS, Sensitivity
from rattle.compare.report.json_text import Facts
from rattle.compare.report.report import Report
from rattle.compare.report.table import NO_VALUE
from rattle.compare.report.texts import label_quantities
from rattle.compare.study.parameters import PERCENT, RELATIVE_CHANGES
from rattle.scene.text import percent

FINDING_MARKS = verdict.MARKS | {crossing.BELOW_LEVEL: "good", crossing.ABOVE_LEVEL: "bad"}
LOOKS = ", ".join(f"{n:,}" for n in search.PATHS_OF_LOOKS)
SEARCH = {"search": PARAMETER_TEXTS["search"].format(most=search.MOST_VALUES, looks=LOOKS)}
LONG_RUNS = {
    "looks": ", ".join(f"{n:,}" for n in crossing.PATH_PERIODS_OF_LOOKS),
    "most": search.MOST_VALUES,
}


def _steps(steps: tuple[float, float]) -> dict[str, str]:
    return {"near": percent(steps[0]), "far": percent(steps[1]), "change": PERCENT}


FINDING_KINDS = {
    Boundary: ("boundary", "boundary", SEARCH),
    BoundaryMap: ("boundary", "map", SEARCH),
    crossing.Crossing: ("boundary", "crossing", LONG_RUNS),
    Sensitivity: ("sensitivity", "sensitivity", _steps(RELATIVE_CHANGES)),
    ClosureSensitivity: ("sensitivity", "of_closure", _steps(SIMULATED_CHANGES)),
}
"""Name of the page, its template, and texts in it, by the kind of result."""


def make_report(found: Any, record: Facts) -> Report:
    """The report on a result."""
    name, template, texts = FINDING_KINDS[type(found)]
    rows = getattr(found, found.shown)
    tables = {name: rows}
    figures = {}
    if isinstance(found, Sensitivity):
        tables["values"] = found.values.reset_index()
        rows = label_quantities(found.scene, _in_percent(rows))
        figures = _tornados(found)
    elif isinstance(found, ClosureSensitivity):
        rows = by_error(rows[rows["verdict"].isin(verdict.JUDGED)])
    else:
        figures[name] = found.plot()
    if isinstance(found, BoundaryMap):
        tables["points"] = found.points
    if "verdict" in rows:
        rows = rows.assign(mark=rows["verdict"].map(FINDING_MARKS).fillna(""))
    title = PARAMETER_TEXTS["titles"][type(found).__name__]
    return Report(
        name,
        title.format(name=record["name"], **vars(found)),
        found.answer,
        record | found.facts,
        {"found": found, "rows": rows, **texts},
        figures=figures,
        tables=tables,
        digits="%.6g",
        template=f"parameters/{template}.j2",
    )


def _in_percent(table: pd.DataFrame) -> pd.DataFrame:
    """The effects as the page shows them."""
    shown = table.copy()
    shown["now"] = (table["value"].map("{:.4g} ".format) + table["unit"]).str.strip()
    percents = (100.0 * table[EFFECTS]).map("{:+.3f} %".format, na_action="ignore")
    shown[EFFECTS] = percents.fillna(NO_VALUE)
    shown["remark"] = shown["remark"].mask(shown["linear"].eq(False), "not linear here")
    return shown


def _tornados(found: Sensitivity) -> dict[str, Figure]:
    """The figures; quantities by mesh have one of their own where there are others too."""
    groups: dict[str, list[str]] = {"sensitivity": [], "by_mesh": []}
    for name in found.values.index:
        groups["by_mesh" if "_mesh" in name else "sensitivity"].append(name)
    if not all(groups.values()):
        groups = {"sensitivity": list(found.values.index)}
    return {name: tornado(found, group) for name, group in groups.items()}
