"""The page of a boundary, and that of a crossing."""

from pathlib import Path
from typing import Any

from rattle.compare.boundary import crossing
from rattle.compare.boundary.boundary import Boundary
from rattle.compare.boundary.search import ACCURATE, LOOKS, MOST, UNDECIDED, WRONG
from rattle.compare.report import Figure, Page, PageSection, TableCell, Text, format_table
from rattle.compare.report.provenance import source_of
from rattle.compare.report.save import contents, save

CONTENTS = contents("boundary", figures=("boundary",), tables=("boundary",))
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


def write_boundary(out: Path, found: "Boundary | crossing.Crossing", record: dict[str, Any], overwrite: bool) -> None:
    """Write the folder of a boundary, or of a crossing."""
    page = boundary_page(found, record) if isinstance(found, Boundary) else crossing_page(found, record)
    save(
        out,
        "boundary",
        page,
        record | {name: value for name, value in found.to_dict().items() if name not in ("points", "answer")},
        allowed=CONTENTS,
        figures={"boundary": found.plot()},
        tables={"boundary": found.points},
        digits="%.6g",
        overwrite=overwrite,
    )
