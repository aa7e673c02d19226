"""Whether a repeated report has the numbers of the first: bit for bit, but for rounding, or not."""

import io
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from compare.manifest import DIGESTS, Recorded, digest, versions
from scene.text import line

__all__ = ["DIFFERENT", "ROUNDED", "ROUNDING", "SAME", "Repeat", "compared", "difference", "tables_beside"]

SAME, ROUNDED, DIFFERENT = "bit for bit", "but for rounding", "different"

ROUNDING = 1e-9
"""The largest difference that is called rounding, in sds of the quantity.

Other vector instructions add the same paths up in another order, which moves a mean by some 1e-14 of an sd (measured
between two kinds of processor: 2e-14); other elementary functions move each path by its last bit, which impacts make
larger.  One path that takes another itinerary, whatever the reason, moves a mean by about 1/paths of an sd: 1e-6 of a
million.  The bound stands between the two, so that what it lets through has every path on the itinerary that it had.
"""
FAINT = 1e-3
"""Where this share of a value is more than the sd, it is the unit: rounding is of the value, however small its sd."""

TABLES = {"table_sha256": "table.csv", "frontier_sha256": "frontier.csv"}
DERIVED = {"paths_needed"}
"""Follows from the other columns, through a difference that may be next to nothing."""
NAMING = ("sigma", "reading", "kind", "moment", "quantity", "impact")
"""Columns that say which row it is."""


class Repeat(NamedTuple):
    """How a repeated report compares with the first.

    Attributes
    ----------
    outcome : str
        `SAME`, `ROUNDED` or `DIFFERENT`.
    largest : float or None
        The largest difference, in sds of the quantity; None where only digests could be compared.
    where : str
        Its table, column and row.
    changed : dict of str to (str or None, str or None)
        Versions and parts of the processor that differ: recorded (None where not), and here.
    """

    outcome: str
    largest: float | None
    where: str
    changed: dict[str, tuple[str | None, str | None]]

    @property
    def sentences(self) -> list[str]:
        """What a person is told."""
        if self.outcome == SAME:
            return ["Repeated bit for bit."]
        if self.largest is None:
            found = f"The numbers differ from the manifest's. Only digests could be compared: {self.where}."
        elif math.isinf(self.largest):
            found = f"The numbers differ from the manifest's: {self.where}."
        else:
            bound = f"the largest difference is {self.largest:.2g} sd ({self.where}; up to {ROUNDING:g} is rounding)."
            said = "Repeated but for rounding" if self.outcome == ROUNDED else "The numbers differ from the manifest's"
            found = f"{said}: {bound}"
        return [found, self._versions]

    @property
    def _versions(self) -> str:
        silent = [f"{name} (here {here})" for name, (there, here) in self.changed.items() if there is None]
        told = [f"{n} {there}, here {here}" for n, (there, here) in self.changed.items() if there is not None]
        said = [f"The manifest's versions that differ: {'; '.join(told)}."] if told else []
        said += [f"The manifest does not say: {', '.join(silent)}."] if silent else []
        return " ".join(map(line, said)) or "All versions and the processor are those of the manifest."

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        changed = {name: {"manifest": there, "here": here} for name, (there, here) in self.changed.items()}
        return {
            "outcome": self.outcome, "largest_difference": self.largest, "where": self.where, "changed": changed,
            "rounding": ROUNDING,
        }  # fmt: skip


def tables_beside(path: Path, recorded: Recorded) -> dict[str, str]:
    """The tables beside a manifest as CSV text, by the name of their digests: those that are the manifest's own."""
    found = {}
    for name, file in TABLES.items():
        try:
            text = (path.parent / file).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            continue
        if digest(text) == recorded.digests[name]:
            found[name] = text
    return found


def compared(recorded: Recorded, earlier: Mapping[str, str], now: Mapping[str, Any], folder: Path) -> Repeat:
    """Compare a repeated report with the first.

    Parameters
    ----------
    recorded : Recorded
        What the manifest of the first says.
    earlier : mapping of str to str
        Its tables, as `tables_beside` finds them.
    now : mapping
        The manifest of the repeated one.
    folder : Path
        Where that one lies.
    """
    here = versions()
    changed = {n: (recorded.versions.get(n), here.get(n)) for n in dict.fromkeys([*here, *recorded.versions])}
    changed = {name: pair for name, pair in changed.items() if pair[0] != pair[1]}
    differing = [name for name in DIGESTS if now[name] != recorded.digests[name]]
    if not differing:
        return Repeat(SAME, 0.0, "", changed)
    worst, where = 0.0, ""
    for name in differing:
        file = TABLES[name]
        if now[name] is None or recorded.digests[name] is None:
            return Repeat(DIFFERENT, math.inf, f"only one of them has {file}", changed)
        if name not in earlier:
            return Repeat(DIFFERENT, None, f"no {file} with the manifest's digest lies beside it", changed)
        tables = (pd.read_csv(io.StringIO(text)) for text in (earlier[name], (folder / file).read_text("utf-8")))
        found, at = difference(*tables)
        if found >= worst:
            worst, where = found, f"{file}, {at}"
    return Repeat(ROUNDED if worst <= ROUNDING else DIFFERENT, worst, where, changed)


def difference(one: pd.DataFrame, other: pd.DataFrame) -> tuple[float, str]:
    """The largest difference between two tables of a report and where it is; infinite where it is not one of numbers.

    Numbers differ in units of the row's ``unit`` (the sd of the quantity), or of `FAINT` of the value.

    Examples
    --------
    >>> table = pd.DataFrame({"quantity": ["y1"], "closure": [1.0], "monte_carlo": [1.5], "unit": [0.5]})
    >>> difference(table, table.assign(closure=1.25))
    (0.5, 'column closure, quantity y1: 1.0 and 1.25')
    """
    if list(one) != list(other) or len(one) != len(other):
        return math.inf, "it has other rows or columns"
    worst, where = 0.0, "written with other digits alone"
    for name in one.columns.difference(list(DERIVED), sort=False):
        error = _errors(one, other, name)
        row = int(np.argmax(error)) if len(error) else 0
        if len(error) and error[row] > worst:
            which = ", ".join(f"{n} {one[n].iloc[row]}" for n in NAMING if n in one and n != name)
            values = f"{one[name].iloc[row]} and {other[name].iloc[row]}"
            worst, where = float(error[row]), f"column {name}, {which}: {values}"
    return worst, where


def _errors(one: pd.DataFrame, other: pd.DataFrame, name: str) -> NDArray[np.float64]:
    a, b = one[name], other[name]
    if not (pd.api.types.is_float_dtype(a) and pd.api.types.is_float_dtype(b)):  # words and counts are equal or not
        return np.where((a != b) & ~(a.isna() & b.isna()), math.inf, 0.0)
    sizes = [FAINT * a.abs(), FAINT * b.abs(), one.get("unit", 0.0 * a), FAINT * one.get("monte_carlo", 0.0 * a).abs()]
    with np.errstate(invalid="ignore", divide="ignore"):
        error = (a - b).abs().to_numpy() / np.fmax.reduce([s.to_numpy(float) for s in sizes])
    same = (a == b) | (a.isna() & b.isna())
    return np.where(same, 0.0, np.where(np.isnan(error), math.inf, error))
