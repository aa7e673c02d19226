"""Stationary quantities in physical units."""

import pandas as pd

from rattle.montecarlo.long_run.names import NAMES, QUANTILES
from rattle.scene.gears import Gears
from rattle.scene.units import DIMENSIONLESS, check_units

SPREAD = ("", "sd_", *(f"q{percent:02d}_" for percent in QUANTILES))
NUMERIC = ["value", "se", "low", "high", "se_batches", "predicted", "simulated", "error", "tolerance"]


PLAIN = {
    "rate": "omega",
    "flight": DIMENSIONLESS["ms"],
    "speed": DIMENSIONLESS["mm_per_s"],
    "energy": DIMENSIONLESS["mJ"],
    "energy_per_period": DIMENSIONLESS["mJ"],
    "power": f"{DIMENSIONLESS['mJ']} omega",
}
"""What dimensionless quantities count in, by their kind."""


def kind_of(quantity: str) -> str:
    """Which of the kinds of quantities it is, whatever its mesh, and its mean, sd or quantile."""
    what = quantity.split("_mesh")[0]
    return next((name for name in NAMES.values() if what in {p + name for p in SPREAD}), what).removesuffix("_above")


def unit_of(quantity: str, gears: Gears | None, units: str) -> tuple[str, float]:
    """The unit of a quantity, and its factor; empty and 1 for one without a unit.

    The energy is that of both wheels in relative motion.  Its unit is the mass of wheel 1 at its rim, ``I1 / R1^2``,
    times the square of ``backlash1 omega``; at mesh 2 the reduced mass of both wheels counts.
    """
    if gears is None or check_units(units, gears) == "dimensionless":
        return "", 1.0
    u = gears.units
    found = {
        "rate": ("1/s", 1000.0 / u.time),
        "flight": ("ms", u.time),
        "speed": ("mm/s", u.speed),
        "energy": ("mJ", u.energy),
        "energy_per_period": ("mJ", u.energy),
        "power": ("mW", 1000.0 * u.energy / u.time),
    }
    return found.get(kind_of(quantity), ("", 1.0))


def speed_text(speed: float, gears: Gears | None, units: str) -> str:
    """A dimensionless speed as text, with its unit."""
    unit, factor = unit_of("speed", gears, units)
    return f"{speed * factor:.3g} {unit}".rstrip()


def in_units(table: pd.DataFrame, gears: Gears | None, units: str) -> pd.DataFrame:
    """A table of stationary quantities or verdicts in a system of units, with a column ``unit``.

    The quantities are its column ``quantity``, or its index.
    """
    check_units(units, gears)
    names = table.get("quantity", table.index)
    found = [unit_of(str(name), gears, units) for name in names]
    out = table.copy()
    numeric = [name for name in NUMERIC if name in out]
    out[numeric] = out[numeric].mul([factor for _, factor in found], axis=0)
    out.insert(list(table).index("quantity") + 1 if "quantity" in table else 0, "unit", [unit for unit, _ in found])
    return out
