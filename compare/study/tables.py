"""Loads a finished study from its folder, as tidy tables or as an xarray dataset."""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from rattle.compare.report.manifest import is_whole, not_newer
from rattle.compare.study.design import TABLES, Study
from rattle.compare.validation.verdict import Tolerances, judge
from rattle.scene.errors import FileError, InputError
from rattle.scene.moments import SECTION
from rattle.scene.units import with_units
from rattle.scene.validate import choice

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

__all__ = [
    "CELLS",
    "FILE",
    "MANIFEST",
    "PAGE",
    "TABLES",
    "Tables",
    "file_digest",
    "find_damaged",
    "load_study",
    "read_tables",
]

CELLS, FILE, MANIFEST = "cells", "study.toml", "manifest.json"
"""Names in a study's folder: the folder of results, the study file, and the manifest with the provenance."""

PAGE = "page"
"""Part of the name of scratch folders, in which the output is written before it is moved to its place."""


@dataclass(frozen=True)
class Tables:
    """The tables of a study, from `load_study`.

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


def load_study(folder: str | Path) -> Tables:
    """Load the tables of a study from a folder that ``rattle study`` has written.

    Parameters
    ----------
    folder : str or Path
        The folder.

    Returns
    -------
    Tables

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
    study, record, tables = read_tables(folder)
    if set(tables) != set(TABLES):
        why = "holds a study of the long run; rattle.compare.stationary.study.load loads it"
        raise FileError("study folder", str(folder), why)
    return Tables(study, record, **tables)


def read_tables(folder: str | Path) -> tuple[Study, dict[str, Any], dict[str, pd.DataFrame]]:
    """Read study, manifest and tables of any kind of study from its folder."""
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
    names = record.get("tables", TABLES)
    files = [f"{name}.parquet" for name in names]
    try:
        lost = (
            find_damaged(place, record, files) if "files" in record else []
        )  # manifests of early versions have no digests
    except OSError as error:
        raise FileError("study folder", str(folder), f"{error.filename} cannot be read ({error.strerror})") from None
    if lost:
        raise FileError("study folder", str(folder), f"{lost[0]} {broken}")
    tables = {}
    for name, file in zip(names, files, strict=True):
        try:
            tables[name] = pd.read_parquet(place / file)
        except (MemoryError, ImportError):
            raise
        except Exception:  # pyarrow and pandas raise many kinds for a damaged file
            raise FileError("study folder", str(folder), f"{file} {broken}") from None
    study = Study.load(place / FILE)
    if record.get("study_sha256") not in (None, study.digest):
        raise FileError(
            "study file", str(place / FILE), "is not the study of these tables; run rattle study with it again"
        )
    return study, record, tables


def find_damaged(folder: Path, record: dict[str, Any], files: Iterable[str]) -> list[str]:
    """List the files of a study's folder that are missing or have changed since they were written."""
    written = record.get("files")
    return [f for f in files if not isinstance(written, dict) or written.get(f) != file_digest(folder / f)]


def file_digest(path: Path) -> str | None:
    """Compute the digest of a file."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except (FileNotFoundError, IsADirectoryError):
        return None
