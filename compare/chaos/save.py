"""Writes the folder of a study of chaos atomically: figures, tables, page and manifest."""

from pathlib import Path
from typing import Any

from rattle.compare.chaos.measure import ChaosStudy
from rattle.compare.chaos.page import FIGURES, chaos_page
from rattle.compare.report.save import contents, save

TABLES = ("exponents", "mean_maps", "lines", "spectra_summary", "fsle", "sqrt_law", "sweep", "crossings")
LARGE = ("sections", "spectra", "bifurcation")
CONTENTS = contents("chaos", figures=tuple(FIGURES), tables=TABLES, large=LARGE)
"""Files of such a folder; a folder with any other file is not overwritten."""


def write_chaos(out: Path, found: ChaosStudy, record: dict[str, Any], overwrite: bool) -> list[str]:
    """Write the folder of a study of chaos."""
    figures = found.figures()
    page = chaos_page(found, record, list(figures))
    save(
        out,
        "chaos",
        page,
        record,
        allowed=CONTENTS,
        figures=figures,
        tables=found.tables(),
        digits="%.10g",
        overwrite=overwrite,
    )
    return list(page.answer)
