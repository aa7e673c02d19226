"""The pages of boundaries, maps, crossings and sensitivities, each laid out in a Markdown file beside this module."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from rattle.compare.parameters import crossing, of_closure, search
from rattle.compare.parameters.boundary import Boundary
from rattle.compare.parameters.figures import tornado
from rattle.compare.parameters.map import BoundaryMap
from rattle.compare.parameters.sensitivity import Sensitivity
from rattle.compare.report.save import contents, save_report
from rattle.compare.study.parameters import PERCENT, STEPS
from rattle.compare.validation.verdict import JUDGED

CONTENTS = contents("boundary", figures=("boundary",), tables=("boundary", "points"))
CONTENTS |= contents("sensitivity", figures=("sensitivity", "by_mesh"), tables=("sensitivity", "values"))
"""Names of all files in such a folder; a folder with any other file is not overwritten."""
MARKS = {search.ACCURATE: "good", search.WRONG: "bad", search.UNDECIDED: "open", "inaccurate": "bad"}
MARKS |= {crossing.BELOW: "good", crossing.ABOVE: "bad"}
METHOD = (
    "A coarse scan, evenly spaced in the logarithm, then halving wherever the verdict changes. At each value paths "
    f"are added until the verdict is decided ({', '.join(f'{n:,}' for n in search.LOOKS)}). The intervals hold for all "
    f"rows at all looks at {search.MOST} values together with 95 % probability. Between the values of the scan nothing "
    "is said: islands narrower than its spacing are not seen."
)
Found = Boundary | BoundaryMap | crossing.Crossing | Sensitivity | of_closure.ClosureSensitivity


class _Report(NamedTuple):
    """What the folder of a result holds besides its answer and its provenance."""

    layout: str  # the Markdown file
    title: str  # with the name of the scene between braces
    parts: dict[str, pd.DataFrame]
    figures: dict[str, Any]
    tables: dict[str, pd.DataFrame]
    values: dict[str, Any]  # of what stands between braces in the layout


def _mark(table: pd.DataFrame) -> pd.DataFrame:
    return table.assign(mark=table["verdict"].map(MARKS).fillna(""))


def _boundary(found: Boundary) -> _Report:
    title = f"Where {found.closure} stops holding: {{}}, over {found.over}"
    parts, tables = {"points": _mark(found.points)}, {"boundary": found.points}
    return _Report("boundary", title, parts, {"boundary": found.plot()}, tables, {"over": found.over, "search": METHOD})


def _map(found: BoundaryMap) -> _Report:
    title = f"Where {found.closure} stops holding: {{}}, over {found.over} and {found.along}"
    tables = {"boundary": found.curve, "points": found.points}
    values = {"over": found.over, "along": found.along, "search": METHOD}
    return _Report("map", title, {"curve": found.curve}, {"boundary": found.plot()}, tables, values)


def _crossing(found: crossing.Crossing) -> _Report:
    title = f"Where {found.quantity} crosses {found.level:g}: {{}}, over {found.over}"
    unit = f" ({found.quantity_unit})" if found.quantity_unit else ""
    values = {"over": found.over, "level": f"{found.level:g}", "quantity": found.quantity + unit}
    values |= {"paths": str(crossing.PATHS), "looks": ", ".join(f"{n:,}" for n in crossing.LOOKS)}
    parts, tables = {"points": _mark(found.points)}, {"boundary": found.points}
    figures = {"boundary": found.plot()}
    return _Report("crossing", title, parts, figures, tables, values | {"most": str(search.MOST)})


def _sensitivity(found: Sensitivity) -> _Report:
    mesh = [name for name in found.values.index if "_mesh" in name]
    mesh = mesh if len(mesh) < len(found.values) else []  # in a figure of their own where there are others too
    figures = {"sensitivity": tornado(found.table, [name for name in found.values.index if name not in mesh])}
    figures |= {"by_mesh": tornado(found.table, mesh)} if mesh else {}
    shown, values = found.table.copy(), found.values.reset_index()
    shown["now"] = [f"{v:.4g} {unit}".strip() for v, unit in zip(shown["value"], shown["unit"], strict=True)]
    for name in ("effect", "low", "high", "small_step", "large_step"):
        shown[name] = ["–" if np.isnan(share) else f"{100.0 * share:+.3f} %" for share in shown[name]]
    shown["remark"] = shown["remark"].mask(shown["linear"].eq(False), "not linear here")
    parts, tables = {"effects": shown, "values": values}, {"sensitivity": found.table, "values": values}
    return _Report("sensitivity", "What changes the rattle of {}", parts, figures, tables, _steps(STEPS))


def _of_closure(found: of_closure.ClosureSensitivity) -> _Report:
    rows = found.table[found.table["verdict"].isin(JUDGED)]
    order = (rows["error"].abs() / rows["tolerance"]).sort_values(ascending=False, kind="stable").index
    parts = {"changes": _mark(rows.loc[order])}
    title, tables = f"What {found.closure} says of the parameters of {{}}", {"sensitivity": found.table}
    return _Report("of_closure", title, parts, {}, tables, _steps(of_closure.STEPS))


def _steps(steps: tuple[float, float]) -> dict[str, str]:
    near, far = (f"{100.0 * step:g} %" for step in steps)
    return {"near": near, "far": far, "change": PERCENT}


REPORTS: dict[type, Any] = {
    Boundary: _boundary,
    BoundaryMap: _map,
    crossing.Crossing: _crossing,
    Sensitivity: _sensitivity,
    of_closure.ClosureSensitivity: _of_closure,
}


def write_report(out: Path, found: Found, record: dict[str, Any], overwrite: bool) -> None:
    """Write the folder of a result."""
    report: _Report = REPORTS[type(found)](found)
    in_tables = ("points", "curve", "table", "values", "answer")
    facts = {key: value for key, value in found.to_dict().items() if key not in in_tables}
    save_report(
        out,
        next(iter(report.tables)),
        report.title.replace("{}", record["name"]),
        found.answer,
        record | facts,
        report.parts,
        package="parameters",
        layout=f"{report.layout}.md",
        values=report.values,
        allowed=CONTENTS,
        figures=report.figures,
        tables=report.tables,
        digits="%.6g",
        overwrite=overwrite,
    )
