"""Writes the folder of a long run atomically: figures, tables, page and manifest."""

from pathlib import Path
from typing import Any

import pandas as pd

from rattle.compare.report.save import contents, save
from rattle.compare.stationary.bifurcation import Bifurcation, bifurcation_figure
from rattle.compare.stationary.figures import draw, speed_unit
from rattle.compare.stationary.measure import Stationary
from rattle.compare.stationary.page import FIGURES, stationary_page

CONTENTS = contents(
    "stationary", figures=tuple(FIGURES), tables=("stationary", "physical", "verdicts", "sections", "bifurcation")
)
"""Files of such a folder; a folder with any other file is not overwritten."""


def write_stationary(
    out: Path, found: Stationary, view: Bifurcation | None, record: dict[str, Any], overwrite: bool
) -> list[str]:
    """Write the folder of a long run."""
    figures = draw(found)
    tables, units = {"stationary": found.table.reset_index()}, "dimensionless"
    if found.scene.gears is not None:
        units = "physical"
        tables["physical"] = found.table_in(units).reset_index()
    if len(found.verdicts):
        tables["verdicts"] = found.verdicts_in(units)
    if found.densities:
        tables["sections"] = pd.concat([d.table for d in found.densities], ignore_index=True)
    if view is not None:
        figures["bifurcation"], tables["bifurcation"] = (
            bifurcation_figure(view, *speed_unit(found.scene.gears)),
            view.table,
        )
    page = stationary_page(found, record, list(figures))
    save(
        out,
        "stationary",
        page,
        record | found.to_dict(),
        allowed=CONTENTS,
        figures=figures,
        tables=tables,
        digits="%.8g",
        overwrite=overwrite,
    )
    return list(page.answer)
