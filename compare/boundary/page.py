"""The page of a boundary, of a map of them, and of a crossing."""

from pathlib import Path
from typing import Any

from rattle.compare.boundary import crossing
from rattle.compare.boundary.boundary import Boundary
from rattle.compare.boundary.map import BoundaryMap
from rattle.compare.boundary.search import ACCURATE, LOOKS, MOST, UNDECIDED, WRONG
from rattle.compare.report import Figure, Page, PageSection, TableCell, Text, format_table
from rattle.compare.report.provenance import source_of
from rattle.compare.report.save import contents, save

CONTENTS = contents("boundary", figures=("boundary",), tables=("boundary", "points"))
"""Names of all files in such a folder; a folder with any other file is not overwritten."""

MARK = {ACCURATE: "good", WRONG: "bad", UNDECIDED: "open"}
CAPTION = (
    "Error of the worst section mean or sd over its tolerance, with its interval, at every value that was judged. "
    "Below 1 with its whole interval: accurate. Shaded: where the closure stops holding."
)
METHOD = (
    "A coarse scan, evenly spaced in the logarithm, then halving wherever the verdict changes. At each value paths "
    f"are added until the verdict is decided ({', '.join(f'{n:,}' for n in LOOKS)}). The intervals hold for all rows "
    f"at all looks at {MOST} values together with 95 % probability. Between the values of the scan nothing is said: "
    "islands narrower than its spacing are not seen."
)
MAP_CAPTION = (
    "At each value of the second parameter: where every section mean and sd is accurate, where one is shown wrong, and "
    "what lies between two values with different verdicts, or undecided ones. Triangles: the edges."
)
MAP_METHOD = (
    "At each value of the second parameter a search as of `rattle boundary`; those at the ends first, then those "
    "between, each of which tries first where the curve is expected from its neighbours. "
)
CROSSING_MARK = {crossing.BELOW: "good", crossing.ABOVE: "bad", UNDECIDED: "open"}
CROSSING_CAPTION = "The quantity with its interval at every value that was judged. Shaded: where it crosses the level."
CROSSING_METHOD = (
    f"A coarse scan, evenly spaced in the logarithm, then halving wherever the quantity changes sides. At each value "
    f"{crossing.PATHS} paths are followed for {', '.join(f'{n:,}' for n in crossing.LOOKS)} periods of the excitation "
    f"until its interval is on one side of the level. The intervals hold for all looks at {MOST} values together with "
    "95 % probability. Between the values of the scan nothing is said."
)


def boundary_page(found: Boundary, record: dict[str, Any]) -> Page:
    """Build the page of a boundary."""
    table = format_table(
        found.points,
        [
            (found.over, lambda r: r["value"]),
            ("verdict", lambda r: TableCell(r["verdict"], MARK[r["verdict"]])),
            ("paths", lambda r: r["paths"]),
            ("worst error / tolerance", lambda r: r["error"]),
            ("low", lambda r: r["low"]),
            ("high", lambda r: r["high"]),
            ("of", "{row}"),
            ("why undecided", "{remark}"),
        ],
        ("verdict", "of", "why undecided"),
    )
    return Page(
        f"Where {found.closure} stops holding: {record['name']}, over {found.over}",
        tuple(found.answer),
        source_of(record),
        (Figure("boundary.svg", CAPTION, "Worst error over its tolerance against the parameter"), table),
        (PageSection("Method", (Text(METHOD),)),),
    )


def map_page(found: BoundaryMap, record: dict[str, Any]) -> Page:
    """Build the page of a map."""
    table = format_table(
        found.curve,
        [
            (found.along, lambda r: r["along"]),
            (f"{found.over}: accurate up to", lambda r: r["accurate"]),
            ("shown wrong from", lambda r: r["wrong"]),
            ("why", "{why}"),
        ],
        ("why",),
    )
    return Page(
        f"Where {found.closure} stops holding: {record['name']}, over {found.over} and {found.along}",
        tuple(found.answer),
        source_of(record),
        (Figure("boundary.svg", MAP_CAPTION, "Verdicts over both parameters"), table),
        (PageSection("Method", (Text(MAP_METHOD + METHOD),)),),
    )


def crossing_page(found: crossing.Crossing, record: dict[str, Any]) -> Page:
    """Build the page of a crossing."""
    unit = f" ({found.quantity_unit})" if found.quantity_unit else ""
    table = format_table(
        found.points,
        [
            (found.over, lambda r: r["value"]),
            (f"than {found.level:g}", lambda r: TableCell(r["verdict"], CROSSING_MARK[r["verdict"]])),
            ("periods", lambda r: r["periods"]),
            (f"{found.quantity}{unit}", lambda r: r["estimate"]),
            ("low", lambda r: r["low"]),
            ("high", lambda r: r["high"]),
            ("why undecided", "{remark}"),
        ],
        (f"than {found.level:g}", "why undecided"),
    )
    return Page(
        f"Where {found.quantity} crosses {found.level:g}: {record['name']}, over {found.over}",
        tuple(found.answer),
        source_of(record),
        (Figure("boundary.svg", CROSSING_CAPTION, "The quantity against the parameter"), table),
        (PageSection("Method", (Text(CROSSING_METHOD),)),),
    )


def write_boundary(
    out: Path, found: "Boundary | BoundaryMap | crossing.Crossing", record: dict[str, Any], overwrite: bool
) -> None:
    """Write the folder of a boundary, of a map, or of a crossing."""
    pages: dict[type, Any] = {Boundary: boundary_page, BoundaryMap: map_page, crossing.Crossing: crossing_page}
    tables = {"boundary": found.points}
    if isinstance(found, BoundaryMap):
        tables = {"boundary": found.curve, "points": found.points}
    save(
        out,
        "boundary",
        pages[type(found)](found, record),
        record | {name: value for name, value in found.to_dict().items() if name not in ("points", "answer", "curve")},
        allowed=CONTENTS,
        figures={"boundary": found.plot()},
        tables=tables,
        digits="%.6g",
        overwrite=overwrite,
    )
