"""Physical units of the results of a gear pair: ms, mm, mm/s, impacts per second and mJ."""

from collections.abc import Mapping
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING, Any, NamedTuple

from rattle.scene.errors import InputError, choice

if TYPE_CHECKING:  # a table is there before it is converted
    import pandas as pd
    import xarray as xr

UNITS = ("dimensionless", "physical")
"""The systems of units in which results are given."""

UNIT_PREFIXES = ("", "se_", "bias_", "sd_", "se_sd_", "bias_sd_")
"""Prefixes of columns that have the unit of their quantity; skewness has none."""
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

    @property
    def columns_of(self) -> dict[str, tuple[str, float]]:
        """Name with its unit, and factor, of every column of a table of moments that has a
        dimension."""
        kinds = {"x": ("mm", self.length), "y": ("mm_per_s", self.speed)}
        state = {f"{kind}{i}": unit for i in (1, 2) for kind, unit in kinds.items()}
        quantities = {
            "tau": ("ms", self.time),
            "flight": ("ms", self.time),
            "energy": ("mJ", self.energy),
            **state,
        }
        found = {
            p + q: (f"{p}{q}_{unit}", factor)
            for q, (unit, factor) in quantities.items()
            for p in UNIT_PREFIXES
        }
        for a, b in combinations_with_replacement(state, 2):
            one, first = state[a]
            other, second = state[b]
            unit = PRODUCTS[min(one, other), max(one, other)]
            name = f"cov_{a}_{b}"
            found |= {p + name: (f"{p}{name}_{unit}", first * second) for p in ("", "se_")}
        return found

    def convert(self, columns: Mapping[str, Any]) -> dict[str, Any]:
        """Convert the columns of a table of moments, of a section or at fixed times, to physical
        units.

        Returns: The same columns in the same order.  A column with a dimension is converted, and
        its name ends with its unit: ``tau_ms``, ``x1_mm``, ``y1_mm_per_s``, ``cov_x1_x1_mm2``,
        ``energy_mJ``.  After the mean time of flight stands its inverse, ``impacts_per_s``.
        """
        known = self.columns_of
        converted = {}
        for name, values in columns.items():
            shown, factor = known.get(name, (name, None))
            converted[shown] = values if factor is None else values * factor
            if name == "flight":
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


def in_units(columns: Mapping[str, Any], gears: Any, units: str) -> dict[str, Any]:
    """The columns of a section table in a system of units."""
    return (
        dict(columns)
        if check_units(units, gears) == "dimensionless"
        else gears.units.convert(columns)
    )


def units_of(units: str, gears: Any) -> dict[str, tuple[str, float]]:
    """Unit, as it is written, and factor of the columns of a section table that have a
    dimension."""
    physical = check_units(units, gears) == "physical"
    found = {}
    for name, (shown, factor) in (
        gears.units if physical else Units(1.0, 1.0, 1.0, 1.0)
    ).columns_of.items():
        unit = shown.removeprefix(f"{name}_")
        if not name.startswith(("cov_", "se_cov_")):
            found[name] = (unit.replace("_per_", "/") if physical else DIMENSIONLESS[unit], factor)
    return found


def as_dataset(table: "pd.DataFrame", units: str, gears: Any) -> "xr.Dataset":
    """A section table as an xarray dataset: a variable for each column, with its unit in
    ``attrs``."""
    known = units_of(units, gears)
    factors = {name: known[name] for name in table if name in known}
    data = table.assign(
        **{name: table[name] * factor for name, (_, factor) in factors.items()}
    ).to_xarray()
    for name, variable in data.items():
        variable.attrs["units"] = known[name][0] if name in known else "1"
    return data


def with_units(data: "xr.Dataset") -> "xr.Dataset":
    """A dimensionless dataset with the unit of each quantity in the attributes of its dimension
    ``quantity``."""
    known = units_of("dimensionless", None)
    data["quantity"].attrs |= {name: known[name][0] for name in data["quantity"].values}
    return data


def at_times_in(table: "pd.DataFrame", gears: Any, units: str) -> "pd.DataFrame":
    """A table of moments at fixed times in a system of units."""
    if check_units(units, gears) == "dimensionless":
        return table
    converted = type(table)(gears.units.convert(table))
    return converted.set_axis((table.index * gears.units.time).rename("time_ms"))
