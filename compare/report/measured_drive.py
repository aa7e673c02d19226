"""The page of a measured drive."""

from pathlib import Path
from typing import Any

import pandas as pd

from rattle.compare.report import Figure, Page, PageSection, Text, format_table
from rattle.compare.report.provenance import source_of
from rattle.compare.report.save import contents, save
from rattle.scene.measured_drive import CHANCE, SMALL, MeasuredDrive

CONTENTS = contents("drive", figures=("drive",), tables=("orders",))
"""Names of all files in such a folder; a folder with any other file is not overwritten."""

CAPTION = (
    "Above: the mean of all periods of the measurement, less its mean, with the scatter of the periods, and the sum of "
    "the orders that are kept. Below: the acceleration of each order over the largest, with its standard error."
)
METHOD = (
    "Whole periods at the frequency at which the first orders of all periods add up to most; Fourier coefficients of "
    f"each period. Kept are orders with more than {SMALL:.0%} of the largest acceleration and more than {CHANCE:g} "
    "standard errors. The noise: what the acceleration of a period is of the mean one scatters as white noise of that "
    "intensity would make it (docs/guide/drives.md)."
)


def drive_page(found: MeasuredDrive, record: dict[str, Any]) -> Page:
    """Build the page of a measured drive."""
    orders = format_table(
        pd.DataFrame(found.table),
        [
            ("order", lambda r: r["order"]),
            ("amplitude (mm)", lambda r: r["amplitude_mm"]),
            ("standard error (mm)", lambda r: r["se_mm"]),
            ("phase (rad)", lambda r: r["phase"]),
            ("", lambda r: "kept" if r["kept"] else "left out"),
        ],
        ("",),
    )
    return Page(
        f"The measured drive of {record['name']}",
        tuple(found.answer),
        source_of(record),
        (Figure("drive.svg", CAPTION, "The mean period of the measurement beside the sum of its orders"), orders),
        (PageSection("Method", (Text(METHOD),)),),
    )


def write_drive(out: Path, found: MeasuredDrive, record: dict[str, Any], overwrite: bool) -> None:
    """Write the folder of a measured drive."""
    names = ("amplitude", "omega", "periods", "sigma_ratio", "low", "high", "memory", "left_out")
    save(
        out,
        "drive",
        drive_page(found, record),
        record | {name: getattr(found, name) for name in names},
        allowed=CONTENTS,
        figures={"drive": found.plot()},
        tables={"orders": pd.DataFrame(found.table)},
        digits="%.6g",
        overwrite=overwrite,
    )
