"""Physical units of the results of a gear pair: ms, mm, mm/s, impacts per second and mJ."""

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rattle.scene.errors import InputError, choice
from rattle.scene.types import Facts

if TYPE_CHECKING:  # a table is there before it is converted
    import pandas as pd
    import xarray as xr

UNITS = ("dimensionless", "physical")
"""The systems of units in which results are given."""

QUANTITY = re.compile(r"(?:se_|bias_)?(?:sd_)?(tau|flight|energy|[xy])[0-9]*")
"""Columns that have the unit of their quantity; skewness has none."""
COVARIANCE_COLUMN = re.compile(r"(?:se_)?cov_([xy])[0-9]+_([xy])[0-9]+")
UNIT_OF_QUANTITY = {"tau": "ms", "flight": "ms", "energy": "mJ", "x": "mm", "y": "mm_per_s"}
RATE = "impacts_per_s"
"""Column of the inverse of the mean time of flight."""
PRODUCTS = {
    ("mm", "mm"): "mm2",
    ("mm", "mm_per_s"): "mm2_per_s",
    ("mm_per_s", "mm_per_s"): "mm2_per_s2",
}
"""Units of covariances."""


DIMENSIONLESS = {
    "ms": "1/omega",
    "mm": "backlash1",
    "mm_per_s": "backlash1 omega",
    "mJ": "inertia1/radius1^2 (backlash1 omega)^2",
}
"""What dimensionless results count in, by the unit that they have in physical ones."""


class Units(NamedTuple):
    """What one dimensionless unit of a gear pair is in physical units; see
    `rattle.scene.Gears.units`."""

    time: float  # ``1 / omega``, in ms
    length: float  # ``backlash1``, in mm
    speed: float  # ``backlash1 omega``, in mm/s
    energy: float  # ``inertia1 / radius1^2 (backlash1 omega)^2``, in mJ

    def of_column(self, name: str) -> tuple[str, float] | None:
        """Unit, as it ends the name of a column of a table of moments, and factor; None for a
        column without a dimension."""
        factors = {"ms": self.time, "mm": self.length, "mm_per_s": self.speed, "mJ": self.energy}
        if quantity := QUANTITY.fullmatch(name):
            unit = UNIT_OF_QUANTITY[quantity[1]]
            return unit, factors[unit]
        if pair := COVARIANCE_COLUMN.fullmatch(name):
            one, other = sorted(UNIT_OF_QUANTITY[kind] for kind in pair.groups())
            return PRODUCTS[one, other], factors[one] * factors[other]
        return None

    def name_of(self, column: str) -> str:
        """The name of a column in physical units."""
        known = self.of_column(column)
        return f"{column}_{known[0]}" if known else column

    def convert(self, columns: Mapping[str, Any]) -> Facts:
        """Convert the columns of a table of moments, of a section or at fixed times, to physical
        units.

        Returns: The same columns in the same order.  A column with a dimension is converted, and
        its name ends with its unit: ``tau_ms``, ``x1_mm``, ``y1_mm_per_s``, ``cov_x1_x1_mm2``,
        ``energy_mJ``.  After the mean time of flight stands its inverse, ``impacts_per_s``.
        """
        converted = {}
        for name, values in columns.items():
            known = self.of_column(name)
            shown = self.name_of(name)
            converted[shown] = values * known[1] if known else values
            if name == "flight":
                with np.errstate(divide="ignore"):  # an impact at once after the start
                    converted[RATE] = 1000.0 / converted[shown]
        return converted


def check_units(units: object, gears: object) -> str:
    """Check the name of a system of units for the results of a scene."""
    name = choice("units", units, UNITS)
    if name == "physical" and gears is None:
        raise InputError(
            "units",
            name,
            "this scene was not made from gears; give a [gears] table, or Scene.from_gears",
        )
    return name


def in_units(columns: Mapping[str, Any], gears: Any, units: str) -> Facts:
    """The columns of a section table in a system of units."""
    return (
        dict(columns)
        if check_units(units, gears) == "dimensionless"
        else gears.units.convert(columns)
    )


def unit_of_column(name: str, units: str, gears: Any) -> tuple[str, float] | None:
    """Unit, as it is written, and factor of a column of a section table; None for one without a
    dimension."""
    physical = check_units(units, gears) == "physical"
    known = (gears.units if physical else Units(1.0, 1.0, 1.0, 1.0)).of_column(name)
    if known is None:
        return None
    unit, factor = known
    return unit.replace("_per_", "/") if physical else DIMENSIONLESS[unit], factor


def as_dataset(table: "pd.DataFrame", units: str, gears: Any) -> "xr.Dataset":
    """A section table as an xarray dataset: a variable for each column, with its unit in
    ``attrs``."""
    known = {name: unit_of_column(str(name), units, gears) for name in table}
    changed = {str(name): table[name] * unit[1] for name, unit in known.items() if unit}
    data = table.assign(**changed).to_xarray()
    for name, variable in data.items():
        unit = known[name]
        variable.attrs["units"] = unit[0] if unit else "1"
    return data


def with_units(data: "xr.Dataset") -> "xr.Dataset":
    """A dimensionless dataset with the unit of each quantity in the attributes of its dimension
    ``quantity``."""
    units = {name: unit_of_column(name, "dimensionless", None) for name in data["quantity"].values}
    data["quantity"].attrs |= {name: unit[0] for name, unit in units.items() if unit}
    return data


def at_times_in(table: "pd.DataFrame", gears: Any, units: str) -> "pd.DataFrame":
    """A table of moments at fixed times in a system of units."""
    if check_units(units, gears) == "dimensionless":
        return table
    converted = type(table)(gears.units.convert(table))
    return converted.set_axis((table.index * gears.units.time).rename("time_ms"))
