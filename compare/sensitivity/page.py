"""The page of a sensitivity."""

from pathlib import Path
from typing import Any

import numpy as np

from rattle.compare.report import Figure, Page, PageSection, TableCell, Text, format_table
from rattle.compare.report.provenance import source_of
from rattle.compare.report.save import contents, save
from rattle.compare.sensitivity.figures import tornado
from rattle.compare.sensitivity.of_closure import ClosureSensitivity
from rattle.compare.sensitivity.sensitivity import Sensitivity
from rattle.compare.study.parameters import CHANGE, STEPS

CONTENTS = contents("sensitivity", figures=("sensitivity", "by_mesh"), tables=("sensitivity", "values"))
"""Names of all files in such a folder; a folder with any other file is not overwritten."""

CAPTION = (
    f"Relative change of each quantity for {CHANGE:.0%} more of a parameter, the strongest first, with 95 % intervals. "
    f"Grey: not linear here, steps of {STEPS[0]:.0%} and {STEPS[1]:.0%} differ."
)
METHOD = (
    f"Central differences of logarithms: long runs with each parameter {STEPS[0]:.0%} and {STEPS[1]:.0%} lower and "
    "higher. Every other value stays as it is: of gears the amplitude of the drive in mm while a backlash changes, and "
    "σ. Where both steps agree within chance (95 % over all rows) the effect is that of least squares through both, "
    "else it is extrapolated to a small step (Richardson). Where they differ by more than a tenth of it, it is called "
    "not linear, and that of the smaller step is given. Each interval is a 95 % interval (Student's t over independent "
    "groups of runs) by itself. Gain: how much larger the variance would be with independent random numbers; 1 where "
    "chaotic motion forgets them."
)


def sensitivity_page(found: Sensitivity, record: dict[str, Any]) -> Page:
    """Build the page of a sensitivity."""
    table = found.table.assign(
        more=[f"{v:.4g} {unit}".strip() for v, unit in zip(found.table["value"], found.table["unit"], strict=True)]
    )
    effects = format_table(
        table,
        [
            ("quantity", "{quantity}"),
            ("parameter", "{parameter}"),
            ("its value", "{more}"),
            (f"change for {CHANGE:.0%} more", lambda r: _percent(r["effect"])),
            ("low", lambda r: _percent(r["low"])),
            ("high", lambda r: _percent(r["high"])),
            (f"step {STEPS[0]:.0%}", lambda r: _percent(r["small_step"])),
            (f"step {STEPS[1]:.0%}", lambda r: _percent(r["large_step"])),
            ("gain", lambda r: r["gain"]),
            ("remark", lambda r: r["remark"] or ("not linear here" if r["linear"] is False else "")),
        ],
        ("quantity", "parameter", "its value", "remark"),
    )
    values = format_table(
        found.values.reset_index(),
        [("quantity", "{quantity}"), *((n, lambda r, n=n: r[n]) for n in ("value", "low", "high")), ("unit", "{unit}")],
        ("quantity", "unit"),
    )
    alt = "Bars of the change of each quantity by parameter"
    blocks = (Figure("sensitivity.svg", CAPTION, alt), effects)
    by_mesh = (PageSection("By mesh", (Figure("by_mesh.svg", CAPTION, alt),)),) if _by_mesh(found) else ()
    return Page(
        f"What changes the rattle of {record['name']}",
        (*(found.answer or ["Nothing that was changed has an effect larger than its error."]), found.said),
        source_of(record),
        blocks,
        (*by_mesh, PageSection("The motion as it is", (values,)), PageSection("Method", (Text(METHOD),))),
    )


def _by_mesh(found: Sensitivity) -> list[str]:
    """The quantities of the second figure: those of each mesh, where there are others too."""
    own = [name for name in found.values.index if "_mesh" in name]
    return own if len(own) < len(found.values) else []


def _percent(share: float) -> str:
    return "–" if np.isnan(share) else f"{100.0 * share:+.3f} %"


def write_sensitivity(out: Path, found: Sensitivity, record: dict[str, Any], overwrite: bool) -> None:
    """Write the folder of a sensitivity."""
    tables = {"sensitivity": found.table, "values": found.values.reset_index()}
    mesh = _by_mesh(found)
    figures = {"sensitivity": tornado(found.table, [name for name in found.values.index if name not in mesh])}
    if mesh:
        figures["by_mesh"] = tornado(found.table, mesh)
    facts = {name: value for name, value in found.to_dict().items() if name in ("said", "groups", "reached")}
    save(
        out,
        "sensitivity",
        sensitivity_page(found, record),
        record | facts,
        allowed=CONTENTS,
        figures=figures,
        tables=tables,
        digits="%.6g",
        overwrite=overwrite,
    )


OF_CLOSURE = (
    "Change of a section mean or sd for 1 % more of a parameter, in standard deviations of the quantity: the "
    "closure's, from a central difference, and the simulated one, from paths with the same random numbers at 0.5 and "
    "1 % less and more. Low and high: of its error, 95 % for all rows together. Accurate: all of that within 5 % "
    "(means) or 10 % (sds) of the change, or of 1 % of the standard deviation where that is more. Not judged: the "
    "displacement at the mesh that is struck, and changes that are not linear."
)
MARK = {"accurate": "good", "inaccurate": "bad", "undecided": "open"}


def closure_sensitivity_page(found: ClosureSensitivity, record: dict[str, Any]) -> Page:
    """Build the page of a closure's sensitivity."""
    rows = found.table[found.table["verdict"] != "not judged"]
    shown = ("predicted", "simulated", "low", "high", "tolerance")
    table = format_table(
        rows,
        [
            *((name, f"{{{name}}}") for name in ("parameter", "impact", "quantity", "moment")),
            *((name, lambda r, name=name: r[name]) for name in shown),
            ("verdict", lambda r: TableCell(r["verdict"], MARK.get(r["verdict"], ""))),
        ],
        ("parameter", "quantity", "moment", "verdict"),
    )
    title = f"What {found.closure} says of the parameters of {record['name']}"
    return Page(title, tuple(found.answer), source_of(record), (table, Text(OF_CLOSURE, note=True)))


def write_closure_sensitivity(out: Path, found: ClosureSensitivity, record: dict[str, Any], overwrite: bool) -> None:
    """Write the folder of a closure's sensitivity."""
    save(
        out,
        "sensitivity",
        closure_sensitivity_page(found, record),
        record | {"answer": found.answer},
        allowed=CONTENTS,
        figures={},
        tables={"sensitivity": found.table},
        digits="%.6g",
        overwrite=overwrite,
    )
