"""Stationary quantities in physical units."""

import pandas as pd

from rattle.montecarlo.long_run.names import QUANTILES
from rattle.scene.gears import Gears
from rattle.scene.units import check_units

__all__ = ["in_units"]

SPREAD = ("", "sd_", *(f"q{percent:02d}_" for percent in QUANTILES))
NUMERIC = ["value", "se", "low", "high", "se_batches"]


def in_units(table: pd.DataFrame, gears: Gears | None, units: str) -> pd.DataFrame:
    """A table of stationary quantities in a system of units.

    The energy is that of both wheels in relative motion.  Its unit is the mass of wheel 1 at its rim, ``I1 / R1^2``,
    times the square of ``backlash1 omega``; at mesh 2 the reduced mass of both wheels counts.

    Parameters
    ----------
    table : DataFrame
        Index ``quantity``, dimensionless.
    gears : Gears or None
        The gears that the scene was made from.
    units : {"dimensionless", "physical"}
        The units wanted.

    Returns
    -------
    DataFrame
        With a first column ``unit``; empty for a quantity without one.

    Raises
    ------
    InputError
        For unknown units, or a scene without gears.
    """
    physical = check_units(units, gears) == "physical"
    unit, factor = [], []
    for name in table.index.astype(str):
        what = name.split("_mesh")[0]
        kind = next((k for k in ("flight", "speed") if what in {p + k for p in SPREAD}), what)
        text, value = ("", 1.0)
        if physical and gears is not None:
            u = gears.units
            text, value = {
                "rate": ("1/s", 1000.0 / u.time), "flight": ("ms", u.time), "speed": ("mm/s", u.speed),
                "energy": ("mJ", u.energy), "energy_per_period": ("mJ", u.energy),
                "power": ("mW", 1000.0 * u.energy / u.time),
            }.get(kind, ("", 1.0))  # fmt: skip
        unit.append(text)
        factor.append(value)
    out = table.copy()
    out[NUMERIC] = out[NUMERIC].mul(factor, axis=0)
    out.insert(0, "unit", unit)
    return out
