"""The page of a measured drive."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rattle.compare.report.save import contents, save_report
from rattle.scene.measured_drive import CHANCE, SMALL, MeasuredDrive

CONTENTS = contents("drive", figures=("drive",), tables=("orders",))
"""Names of all files in such a folder; a folder with any other file is not overwritten."""


def write_drive(out: Path, found: MeasuredDrive, record: dict[str, Any], overwrite: bool) -> None:
    """Write the folder of a measured drive."""
    orders = pd.DataFrame(found.table)
    shown = {"orders": orders.assign(said=np.where(orders["kept"], "kept", "left out"))}
    names = ("amplitude", "omega", "periods", "sigma_ratio", "low", "high", "memory", "left_out")
    record = record | {name: getattr(found, name) for name in names}
    where: dict[str, Any] = {"package": "report", "layout": "drive.md", "values": {"small": SMALL, "chance": CHANCE}}
    files: dict[str, Any] = {"figures": {"drive": found.plot()}, "tables": {"orders": orders}, "digits": "%.6g"}
    title = f"The measured drive of {record['name']}"
    save_report(
        out, "drive", title, found.answer, record, shown, **where, allowed=CONTENTS, overwrite=overwrite, **files
    )
