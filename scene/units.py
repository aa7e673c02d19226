"""Physical units of the results of a gear pair: ms, mm, mm/s, impacts per second and mJ."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from rattle.scene.errors import InputError
from rattle.scene.validate import choice

__all__ = ["RATE", "UNITS", "Units", "check_units", "in_units"]

UNITS = ("dimensionless", "physical")
"""The systems of units in which results are given."""

MOMENTS = ("", "se_", "sd_", "se_sd_")  # prefixes of columns that have the unit of their quantity; skewness has none
RATE = "impacts_per_s"
"""Column of the inverse of the mean time of flight."""


class Units(NamedTuple):
    """What one dimensionless unit of a gear pair is in physical units; see `rattle.scene.Gears.units`.

    Attributes
    ----------
    time : float
        ``1 / omega``, in ms.
    length : float
        ``backlash1``, in mm.
    speed : float
        ``backlash1 omega``, in mm/s.
    energy : float
        ``inertia1 / radius1^2 (backlash1 omega)^2``, in mJ.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> [round(x, 6) for x in DAT21.units]
    [3.333333, 0.2, 60.0, 8.56633]
    """

    time: float
    length: float
    speed: float
    energy: float

    @property
    def columns_of(self) -> dict[str, tuple[str, float]]:
        """Name with its unit, and factor, of every column of a section table that has a dimension."""
        quantities = {"tau": ("ms", self.time), "flight": ("ms", self.time), "energy": ("mJ", self.energy)}
        for i in (1, 2):
            quantities |= {f"x{i}": ("mm", self.length), f"y{i}": ("mm_per_s", self.speed)}
        return {p + q: (f"{p}{q}_{unit}", factor) for q, (unit, factor) in quantities.items() for p in MOMENTS}

    def convert(self, columns: Mapping[str, Any]) -> dict[str, Any]:
        """Convert the columns of a section table to physical units.

        Parameters
        ----------
        columns : mapping of str to ndarray
            Columns by name.

        Returns
        -------
        dict of str to ndarray
            The same columns in the same order.  A column with a dimension is converted, and its name ends with its
            unit: ``tau_ms``, ``x1_mm``, ``y1_mm_per_s``, ``energy_mJ``.  After the mean time of flight stands its
            inverse, ``impacts_per_s``.

        Examples
        --------
        >>> Units(time=2.0, length=0.2, speed=60.0, energy=8.0).convert({"flight": 5.0, "se_y1": 0.1, "mesh": 1})
        {'flight_ms': 10.0, 'impacts_per_s': 100.0, 'se_y1_mm_per_s': 6.0, 'mesh': 1}
        """
        known, converted = self.columns_of, {}
        for name, values in columns.items():
            shown, factor = known.get(name, (name, None))
            converted[shown] = values if factor is None else values * factor
            if name == "flight":
                converted[RATE] = 1000.0 / converted[shown]
        return converted


def check_units(units: object, gears: object) -> str:
    """Check the name of a system of units for the results of a scene.

    Parameters
    ----------
    units : {"dimensionless", "physical"}
        Its name.
    gears : Gears or None
        The gears that the scene was made from.

    Returns
    -------
    str
        The name.

    Raises
    ------
    InputError
        For an unknown name, or physical units of a scene that was not made from gears.
    """
    name = choice("units", units, UNITS)
    if name == "physical" and gears is None:
        raise InputError("units", name, "this scene was not made from gears; give a [gears] table, or Scene.from_gears")
    return name


def in_units(columns: Mapping[str, Any], gears: Any, units: str) -> dict[str, Any]:
    """The columns of a section table in a system of units.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Dimensionless columns by name.
    gears : Gears or None
        The gears that the scene was made from.
    units : {"dimensionless", "physical"}
        The units wanted.

    Returns
    -------
    dict of str to ndarray
        See `Units.convert`.

    Raises
    ------
    InputError
        As `check_units`.
    """
    return dict(columns) if check_units(units, gears) == "dimensionless" else gears.units.convert(columns)
