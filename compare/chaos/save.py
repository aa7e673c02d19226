"""Writes the folder of a study of chaos atomically: figures, tables, page and manifest."""

from pathlib import Path
from typing import Any

from rattle.compare.chaos.measure import ChaosStudy
from rattle.compare.chaos.page import FIGURES, chaos_page
from rattle.compare.report import pages, write_page
from rattle.compare.report.csv_text import write_csv
from rattle.compare.report.folder import whole_folder
from rattle.compare.report.json_text import json_text
from rattle.compare.report.style import save

__all__ = ["CONTENTS", "write_chaos"]

TABLES = (
    "exponents", "mean_maps", "sections", "spectra", "lines", "spectra_summary", "fsle", "sqrt_law", "sweep",
    "crossings", "bifurcation",
)  # fmt: skip
CONTENTS = frozenset({"manifest.json", *pages("chaos"), *(f"{t}.csv" for t in TABLES), *(f"{f}.svg" for f in FIGURES)})
"""Files of such a folder; a folder with any other file is not overwritten."""


def write_chaos(out: Path, found: ChaosStudy, record: dict[str, Any], overwrite: bool) -> list[str]:
    """Write the folder of a study of chaos.

    Parameters
    ----------
    out : Path
        The folder.
    found : ChaosStudy
    record : dict
        Entries of the manifest.
    overwrite : bool
        Whether earlier results may be replaced.

    Returns
    -------
    list of str
        The answer, in sentences.

    Raises
    ------
    OutputError
        If the folder contains other files, or earlier results and `overwrite` is false.
    """
    said = found.answer
    with whole_folder(out, CONTENTS, overwrite) as folder:
        drawn = found.figures()
        for name, figure in drawn.items():
            save(figure, folder / f"{name}.svg")
        for name, table in found.tables().items():
            write_csv(table, folder / f"{name}.csv", index=False, float_format="%.10g")
        text = json_text({**record, "answer": said}) + "\n"
        write_page(chaos_page(found, record, list(drawn)), folder, "chaos")
        (folder / "manifest.json").write_text(text, encoding="utf-8")
    return said
