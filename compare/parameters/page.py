"""The pages of boundaries, maps, crossings and sensitivities, each laid out in a Markdown file
beside this module."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rattle.compare.parameters import crossing, of_closure, search
from rattle.compare.parameters.boundary import Boundary
from rattle.compare.parameters.figures import tornado
from rattle.compare.parameters.finding import TEXTS, Finding, with_unit
from rattle.compare.parameters.map import BoundaryMap
from rattle.compare.parameters.sensitivity import Sensitivity
from rattle.compare.report.save import contents, save_report
from rattle.compare.study.parameters import PERCENT, STEPS
from rattle.compare.validation import verdict
from rattle.scene.text import percent

CONTENTS = contents("boundary", figures=("boundary",), tables=("boundary", "points"))
CONTENTS |= contents(
    "sensitivity", figures=("sensitivity", "by_mesh"), tables=("sensitivity", "values")
)
"""Names of all files in such a folder; a folder with any other file is not overwritten."""
MARKS = verdict.MARKS | {crossing.BELOW: "good", crossing.ABOVE: "bad"}
IN_TABLES = ("points", "curve", "table", "values")
LOOKS = {"most": search.MOST, "looks": ", ".join(f"{n:,}" for n in search.LOOKS)}
SEARCH = {"search": TEXTS["search"].format(**LOOKS)}
LONG_RUNS = {
    "paths": crossing.PATHS,
    "looks": ", ".join(f"{n:,}" for n in crossing.LOOKS),
    "most": search.MOST,
}


def _steps(near: float, far: float) -> dict[str, str]:
    return {"near": percent(near), "far": percent(far), "change": PERCENT}


KINDS: dict[type[Finding], tuple[str, str, dict[str, Any]]] = {
    Boundary: ("boundary", "boundary.md", SEARCH),
    BoundaryMap: ("boundary", "map.md", SEARCH),
    crossing.Crossing: ("boundary", "crossing.md", LONG_RUNS),
    Sensitivity: ("sensitivity", "sensitivity.md", _steps(*STEPS)),
    of_closure.ClosureSensitivity: ("sensitivity", "of_closure.md", _steps(*of_closure.STEPS)),
}
"""Name of the files, layout, and what stands between braces in it besides attributes, by the kind
of result."""


def write_report(out: Path, found: Any, record: dict[str, Any], overwrite: bool) -> None:
    """Write the folder of a result."""
    name, layout, values = KINDS[type(found)]
    table = shown = getattr(found, found.shown)
    tables = {name: table}
    parts = {}
    figures = {}
    if isinstance(found, Sensitivity):
        tables["values"] = parts["values"] = found.values.reset_index()
        shown = _in_percent(table)
        figures = _tornados(found)
    elif isinstance(found, of_closure.ClosureSensitivity):
        shown = table[table["verdict"].isin(verdict.JUDGED)]
        shown = shown.loc[
            (shown["error"].abs() / shown["tolerance"])
            .sort_values(ascending=False, kind="stable")
            .index
        ]
    else:
        figures[name] = found.plot()
    if isinstance(found, BoundaryMap):
        tables["points"] = found.points
    elif isinstance(found, crossing.Crossing):
        values = values | {"quantity": with_unit(found.quantity, found.quantity_unit)}
    if "verdict" in shown:
        shown = shown.assign(mark=shown["verdict"].map(MARKS).fillna(""))
    facts = {
        key: value for key, value in found.to_dict().items() if key not in (*IN_TABLES, "answer")
    }
    save_report(
        out,
        name,
        TEXTS["titles"][type(found).__name__].format(name=record["name"], **vars(found)),
        found.answer,
        record | facts,
        parts | {found.shown: shown},
        package="parameters",
        layout=layout,
        values=vars(found) | values,
        allowed=CONTENTS,
        figures=figures,
        tables=tables,
        digits="%.6g",
        overwrite=overwrite,
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
