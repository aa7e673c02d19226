"""The result of a long run, which holds its numbers, and its quantities in physical units."""

import re
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from rattle.closure.stationary import Law
from rattle.compare.report.json_text import Facts
from rattle.compare.stationary.verdicts import judge_predictions, laws, predictions
from rattle.montecarlo.long_run import LongRun, SectionDensity
from rattle.montecarlo.long_run.estimates import groups
from rattle.montecarlo.long_run.scatter import SCATTER_PERCENT, SCATTERED, values_of_sets
from rattle.scene import Gears, InputError, Scene, as_html, choice
from rattle.scene.long_orbit import Attractor
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.threshold import rattle_threshold
from rattle.scene.units import DIMENSIONLESS, Units, check_units

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

LEAST_EFFECTIVE = 16.0
"""Effective paths below which an interval is a tenth wider for that, or more."""
DRAWN_OF_SETS = ("rate_above", "speed_above", "power")
"""Quantities whose distribution over gear sets is drawn."""
LEAST_SHARE = 0.25  # of the paths, where there are few
MESH_OR_MOMENT = re.compile(r"^(sd_|rms_|q\d\d_)|(_above)?(_mesh\d+)?$")
"""What the name of a quantity says beside its kind."""
NUMERIC = ["value", "se", "low", "high", "se_batches"]
NUMERIC += ["predicted", "simulated", "error", "tolerance"]
"""Columns of estimates and of verdicts that have the unit of their quantity."""
PLAIN_UNITS = {
    "rate": "omega",
    "flight": DIMENSIONLESS["ms"],
    "speed": DIMENSIONLESS["mm_per_s"],
    "energy": DIMENSIONLESS["mJ"],
    "energy_per_period": DIMENSIONLESS["mJ"],
    "power": f"{DIMENSIONLESS['mJ']} omega",
}
"""What each kind of quantities counts in where they are dimensionless."""


def physical_units(u: Units) -> dict[str, tuple[str, float]]:
    """The physical unit of each kind of quantities, and the factor to it."""
    return {
        "rate": ("1/s", 1000.0 / u.time),
        "flight": ("ms", u.time),
        "speed": ("mm/s", u.speed),
        "energy": ("mJ", u.energy),
        "energy_per_period": ("mJ", u.energy),
        "power": ("mW", 1000.0 * u.energy / u.time),
    }


def usual_units(scene: Scene) -> str:
    """The units that pages state quantities in."""
    return "physical" if scene.gears else "dimensionless"


def plain_unit(quantity: str) -> str:
    """What a dimensionless quantity counts in; "1" without a unit."""
    return PLAIN_UNITS.get(kind_of(quantity), "1")


def kind_of(quantity: str) -> str:
    """Which of the kinds of quantities it is, whatever its mesh, and its mean, sd or quantile."""
    return MESH_OR_MOMENT.sub("", quantity)


def unit_of(quantity: str, gears: Gears | None, units: str) -> tuple[str, float]:
    """The unit of a quantity, and its factor; empty and 1 for one without a unit.

    The energy is that of the wheels at the mesh in relative motion.  Its unit is the mass of wheel
    1 at its rim, ``I1 / R1^2``, times the square of ``backlash1 omega``; between two loose wheels
    their reduced mass counts.
    """
    if gears is None or check_units(units, gears) == "dimensionless":
        return "", 1.0
    return physical_units(gears.units).get(kind_of(quantity), ("", 1.0))


def speed_text(speed: float, gears: Gears | None, units: str) -> str:
    """A dimensionless speed as text, with its unit."""
    unit, factor = unit_of("speed", gears, units)
    return f"{speed * factor:.3g} {unit}".rstrip()


def in_units(table: pd.DataFrame, gears: Gears | None, units: str) -> pd.DataFrame:
    """A table of stationary quantities or verdicts in a system of units, with a column ``unit``.

    The quantities are its column ``quantity``, or its index.
    """
    check_units(units, gears)
    if table.empty:
        return table
    names = table.get("quantity", table.index)
    symbols, factors = zip(*(unit_of(str(name), gears, units) for name in names), strict=True)
    out = table.copy()
    numeric = [name for name in NUMERIC if name in out]
    out[numeric] = out[numeric].mul(list(factors), axis=0)
    place = list(out).index("quantity") + 1 if "quantity" in out else 0
    out.insert(place, "unit", symbols)
    return out


@numpy_defaults
@dataclass(frozen=True)
class Stationary:
    """The stationary motion of a scene, from `stationary`.

    Attributes
    ----------
    scene : Scene
    kind : str
        ``simulated``, or ``rest`` or ``periodic`` for a motion without a random part, whose values
        are exact; ``rest`` also where noise moves nothing that is followed as an impact, with
        bounds of the rates.
    said : str
        What kind of motion it is, as a sentence.
    table : DataFrame
        Index ``quantity``; columns ``value, se, low, high`` (95 % interval), ``autocorrelation``
        (integrated, in impacts: the variance of the estimate over that of independent impacts) and
        ``se_batches`` (standard error from batch means, to check the other; NaN where there is
        none) and ``effective_paths`` (how many paths the standard error rests on, about all of them
        where nothing is rare; for quantiles, of the units that share a distribution).
    run : LongRun or None
        The simulation; None for exact values.
    orbit : Attractor
        Where the orbit without noise ends.
    slow : float
        Speed below which an impact is slow.
    closures : tuple of str
        Closures that `verdicts` judges.

    Examples
    --------
    >>> from rattle import DAT21, Scene, stationary
    >>> found = stationary(Scene.from_gears(DAT21, sigma=0.5), periods=64, paths=64, rng=7)
    >>> bool(found.table.loc["rate", "value"] > 0.0)
    True
    """

    scene: Scene
    kind: str
    said: str
    table: pd.DataFrame
    run: LongRun | None
    orbit: Attractor
    slow: float
    closures: tuple[str, ...]

    def __repr__(self) -> str:
        """The main quantities, on a few lines."""
        lines = [f"Stationary: {self.said}"]
        names = ["rate_above", "speed_above", "energy_per_period", "slow_share"]
        rows = self.table.reindex(names)[["value", "low", "high"]].dropna(subset="low")
        for name, value, low, high in rows.itertuples(name=None):
            lines.append(f"  {name} = {value:.5g} ± {0.5 * (high - low):.2g}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return as_html(repr(self), self.table.to_html(max_rows=12))

    @property
    def densities(self) -> tuple[SectionDensity, ...]:
        """Density of the section over phase and velocity at each mesh; empty for exact values."""
        return () if self.run is None else self.run.densities

    @property
    def few(self) -> pd.Series:
        """Quantities whose intervals are wide because their errors rest on few paths, with the
        number of these."""
        if self.run is None:
            return pd.Series(dtype=float)
        paths = self.table["effective_paths"].where(self.table["se"] > 0.0)
        units = len(self.run.sums.histogram)  # whose counts quantiles are taken from
        parts = np.where(paths.index.str.startswith("q"), units, self.run.paths)
        return paths[paths < np.minimum(LEAST_EFFECTIVE, LEAST_SHARE * parts)]

    @cached_property
    def laws(self) -> dict[str, Law | str]:
        """The stationary law of each closure, or the reason why it has none."""
        return laws(self.scene, self.closures, self.orbit)

    @cached_property
    def verdicts(self) -> pd.DataFrame:
        """The closures against the simulation, row by row, dimensionless."""
        if self.run is None:
            return pd.DataFrame()
        judged = judge_predictions(
            self.table, self.run.periods, predictions(self.laws, self.scene, self.slow)
        )
        if self.run.is_scattered:  # more gear sets decide, not longer paths
            judged["periods_needed"] = np.nan
        return judged

    @cached_property
    def scatter(self) -> pd.DataFrame:
        """The distribution over gear sets, dimensionless, where each has backlashes of its own;
        else empty.

        Columns ``quantity, percent, value, low, high, error_share``: quantiles over sets with 95 %
        intervals, and the share of the variance between paths that was taken off because it is the
        error of a path of finite length.
        """
        rows = []
        if self.run is not None and self.run.is_scattered:
            for (group, suffix), kind in product(groups(self.scene.stages), SCATTERED):
                values = values_of_sets(self.run.sums, kind, group)
                if values is None:
                    continue
                # a seed of its own: the result depends on nothing else
                quantiles = values.quantiles(np.random.SeedSequence(0))
                for percent, row in zip(SCATTER_PERCENT, quantiles.tolist(), strict=True):
                    rows.append((kind + suffix, percent, *row, values.error_share))
        columns = ["quantity", "percent", "value", "low", "high", "error_share"]
        return pd.DataFrame(rows, columns=columns)

    def scatter_in(self, units: str) -> pd.DataFrame:
        """`scatter` in a system of units, with a column ``unit``, as `table_in`."""
        return in_units(self.scatter, self.scene.gears, units)

    def table_in(self, units: str) -> pd.DataFrame:
        """`table` in physical units, for a scene that was made from gears.

        Parameters
        ----------
        units : {"physical", "dimensionless"}
            The units; the second gives `table` with a column of units.

        Returns
        -------
        DataFrame
            With a column ``unit``: impacts per s, ms, mm/s, mJ and mW.

        Raises
        ------
        InputError
            For unknown units, or a scene without gears.
        """
        return in_units(self.table, self.scene.gears, units)

    def figures(self) -> "dict[str, Figure]":
        """All figures of the page by name; none for exact values."""
        from rattle.compare.stationary.figures import draw

        if self.run is None:
            return {}
        units = usual_units(self.scene)
        sets = {}
        for name in DRAWN_OF_SETS if self.run.is_scattered else ():
            values = values_of_sets(self.run.sums, name, 0)
            if values is not None:
                sets[name] = values.corrected * unit_of(name, self.scene.gears, units)[1]
        return draw(self, self.scatter_in(units), sets)

    def plot(self, kind: str = "distribution") -> "Figure":
        """Draw a figure of the page.

        Parameters
        ----------
        kind : {"distribution", "section", "memory", "closures", "scatter"}
            Velocities before an impact, their density over the phase, autocorrelation times, errors
            of the closures, or the distribution over gear sets.

        Returns
        -------
        Figure
            Of matplotlib; a notebook shows it, ``savefig`` writes it.

        Raises
        ------
        InputError
            For an unknown kind, closures that predict nothing, or exact values.
        """
        figures = self.figures()
        if not figures:
            why = "nothing to draw: these values are exact, and there is no distribution"
            raise InputError("kind", kind, why)
        return figures[choice("kind", kind, figures)]

    def to_xarray(self, units: str = "dimensionless") -> "xr.Dataset":
        """Convert the table to a dataset; needs the optional dependency ``xarray``.

        Parameters
        ----------
        units : {"dimensionless", "physical"}
            Units of the quantities; the second for a scene that was made from gears.

        Returns
        -------
        xarray.Dataset
            Dimension ``statistic`` (``value, se, low, high, ...``), a variable for each quantity,
            with its unit in ``attrs["units"]``, "1" without one.

        Raises
        ------
        InputError
            For unknown units, or physical ones of a scene without gears.
        """
        table = self.table_in(units)
        data = table.drop(columns="unit").T.rename_axis("statistic").to_xarray()
        for name, unit in table["unit"].items():
            data[name].attrs["units"] = unit or plain_unit(str(name))
        return data

    def verdicts_in(self, units: str) -> pd.DataFrame:
        """`verdicts` in a system of units, with a column ``unit``, as `table_in`."""
        return in_units(self.verdicts, self.scene.gears, units)

    def to_dict(self, units: str = "dimensionless") -> Facts:
        """Everything but the section as plain data.

        Parameters
        ----------
        units : {"dimensionless", "physical"}
            Units of the quantities.

        Returns
        -------
        dict
        """
        run = self.run
        facts: Facts = {
            "kind": self.kind,
            "said": self.said,
            "slow": self.slow,
            "units": units,
            "threshold": [t._asdict() for t in rattle_threshold(self.scene)],
        }
        if run is not None:
            names = ("closed_share", "energy_share", "rate_above_at_most")
            facts |= {
                "paths": run.paths,
                "periods": run.periods,
                "impacts": run.impacts,
                "burn_in": run.burn_in.periods,
                "seconds": round(run.wall_seconds, 3),
                "reach": run.reach_sentence or None,
                "reached": run.reached,
                "settled": run.burn_in.reached,
                "resolve": run.quiet,
                "left_out": dict(zip(names, run.left_out, strict=True)),
            }
        table = self.table_in(units).reset_index().to_dict("records")
        scatter = self.scatter_in(units).to_dict("records")
        verdicts = self.verdicts_in(units).to_dict("records")
        return facts | {"table": table, "scatter": scatter, "verdicts": verdicts}
