"""The pages of boundaries, maps, crossings and sensitivities, each with a template beside this
module."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rattle.compare.parameters import crossing, of_closure, search
from rattle.compare.parameters.boundary import Boundary
from rattle.compare.parameters.figures import tornado
from rattle.compare.parameters.finding import PARAMETER_TEXTS, Finding, with_unit
from rattle.compare.parameters.map import BoundaryMap
from rattle.compare.parameters.sensitivity import Sensitivity
from rattle.compare.report.report import Report
from rattle.compare.study.parameters import PERCENT, RELATIVE_CHANGES
from rattle.compare.validation import verdict
from rattle.scene.text import percent

FINDING_MARKS = verdict.MARKS | {crossing.BELOW_LEVEL: "good", crossing.ABOVE_LEVEL: "bad"}
IN_TABLES = ("points", "curve", "table", "values")
LOOKS_TOLD = {
    "most": search.MOST_VALUES,
    "looks": ", ".join(f"{n:,}" for n in search.PATHS_OF_LOOKS),
}
SEARCH = {"search": PARAMETER_TEXTS["search"].format(**LOOKS_TOLD)}
LONG_RUNS = {
    "paths": crossing.CROSSING_PATHS,
    "looks": ", ".join(f"{n:,}" for n in crossing.PERIODS_OF_LOOKS),
    "most": search.MOST_VALUES,
}


def _steps(near: float, far: float) -> dict[str, str]:
    return {"near": percent(near), "far": percent(far), "change": PERCENT}


FINDING_KINDS: dict[type[Finding], tuple[str, str, dict[str, Any]]] = {
    Boundary: ("boundary", "boundary", SEARCH),
    BoundaryMap: ("boundary", "map", SEARCH),
    crossing.Crossing: ("boundary", "crossing", LONG_RUNS),
    Sensitivity: ("sensitivity", "sensitivity", _steps(*RELATIVE_CHANGES)),
    of_closure.ClosureSensitivity: (
        "sensitivity",
        "of_closure",
        _steps(*of_closure.SIMULATED_CHANGES),
    ),
}
"""Name of the page, its template, and texts in it, by the kind of result."""


def make_report(found: Any, record: dict[str, Any]) -> Report:
    """The report on a result."""
    name, template, texts = FINDING_KINDS[type(found)]
    rows = getattr(found, found.shown)
    tables = {name: rows}
    content = {"found": found, **texts}
    figures = {}
    if isinstance(found, Sensitivity):
        tables["values"] = content["values"] = found.values.reset_index()
        rows = _in_percent(rows)
        figures = _tornados(found)
    elif isinstance(found, of_closure.ClosureSensitivity):
        rows = rows[rows["verdict"].isin(verdict.JUDGED)]
        worst_first = (rows["error"].abs() / rows["tolerance"]).sort_values(
            ascending=False, kind="stable"
        )
        rows = rows.loc[worst_first.index]
    else:
        figures[name] = found.plot()
    if isinstance(found, BoundaryMap):
        tables["points"] = found.points
    elif isinstance(found, crossing.Crossing):
        content["quantity"] = with_unit(found.quantity, found.quantity_unit)
    if "verdict" in rows:
        rows = rows.assign(mark=rows["verdict"].map(FINDING_MARKS).fillna(""))
    facts = {
        key: value for key, value in found.to_dict().items() if key not in (*IN_TABLES, "answer")
    }
    return Report(
        name,
        PARAMETER_TEXTS["titles"][type(found).__name__].format(name=record["name"], **vars(found)),
        found.answer,
        record | facts,
        content | {"rows": rows},
        figures=figures,
        tables=tables,
        digits="%.6g",
        template=f"parameters/{template}.j2",
    )


def _in_percent(table: pd.DataFrame) -> pd.DataFrame:
    """The effects as the page shows them."""
    shown = table.copy()
    shown["now"] = [
        f"{v:.4g} {unit}".strip() for v, unit in zip(shown["value"], shown["unit"], strict=True)
    ]
    for name in ("effect", "low", "high", "small_step", "large_step"):
        shown[name] = [
            "–" if np.isnan(share) else f"{100.0 * share:+.3f} %" for share in shown[name]
        ]
    shown["remark"] = shown["remark"].mask(shown["linear"].eq(False), "not linear here")
    return shown


def _tornados(found: Sensitivity) -> dict[str, Figure]:
    """The figures; quantities by mesh have one of their own where there are others too."""
    names = pd.Index(found.values.index)
    by_mesh = names.str.contains("_mesh")
    groups = {"sensitivity": names[~by_mesh], "by_mesh": names[by_mesh]}
    if not all(map(len, groups.values())):
        groups = {"sensitivity": names}
    return {name: tornado(found.table, list(group)) for name, group in groups.items()}
