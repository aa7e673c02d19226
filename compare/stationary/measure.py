"""The public entry: the stationary motion of a scene, simulated or, where nothing is random, exact."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from rattle.closure.attractor import IRREGULAR, PERIODIC, Attractor, attractor
from rattle.closure.stationary import Law
from rattle.compare.stationary.laws import law_of, values_of
from rattle.compare.stationary.units import PLAIN, in_units, kind_of
from rattle.compare.stationary.verdicts import CLOSURES_JUDGED, judge_predictions, laws, predictions
from rattle.montecarlo.long_run import AtRest, BurnInError, LongRun, SectionDensity, long_run
from rattle.montecarlo.long_run.run import ASKED, PATHS
from rattle.montecarlo.settings.plan import is_random
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.shown import as_html
from rattle.scene.validate import choice

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

__all__ = ["Stationary", "stationary"]

LEAST_EFFECTIVE = 16.0
"""Effective paths below which an interval is a tenth wider for that, or more."""
LEAST_SHARE = 0.25  # of the paths, where there are few
STARTS = 12  # orbits that are followed to find the attractors of a scene without noise
COLUMNS = ["value", "se", "low", "high", "autocorrelation", "se_batches", "effective_paths"]


@dataclass(frozen=True)
class Stationary:
    """The stationary motion of a scene, from `stationary`.

    Attributes
    ----------
    scene : Scene
    kind : str
        ``simulated``, or ``rest`` or ``periodic`` for a motion without a random part, whose values are exact.
    said : str
        What kind of motion it is, as a sentence.
    table : DataFrame
        Index ``quantity``; columns ``value, se, low, high`` (95 % interval), ``autocorrelation`` (integrated, in
        impacts: the variance of the estimate over that of independent impacts) and ``se_batches`` (standard error from
        batch means, to check the other; NaN where there is none) and ``effective_paths`` (how many paths the standard
        error rests on, about all of them where nothing is rare; for quantiles, of the units that share a distribution).
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
    >>> from rattle import DAT21, Scene
    >>> found = stationary(Scene.from_gears(DAT21, sigma=0.5), periods=64, paths=64, rng=7)
    >>> bool(found.table.loc["rate", "value"] > 0.0)
    True
    """

    scene: Scene
    kind: str
    said: str
    table: pd.DataFrame = field(repr=False)
    run: LongRun | None
    orbit: Attractor = field(repr=False)
    slow: float
    closures: tuple[str, ...]

    def __repr__(self) -> str:
        """The main quantities, on a few lines."""
        shown = [n for n in ("rate_above", "speed_above", "energy_per_period", "slow_share") if n in self.table.index]
        lines = [f"Stationary: {self.said}"]
        for name in shown:
            row = self.table.loc[name]
            lines.append(f"  {name} = {row['value']:.5g} ± {0.5 * (row['high'] - row['low']):.2g}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return as_html(repr(self), self.table.to_html(max_rows=12))

    @property
    def densities(self) -> tuple[SectionDensity, ...]:
        """Density of the section over phase and velocity at each mesh; empty for exact values."""
        return () if self.run is None else self.run.densities

    @property
    def few(self) -> pd.Series:
        """Quantities whose intervals are wide because their errors rest on few paths, with the number of these."""
        if self.run is None:
            return pd.Series(dtype=float)
        own = self.table["effective_paths"].where(self.table["se"] > 0.0)
        units = len(self.run.sums.histogram)  # whose counts quantiles are taken from
        parts = np.where(own.index.astype(str).str.startswith("q"), units, self.run.paths)
        return own[own < np.minimum(LEAST_EFFECTIVE, LEAST_SHARE * parts)]

    @cached_property
    def laws(self) -> dict[str, Law | str]:
        """The stationary law of each closure, or the reason why it has none."""
        return laws(self.scene, self.closures, self.orbit)

    @cached_property
    def verdicts(self) -> pd.DataFrame:
        """The closures against the simulation, row by row, dimensionless."""
        if self.run is None:
            return pd.DataFrame()
        return judge_predictions(self.table, self.run.periods, predictions(self.laws, self.scene, self.slow))

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

        return {} if self.run is None else draw(self.run, self.table, self.laws, self.verdicts)

    def plot(self, kind: str = "distribution") -> "Figure":
        """Draw a figure of the page.

        Parameters
        ----------
        kind : {"distribution", "section", "memory", "closures"}
            Velocities before an impact, their density over the phase, autocorrelation times, or errors of the closures.

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
            raise InputError("kind", kind, "nothing to draw: these values are exact, and there is no distribution")
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
            Dimension ``statistic`` (``value, se, low, high, ...``), a variable for each quantity, with its unit in
            ``attrs["units"]``, "1" without one.

        Raises
        ------
        InputError
            For unknown units, or physical ones of a scene without gears.
        """
        table = self.table_in(units)
        data = table.drop(columns="unit").T.rename_axis("statistic").to_xarray()
        for name, unit in table["unit"].items():
            data[name].attrs["units"] = unit or PLAIN.get(kind_of(str(name)), "1")
        return data

    def verdicts_in(self, units: str) -> pd.DataFrame:
        """`verdicts` in a system of units, with a column ``unit``, as `table_in`."""
        return in_units(self.verdicts, self.scene.gears, units) if len(self.verdicts) else self.verdicts

    def to_dict(self, units: str = "dimensionless") -> dict[str, Any]:
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
        facts: dict[str, Any] = {"kind": self.kind, "said": self.said, "slow": self.slow, "units": units}
        if run is not None:
            facts |= {
                "paths": run.paths,
                "periods": run.periods,
                "impacts": run.impacts,
                "burn_in": run.burn_in.periods,
                "seconds": round(run.wall_seconds, 3),
                "reach": None if run.reach is None else run.reach.sentence,
                "reached": run.reach is None or run.reach.reached,
            }
        table = self.table_in(units).reset_index().to_dict("records")
        return facts | {"table": table, "verdicts": self.verdicts_in(units).to_dict("records")}


def stationary(
    scene: Scene,
    *,
    accuracy: float | None = None,
    periods: int | None = None,
    quantities: Sequence[str] = ASKED,
    paths: int = PATHS,
    burn_in: int | None = None,
    slow: float = 0.1,
    budget: float | None = None,
    closures: Sequence[str] = tuple(CLOSURES_JUDGED),
    rng: int | np.random.SeedSequence = 0,
    workers: int = 1,
    progress: str | None = None,
) -> Stationary:
    """The stationary motion of a scene: rates, speeds, energies, and the share of slow impacts, with their errors.

    Where teeth chatter, most impacts are too slow to matter: ``rate_above`` and ``speed_above`` are of impacts that are
    not slow.

    Parameters
    ----------
    scene : Scene
        What is modelled.
    accuracy : float, optional
        Largest half width of the 95 % intervals of `quantities`, over their value; 0.01 by default.
    periods : int, optional
        Periods of the excitation on each path after the burn-in, in place of an accuracy.
    quantities : sequence of str
        Quantities that the accuracy is for.
    paths : int
        Independent paths, 16 or more.
    burn_in : int, optional
        Periods to leave out before; found by tests by default.
    slow : float
        Speed below which an impact counts as slow.
    budget : float, optional
        Seconds of processor time that the simulation may take, all threads together; compiling is not counted.  Without
        it, what is expected to take more than an hour is refused.
    closures : sequence of str
        Closures that `Stationary.verdicts` judges; computed when that is asked for.
    rng : int or SeedSequence
        Seed.  The result is the same bit for bit for any number of workers.
    workers : int
        Threads.
    progress : str, optional
        Label of a progress bar on a terminal.

    Returns
    -------
    Stationary
        Exact values where nothing is random and the motion comes to rest or is periodic.

    Raises
    ------
    InputError
        For a setting that cannot be run.
    BurnInError
        If the motion does not forget its start: says how long the burn-in must be; without noise, which attractors
        there are.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> found = stationary(Scene.from_gears(DAT21, sigma=0.5), periods=64, paths=64)
    >>> found.kind, bool(found.table.loc["rate", "se"] < 0.02)
    ('simulated', True)
    """
    if not isinstance(scene, Scene):
        raise InputError("scene", scene, "give a Scene")
    named = tuple(dict.fromkeys(choice("closures", name, CLOSURES_JUDGED) for name in closures))
    own = attractor(scene)
    if not is_random(scene) and (exact := _exact(scene, own, slow, named)) is not None:
        return exact
    try:
        run = long_run(
            scene,
            accuracy=accuracy,
            periods=periods,
            quantities=quantities,
            paths=paths,
            burn_in=burn_in,
            slow=slow,
            budget=budget,
            rng=rng,
            workers=workers,
            progress=progress,
        )
    except AtRest:
        return _resting(scene, own, slow, named)
    except BurnInError as refused:
        kinds = _attractors(scene, own)
        if len(kinds) == 1:
            raise
        raise BurnInError(
            "burn_in", refused.value, f"{refused.remedy}. Without noise, {_list(kinds, scene)}"
        ) from refused
    rows = [tuple(e) for e in run.estimates.values()]
    table = pd.DataFrame(rows, columns=COLUMNS, index=pd.Index(run.estimates, name="quantity"))
    said = (
        f"{run.impacts:,} impacts on {run.paths} paths of {run.periods:,} periods each, after a burn-in of "
        f"{run.burn_in.periods:,}; the orbit without noise {own.reason}."
    )
    return Stationary(scene, "simulated", said, table, run, own, slow, named)


def _exact_table(values: dict[str, float]) -> pd.DataFrame:
    value = np.array(list(values.values()))
    se = np.where(np.isnan(value), np.nan, 0.0)
    table = pd.DataFrame({"value": value, "se": se, "low": value, "high": value}, index=pd.Index(values))
    return table.assign(autocorrelation=np.nan, se_batches=np.nan, effective_paths=np.nan).rename_axis("quantity")[
        COLUMNS
    ]


def _resting(scene: Scene, a: Attractor, slow: float, closures: tuple[str, ...]) -> Stationary:
    """A motion without impacts."""
    none = ("rate_above", "rate", "energy_per_period", "power")
    zero = {f"{name}{s}": 0.0 for name in none for s in _suffixes(scene)}
    contact = {f"contact_share_mesh{m}": a.contact[m - 1] for m in range(1, scene.stages + 1)}
    said = f"At rest: the motion {a.reason}; there are no impacts and no energy is lost."
    return Stationary(scene, "rest", said, _exact_table(zero | contact), None, a, slow, closures)


def _suffixes(scene: Scene) -> tuple[str, ...]:
    return ("", "_mesh1", "_mesh2") if scene.stages == 2 else ("",)


def _exact(scene: Scene, own: Attractor, slow: float, closures: tuple[str, ...]) -> Stationary | None:
    """The exact values of a scene in which nothing is random; None if it is irregular from every start."""
    kinds = _attractors(scene, own)
    if len(kinds) > 1:
        raise BurnInError(
            "sigma",
            scene.sigma,
            "several attractors without noise, so that there is no one stationary motion: "
            f"{_list(kinds, scene)}; that of the scene's own start is the first. Give noise that connects them",
        )
    if own.kind == IRREGULAR:
        return None
    if own.kind != PERIODIC:
        return _resting(scene, own, slow, closures)
    values = values_of(law_of(own), scene, slow, own.contact)
    said = f"Exact: without noise the motion {own.reason}."
    if own.sticks:
        said += " Completed chatter has infinitely many impacts; those are counted up to which it is followed."
    return Stationary(scene, "periodic", said, _exact_table(values), None, own, slow, closures)


def _attractors(scene: Scene, own: Attractor) -> list[tuple[Attractor, int]]:
    """The attractors without noise, that of the scene's own start first, and how many starts each has drawn."""
    kinds: list[tuple[Attractor, int]] = []
    for end in (own, *(attractor(scene, n) for n in range(1, STARTS))):
        for i, (known, times) in enumerate(kinds):
            if known.same(end):
                kinds[i] = known, times + 1
                break
        else:
            kinds.append((end, 1))
    return kinds


def _list(kinds: list[tuple[Attractor, int]], scene: Scene) -> str:
    shares = (f"the motion of {times / STARTS:.0%} {a.reason}{_describe(a, scene)}" for a, times in kinds)
    return f"of {STARTS} starts, {'; '.join(shares)}"


def _describe(a: Attractor, scene: Scene) -> str:
    if a.kind != PERIODIC:
        return ""
    found = values_of(law_of(a), scene, 0.1)
    return f" (rate {found['rate']:.4g}, energy per period {found['energy_per_period']:.4g})"
