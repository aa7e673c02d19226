"""The tables of a study of impacts, and the folder in which a finished study of any kind lies."""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from rattle.compare.report import pages
from rattle.compare.report.manifest import is_whole, not_newer
from rattle.compare.report.save import MANIFEST, file_digest
from rattle.compare.study.design import Study, kind_of
from rattle.compare.validation.verdict import Tolerances, judge
from rattle.scene.errors import FileError, InputError
from rattle.scene.moments import SECTION
from rattle.scene.units import with_units
from rattle.scene.validate import choice

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

__all__ = ["Tables", "load_study"]

TABLES = ("errors", "sections", "correlation", "validity", "paired", "cost", "reasons")
"""Tables of a study of impacts, each a Parquet file."""

CELLS, FILE = "cells", "study.toml"
"""Names in a study's folder: the folder of results, and the study file."""

PAGE = "page"
"""Part of the name of scratch folders, in which the output is written before it is moved to its place."""


@dataclass(frozen=True)
class Tables:
    """The tables of a study of impacts, from `load_study`.

    Attributes
    ----------
    study : Study
        What was asked for.
    record : dict
        The manifest.
    errors, sections, correlation, validity, paired, cost, reasons : DataFrame
        Errors of the closures with verdicts; section moments; correlation coefficients; range of validity; differences
        of neighbours; times; why a cell could not be computed.

    Examples
    --------
    >>> from rattle import load_study
    >>> sorted(load_study("reports/studies/noise").errors["closure"].unique())
    ['branching', 'corrected', 'published', 'saltation']
    """

    study: Study
    record: dict[str, Any]
    errors: pd.DataFrame
    sections: pd.DataFrame
    correlation: pd.DataFrame
    validity: pd.DataFrame
    paired: pd.DataFrame
    cost: pd.DataFrame
    reasons: pd.DataFrame

    @property
    def empty(self) -> bool:
        """Whether there is nothing to compare."""
        return self.errors.empty

    def judged(self, within: Tolerances) -> pd.DataFrame:
        """Judge the errors by other tolerances."""
        share = self.errors["moment"].map({"mean": within.mean, "sd": within.sd})
        return judge(self.errors.assign(tolerance=np.maximum(share * self.errors["unit"], self.errors["still"])))

    def to_xarray(self) -> "xr.Dataset":
        """Convert the errors of the closures and the moments of the simulation to a dataset.

        Needs the optional dependency ``xarray`` (``pip install rattle[xarray]``).

        Returns: Dimensions: the first field of each axis, ``impact, quantity, moment`` and, for the errors,
        ``closure``; ``["quantity"].attrs`` holds the unit of each quantity.
        """
        index = [*(axis.names[0] for axis in self.study.axes), "impact", "quantity", "moment"]
        errors = self.errors.set_index([*index, "closure"])
        predictions = errors[["predicted", "error", "low", "high", "tolerance", "verdict"]].to_xarray()
        sections = self.sections[self.sections["quantity"].isin(SECTION)].set_index(index)[["value", "se"]].to_xarray()
        return with_units(predictions.merge(sections.rename(value="simulated"), join="outer"))

    def plot(self, kind: str = "validity", **at: Any) -> "Figure":
        """Draw a figure of the study's page.

        Keywords are values of the fields that vary besides the first; the table's first where one is left out.
        """
        from rattle.compare.study.figures import FIGURES, panels

        draw, table, _ = FIGURES[choice("kind", kind, FIGURES)]
        rows = getattr(self, table)
        for fixed, part in panels(self, rows, len(rows)) if len(rows) and self.study.along else ():
            if at.items() <= fixed.items():
                return draw(self, part)
        raise InputError("kind", kind, f"there is nothing to draw{f' at {at}' if at else ''} in this study")


def load_study(folder: str | Path) -> Any:
    """Load the tables of a study from a folder that ``rattle study`` has written.

    Parameters
    ----------
    folder : str or Path
        The folder.

    Returns
    -------
    Tables
        Of a study of the long run, an object with ``study, record, quantities, verdicts, cost, reasons``, `plot` and
        `to_xarray`.

    Raises
    ------
    FileError
        If the folder holds no finished study, or a file in it is damaged or cannot be read.

    Examples
    --------
    >>> load_study("nowhere")
    Traceback (most recent call last):
    ...
    rattle.scene.errors.FileError: study folder = 'nowhere': holds no finished study; give the folder of one
    """
    if not isinstance(folder, str | Path):
        raise FileError("study folder", folder, "is no path; give the folder that rattle study wrote")
    place = Path(folder)
    try:
        record = json.loads((place / MANIFEST).read_text(encoding="utf-8"))
        if not isinstance(record, dict):
            raise ValueError
        not_newer(record, place / MANIFEST)
    except FileError:
        raise
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError, ValueError, RecursionError):
        why = "holds no finished study; give the folder of one"
        raise FileError("study folder", str(folder), why) from None
    except OSError as error:
        raise FileError("study folder", str(folder), f"{MANIFEST} cannot be read ({error.strerror})") from None
    broken = "is damaged; run rattle study again: it rewrites the tables from the stored cells"
    if not is_whole(record):
        raise FileError("study folder", str(folder), f"{MANIFEST} {broken}")
    study = Study.load(place / FILE)
    if record.get("study_sha256") != study.digest:
        raise FileError(
            "study file", str(place / FILE), "is not the study of these tables; run rattle study with it again"
        )
    kind = kind_of(study.kind)
    try:
        lost = find_damaged(place, record, [f"{name}.parquet" for name in kind.tables])
    except OSError as error:
        raise FileError("study folder", str(folder), f"{error.filename} cannot be read ({error.strerror})") from None
    if lost:
        raise FileError("study folder", str(folder), f"{lost[0]} {broken}")
    return kind.make(study, record, **{name: pd.read_parquet(place / f"{name}.parquet") for name in kind.tables})


def find_damaged(folder: Path, record: dict[str, Any], files: Iterable[str]) -> list[str]:
    """List the files of a study's folder that are missing or have changed since they were written."""
    written = record.get("files")
    return [f for f in files if not isinstance(written, dict) or written.get(f) != file_digest(folder / f)]


def files_of(study: Study) -> tuple[str, ...]:
    """Files whose digests the manifest of a finished study holds."""
    return (*(f"{name}.parquet" for name in kind_of(study.kind).tables), *pages("study"))


def is_current(study: Study, folder: Path) -> dict[str, Any] | None:
    """Read the manifest of a folder, if it belongs to this study and covers all of its cells.

    Returns: The manifest; None if the folder is missing, damaged, incomplete, or of another study or version.
    """
    try:
        record: dict[str, Any] = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(record, dict) or not is_whole(record):
        return None
    if record.get("cells_sha256") != cells_digest(study) or not record.get("complete"):
        return None
    try:
        return record if not find_damaged(folder, record, files_of(study)) else None
    except OSError:  # a file that cannot be read is written again, from the cells
        return None


def cells_digest(study: Study) -> str:
    """Compute a digest of the study's file and of the keys of its cells."""
    keys = ",".join(sorted(cell.key for cell in study.cells))
    return hashlib.sha256(f"{study.digest} {keys}".encode()).hexdigest()
