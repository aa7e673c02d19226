"""The page of a measured drive."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rattle.compare.report import Page
from rattle.compare.report.provenance import source_of
from rattle.compare.report.save import contents, save
from rattle.compare.report.texts import lay_out
from rattle.scene.measured_drive import CHANCE, SMALL, MeasuredDrive

CONTENTS = contents("drive", figures=("drive",), tables=("orders",))
"""Names of all files in such a folder; a folder with any other file is not overwritten."""


def write_drive(out: Path, found: MeasuredDrive, record: dict[str, Any], overwrite: bool) -> None:
    """Write the folder of a measured drive."""
    orders = pd.DataFrame(found.table)
    shown = {"orders": orders.assign(said=np.where(orders["kept"], "kept", "left out"))}
    laid_out = lay_out("report", shown, ["drive"], "drive.md", small=SMALL, chance=CHANCE)
    page = Page(f"The measured drive of {record['name']}", tuple(found.answer), source_of(record), *laid_out)
    names = ("amplitude", "omega", "periods", "sigma_ratio", "low", "high", "memory", "left_out")
    record = record | {name: getattr(found, name) for name in names}
    parts: dict[str, Any] = {"figures": {"drive": found.plot()}, "tables": {"orders": orders}, "digits": "%.6g"}
    save(out, "drive", page, record, allowed=CONTENTS, overwrite=overwrite, **parts)
