"""The page of a measured drive."""

import numpy as np
import pandas as pd

from rattle.compare.report.json_text import Facts
from rattle.compare.report.report import Report
from rattle.scene.measured_drive import CHANCE, SMALL_ORDER, MeasuredDrive

RECORDED = (
    "amplitude",
    "omega",
    "periods",
    "sigma_ratio",
    "low",
    "high",
    "floor",
    "memory",
    "left_out",
)
"""Attributes of a measured drive that its manifest holds."""


def make_report(found: MeasuredDrive, record: Facts) -> Report:
    """The report on a measured drive."""
    orders = pd.DataFrame(found.table)
    return Report(
        "drive",
        f"The measured drive of {record['name']}",
        found.answer,
        record | {name: getattr(found, name) for name in RECORDED},
        {
            "orders": orders.assign(said=np.where(orders["kept"], "kept", "left out")),
            "small": SMALL_ORDER,
            "chance": CHANCE,
        },
        figures={"drive": found.plot()},
        tables={"orders": orders},
        digits="%.6g",
        template="report/drive.j2",
    )
