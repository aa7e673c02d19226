"""A finished study, loaded from its folder: tidy tables, and the same as a dataset."""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from rattle.compare.report.manifest import is_whole, not_newer
from rattle.compare.study.design import Study
from rattle.compare.validation.verdict import Tolerances, judge
from rattle.scene.errors import FileError
from rattle.scene.moments import SECTION

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["CELLS", "FILE", "MANIFEST", "PAGE", "TABLES", "Tables", "damaged", "file_digest", "load"]

CELLS, FILE, MANIFEST = "cells", "study.toml", "manifest.json"
"""Names in a study's folder: where the results are, the study itself, and where it all comes from."""

PAGE = "page"
"""In the names of scratch folders: where all of it is written before it takes its place."""

TABLES = ("errors", "sections", "correlation", "validity", "paired", "cost", "reasons")
"""Tables of a study, each a Parquet file."""


@dataclass(frozen=True)
class Tables:
    """What a study found.

    Attributes
    ----------
    study : Study
    record : dict
        The manifest.
    errors, sections, correlation, range of validity, paired, cost, reasons : DataFrame
        See the properties of `rattle.compare.study.results.Results`.
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
        """The errors judged by other tolerances."""
        share = self.errors["moment"].map({"mean": within.mean, "sd": within.sd})
        return judge(self.errors.assign(tolerance=np.maximum(share * self.errors["unit"], self.errors["still"])))

    def to_xarray(self) -> "xr.Dataset":
        """Errors of the closures and moments of the simulation as a dataset over the fields that vary.

        Dimensions: the first field of each axis, ``impact, quantity, moment`` and, for what belongs to one,
        ``closure``.  Needs the extra ``xarray``.
        """
        index = [*(axis.names[0] for axis in self.study.axes), "impact", "quantity", "moment"]
        errors = self.errors.set_index([*index, "closure"])
        predictions = errors[["predicted", "error", "low", "high", "tolerance", "verdict"]].to_xarray()
        sections = self.sections[self.sections["quantity"].isin(SECTION)].set_index(index)[["value", "se"]].to_xarray()
        return predictions.merge(sections.rename(value="simulated"), join="outer")


def load(folder: str | Path) -> Tables:
    """The tables of a study from the folder that `rattle study` has written.

    Raises
    ------
    FileError
        If the folder holds no finished study, or a file in it is not what was written or cannot be read.

    Examples
    --------
    >>> load("nowhere")
    Traceback (most recent call last):
    ...
    rattle.scene.errors.FileError: study folder = 'nowhere': holds no finished study; give what rattle study has written
    """
    if not isinstance(folder, str | Path):
        raise FileError("study folder", folder, "is no path; give that of what rattle study has written")
    place = Path(folder)
    try:
        record = json.loads((place / MANIFEST).read_text(encoding="utf-8"))
        if not isinstance(record, dict):
            raise ValueError
        not_newer(record, place / MANIFEST)
    except FileError:
        raise
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError, ValueError, RecursionError):
        why = "holds no finished study; give what rattle study has written"
        raise FileError("study folder", str(folder), why) from None
    except OSError as error:
        raise FileError("study folder", str(folder), f"{MANIFEST} cannot be read ({error.strerror})") from None
    corrected = "is damaged; run rattle study again, it is soon corrected"
    if not is_whole(record):
        raise FileError("study folder", str(folder), f"{MANIFEST} {corrected}")
    files = [f"{name}.parquet" for name in TABLES]
    try:
        lost = damaged(place, record, files) if "files" in record else []  # an earlier version kept no digests
    except OSError as error:
        raise FileError("study folder", str(folder), f"{error.filename} cannot be read ({error.strerror})") from None
    if lost:
        raise FileError("study folder", str(folder), f"{lost[0]} {corrected}")
    tables = {}
    for name, file in zip(TABLES, files, strict=True):
        try:
            tables[name] = pd.read_parquet(place / file)
        except (MemoryError, ImportError):
            raise
        except Exception:  # pyarrow and pandas raise whatever they meet in a damaged file
            raise FileError("study folder", str(folder), f"{file} {corrected}") from None
    study = Study.load(place / FILE)
    if record.get("study_sha256") not in (None, study.digest):
        raise FileError("study file", str(place / FILE), "is not the one of these tables; give it to rattle again")
    return Tables(study, record, **tables)


def damaged(folder: Path, record: dict[str, Any], files: Iterable[str]) -> list[str]:
    """The files in a study's folder that are not as they were written, or not there; OSError where none can tell."""
    written = record.get("files")
    return [f for f in files if not isinstance(written, dict) or written.get(f) != file_digest(folder / f)]


def file_digest(path: Path) -> str | None:
    """Digest of a file; None where there is none.  OSError where the system does not let it be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except (FileNotFoundError, IsADirectoryError):
        return None
