"""The manifest of a report: all that is needed to repeat a run bit for bit, and to check that it
was."""

import hashlib
import io
import math
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from rattle.compare.report.json_text import Facts, check_not_newer, json_digest, plain
from rattle.compare.report.provenance import versions
from rattle.compare.report.render import render_sentences
from rattle.scene import FileError, Floats, InputError, Scene, check_keys
from rattle.scene.files import read_json, read_text

VERSION = 1
"""Version of the format of manifests."""

REPEATED_TABLES = {"table_sha256": "table.csv", "validity_sha256": "validity.csv"}
"""Tables by the name of their digest, which a repeated run must share with the first; timings are
not covered."""


class ReportSettings(NamedTuple):
    """The settings of a report; together with the versions they determine every number."""

    name: str  # of the scene
    scenes: tuple[Scene, ...]  # one for each noise intensity
    # impacts, paths, dt, scheme, seed: of the simulations, see `rattle.montecarlo.simulate`
    impacts: int
    paths: int
    dt: float
    scheme: str
    seed: int
    order: int  # order of the closures' moments
    closures: tuple[str, ...]
    validity: tuple[float, ...] = ()  # noise intensities of the range of validity; may be empty
    validity_paths: int = 0  # simulated paths at each of these
    beside: tuple[str, ...] = ()  # schemes whose ensembles are shown beside that of the report

    @property
    def simulation(self) -> Facts:
        """Settings of every simulation of the report, except scene and threads."""
        return {
            "paths": self.paths,
            "impacts": self.impacts,
            "dt": self.dt,
            "scheme": self.scheme,
            "rng": self.seed,
        }

    @property
    def sweep(self) -> Facts:
        """Settings of the simulations for the range of validity."""
        return {"paths": self.validity_paths, "impacts": self.impacts, "rng": self.seed}

    def to_dict(self) -> Facts:
        """The settings as plain data for the manifest."""
        return {**self._asdict(), "scenes": [s.to_dict() for s in self.scenes]}


class Recorded(NamedTuple):
    """Content of the manifest of an earlier report."""

    settings: ReportSettings
    # of its tables, by `REPEATED_TABLES`; None where it has no such table
    digests: dict[str, str | None]
    # see `versions`; entries that an earlier version of this program did not record are missing
    versions: dict[str, str]
    tables: dict[str, str]  # texts of those that lie beside the manifest


def read_settings(path: Path) -> Recorded:
    """Read the manifest of an earlier report."""
    try:
        data = read_json("manifest", path, "a manifest.json")
        check_not_newer("manifest", data.get("version"), VERSION, path)
        if not is_whole(data):
            raise FileError("manifest", str(path), "was changed after it was written; restore it")
        settings = data["settings"]
        check_keys("manifest.settings", settings, ReportSettings._fields)
        scenes = tuple(Scene.from_dict(s) for s in settings["scenes"])
        if not scenes:
            raise InputError("manifest.settings.scenes", [], "must hold a scene")
        lists = {
            name: tuple(settings[name])
            for name in ("closures", "validity", "beside")
            if name in settings
        }
        digests = {name: data.get(name) for name in REPEATED_TABLES}
        if digests["table_sha256"] is None:
            raise KeyError("table_sha256")
        versions = {str(of): str(version) for of, version in data.get("versions", {}).items()}
        tables = {}
        for of, file in REPEATED_TABLES.items():
            with suppress(FileError):
                tables[of] = read_text("table", path.parent / file, "a CSV file")
        settings = ReportSettings(**{**settings, "scenes": scenes, **lists})
        return Recorded(settings, digests, versions, tables)
    except InputError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise FileError(
            "manifest", str(path), f"is no manifest of this version ({error})"
        ) from None


def seal(record: Mapping[str, Any]) -> Facts:
    """Add a digest of a record to it, so that a later change is detected."""
    record = plain(record)
    return {**record, "seal": json_digest(record)}


def is_whole(record: Mapping[str, Any]) -> bool:
    """Whether a record is unchanged since it was sealed."""
    content = {name: value for name, value in record.items() if name != "seal"}
    return "seal" not in record or record["seal"] == json_digest(content)


def digest(text: str) -> str:
    """SHA-256 digest of a text."""
    return hashlib.sha256(text.encode()).hexdigest()


BIT_FOR_BIT = "bit for bit"
ROUNDED = "but for rounding"
DIFFERENT = "different"

SAMPLED_ROUNDING = 0.01
"""The largest difference that counts as rounding, in standard errors of the simulated number:
another seed makes one.

Code for other vector instructions sums in another order (2e-14 sd between two kinds of x86-64).
Where products are rounded differently too, one path in a million takes another itinerary: 1e-3
standard errors (256 000 paths of DAT21).
"""
PREDICTED_ROUNDING = 1e-9
"""The same for numbers that are not sampled, those of a closure, in sds of the quantity (measured:
5e-15)."""
RELATIVE = 1e-3
"""At small noise this share of a value replaces the sd as unit of differences: rounding errors
scale with the value."""

SAMPLED_COLUMNS = {
    "simulated",
    "se",
    "bias",
    "error",
    "low",
    "high",
    "unit",
    "tolerance",
    "agreement",
}
"""Columns that are estimated from the paths."""
DERIVED = {"paths_needed", "why", "remark"}
"""Not compared, for they follow from other columns: by a difference that may nearly cancel, or in
words."""
NAMING = ("sigma", "closure", "kind", "moment", "quantity", "impact")
"""Columns that identify a row."""


class Difference(NamedTuple):
    """The largest difference between two tables, relative to what rounding explains."""

    # difference over the largest one that rounding explains; infinite if the entries are not
    # numbers
    excess: float
    # sds, errors: difference in sds of the quantity, and in standard errors (NaN where nothing is
    # sampled)
    sds: float
    errors: float
    where: str  # column, row, and both entries


class Repeat(NamedTuple):
    """Result of comparing a repeated report with the first."""

    outcome: str  # `BIT_FOR_BIT`, `ROUNDED` or `DIFFERENT`
    largest: Difference | None  # none if both are the same, or if only digests could be compared
    why: str  # why only digests could be compared; else empty
    # versions and properties of the processor that differ: as recorded (None if not recorded), and
    # here
    changed: dict[str, tuple[str | None, str | None]]

    @property
    def sentences(self) -> list[str]:
        """The result in sentences for the user."""
        return render_sentences(
            "report/repeat.j2",
            repeat=self,
            exact=BIT_FOR_BIT,
            rounded=ROUNDED,
            sampled=SAMPLED_ROUNDING,
            predicted=PREDICTED_ROUNDING,
        )

    def to_dict(self) -> Facts:
        """The result as plain data for JSON."""
        return {
            "outcome": self.outcome,
            "largest_difference": self.largest and self.largest._asdict(),
            "why": self.why,
            "changed": {
                name: {"manifest": there, "here": here}
                for name, (there, here) in self.changed.items()
            },
        }


def compare(recorded: Recorded, now: Mapping[str, Any], folder: Path) -> Repeat:
    """Compare a repeated report with the first."""
    there = recorded.versions
    here = versions()
    names = dict.fromkeys([*here, *there])
    changed = {n: (there.get(n), here.get(n)) for n in names if there.get(n) != here.get(n)}
    differences = []
    altered = []
    for name, file in REPEATED_TABLES.items():
        text = recorded.tables.get(name)
        before = recorded.digests[name]
        if text is not None and before not in (None, digest(text)):
            altered.append(file)
        if now[name] == before:
            continue
        if now[name] is None or before is None:
            differences.append(incomparable(f"only one of them has {file}"))
        elif text is None or file in altered:
            why = f"no {file} with the manifest's digest lies beside it"
            return Repeat(DIFFERENT, None, why, changed)
        else:
            first = pd.read_csv(io.StringIO(text))
            largest = difference(first, pd.read_csv(folder / file), recorded.settings.paths)
            differences.append(largest._replace(where=f"{file}, {largest.where}"))
    if altered:
        differences.append(incomparable(f"{' and '.join(altered)} beside it was changed since"))
    if not differences:
        return Repeat(BIT_FOR_BIT, None, "", changed)
    largest = max(differences, key=lambda one: one.excess)
    return Repeat(ROUNDED if largest.excess <= 1.0 else DIFFERENT, largest, "", changed)


def incomparable(where: str) -> Difference:
    """A difference that is not one of numbers."""
    return Difference(math.inf, math.inf, math.nan, where)


def difference(one: pd.DataFrame, other: pd.DataFrame, paths: int) -> Difference:
    """The largest difference between two tables of a report, relative to what rounding explains."""
    if list(one) != list(other) or len(one) != len(other):
        return incomparable("it has other rows or columns")
    names = [str(name) for name in one if name not in DERIVED]
    differences = np.array([_differences(one, other, name, paths) for name in names])
    sds, errors = differences.swapaxes(0, 1)  # (columns, rows) each
    sampled = np.isfinite(errors) & (errors > 0.0)
    unit = np.divide(sds, errors, out=np.zeros_like(sds), where=sampled)
    excess = sds / (PREDICTED_ROUNDING + SAMPLED_ROUNDING * unit)
    if not excess.max(initial=0.0) > 0.0:
        return Difference(0.0, 0.0, math.nan, "only digits or words differ")
    place = np.unravel_index(np.argmax(excess), excess.shape)
    column, row = place
    name = names[column]
    which = ", ".join(f"{n} {one[n].iloc[row]}" for n in NAMING if n in one and n != name)
    where = f"column {name}, {which}: {one[name].iloc[row]} and {other[name].iloc[row]}"
    return Difference(float(excess[place]), float(sds[place]), float(errors[place]), where)


def _differences(
    one: pd.DataFrame, other: pd.DataFrame, name: str, paths: int
) -> tuple[Floats, Floats]:
    """Differences of a column in sds and in standard errors."""
    a = one[name]
    b = other[name]
    same = ((a == b) | (a.isna() & b.isna())).to_numpy(bool)
    errors = np.full(len(one), math.nan)
    # text and counts must be equal
    if not (pd.api.types.is_float_dtype(a) and pd.api.types.is_float_dtype(b)):
        return np.where(same, 0.0, math.inf), errors
    absent = pd.Series(0.0, index=one.index)
    values = [a, b, one.get("simulated", absent)]
    sizes = [RELATIVE * value.abs().to_numpy(float) for value in values]
    sizes.append(one.get("unit", absent).to_numpy(float))
    gap = np.where(same, 0.0, (a - b).abs())
    with np.errstate(invalid="ignore", divide="ignore"):
        sds = np.where(same, 0.0, gap / np.fmax.reduce(sizes))
        if name in SAMPLED_COLUMNS:
            error = paths**-0.5 if name == "agreement" else one.get("se", absent).to_numpy(float)
            errors = np.where(error > 0.0, gap / error, math.nan)
    return np.where(np.isnan(sds), math.inf, sds), errors
