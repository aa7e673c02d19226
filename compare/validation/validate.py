"""Validation of closures: compares them with an ensemble of the same scene and gives a verdict on every moment."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from rattle.closure import CLOSURES, MeanMap, closures_for, follow, mean_map
from rattle.compare.validation.correlation import mid_flight_errors, validity
from rattle.compare.validation.verdict import JUDGED, Tolerances, section_errors, to_absolute_time, widest
from rattle.montecarlo import SCHEMES, Ensemble, Record, check_settings, default_step, simulate
from rattle.scene.errors import InputError
from rattle.scene.moments import SECTION
from rattle.scene.scene import Scene
from rattle.scene.shown import as_html
from rattle.scene.units import with_units
from rattle.scene.validate import choice

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

__all__ = ["COLUMNS", "Validation", "validate"]

PILOT = 64  # paths of the pilot run that bounds the time of the last impact
MARGIN = 10.0  # the bound is this many times the pilot's time to its last impact; later fixed times are not compared

COLUMNS = (
    "closure",
    "kind",
    "impact",
    "time",
    "quantity",
    "moment",
    "predicted",
    "simulated",
    "se",
    "bias",
    "error",
    "low",
    "high",
    "unit",
    "tolerance",
    "verdict",
    "paths_needed",
    "agreement",
    "remark",
)


@dataclass(frozen=True)
class Validation:
    """Result of comparing closures with a simulation of the same scene.

    Attributes
    ----------
    scene : Scene
        The scene as given, in absolute time.
    predictions : dict of str to MeanMap
        The moments that each closure predicts, by its name.
    run : Ensemble
        The simulation.
    table : DataFrame
        Every moment of every closure with error, interval and verdict; the columns are ``COLUMNS``.
    correlation : DataFrame
        Validity of the correlation on both sides, see `rattle.compare.validation.correlation.validity`.
    z : float
        Standard errors of the intervals, corrected for the number of rows.
    tolerances : Tolerances

    Examples
    --------
    >>> from rattle import DAT21, Scene
    >>> v = validate(Scene.from_gears(DAT21, sigma=0.01), impacts=2, closures=["saltation"], paths=20_000, rng=7)
    >>> bool(v.counts.loc["saltation", "accurate"] > 0)
    True
    """

    scene: Scene
    predictions: dict[str, MeanMap]
    run: Ensemble
    table: pd.DataFrame
    correlation: pd.DataFrame
    z: float
    tolerances: Tolerances

    @property
    def accurate(self) -> bool:
        """Whether all moments that are predicted and judged are accurate; the rule is in ``verdict.RULE``."""
        judged = self.table[self.table["verdict"].isin(JUDGED)]
        return bool((judged["verdict"] == "accurate").all())

    @property
    def counts(self) -> pd.DataFrame:
        """Number of predicted and judged moments with each verdict, by closure."""
        verdicts = self.table.groupby("closure", sort=False)["verdict"].value_counts().unstack(fill_value=0)
        return verdicts.reindex(index=list(self.predictions), columns=list(JUDGED), fill_value=0)

    def __repr__(self) -> str:
        """What was compared, and the verdicts, on a few lines."""
        run, counts = self.run, self.counts
        lines = [
            f"Validation: {run.paths:,} paths, {run.impacts} impacts, sigma = {self.scene.sigma:.4g}, {run.scheme}",
            *(
                f"  {closure}: {good} of {good + bad + undecided} moments accurate, {bad} inaccurate, "
                f"{undecided} undecided"
                for closure, (good, bad, undecided) in zip(counts.index, counts.to_numpy().tolist(), strict=True)
            ),
        ]
        return "\n".join(lines + [f"  {sentence}" for sentence in run.diagnostics])

    def _repr_html_(self) -> str:
        return as_html(repr(self).split("\n")[0], self.counts.to_html())

    def plot(self, kind: str = "errors") -> "Figure":
        """Draw a figure of the report.

        Parameters
        ----------
        kind : {"errors", "correlation", "section"}
            Errors of the moments per impact, correlations of displacement and velocity, or densities of velocities.

        Returns
        -------
        Figure
            Of matplotlib; a notebook shows it, ``savefig`` writes it.

        Raises
        ------
        InputError
            For an unknown kind, or one that these closures have nothing for.

        Examples
        --------
        >>> from rattle.scene import DAT21, Scene
        >>> v = validate(Scene.from_gears(DAT21, sigma=0.01), impacts=1, closures=["saltation"], paths=1000)
        >>> len(v.plot("errors").axes)
        6
        """
        from rattle.compare.validation.figures import FIGURES

        drawn = FIGURES[choice("kind", kind, FIGURES)]
        if not drawn.suits(self):
            raise InputError("kind", kind, "needs a closure with moments of a perturbation, which branching has not")
        return drawn.draw(self)

    def to_xarray(self) -> "xr.Dataset":
        """Convert the section moments of closures and simulation to a dataset.

        Needs the optional dependency ``xarray``.

        Returns
        -------
        xarray.Dataset
            Dimensions ``closure, impact, quantity, moment``; ``["quantity"].attrs`` holds the unit of each quantity.

        Examples
        --------
        >>> from rattle.scene import DAT21, Scene
        >>> v = validate(Scene.from_gears(DAT21, sigma=0.01), impacts=1, closures=["saltation"], paths=1000)
        >>> v.to_xarray()["verdict"].dims
        ('closure', 'impact', 'quantity', 'moment')
        """
        rows = self.table[self.table["kind"] == "section"].drop(columns=["kind", "time"])
        return with_units(rows.set_index(["closure", "impact", "quantity", "moment"]).to_xarray())

    def report(self, folder: str | Path, *, overwrite: bool = False) -> Path:
        """Write the report of this validation, as ``rattle validate`` does.

        Parameters
        ----------
        folder : str or Path
            Where to; made if it is missing.
        overwrite : bool
            Whether an earlier report there may be replaced.

        Returns
        -------
        Path
            The page, ``report.html``.

        Raises
        ------
        OutputError
            If the folder holds other files, or an earlier report that may not be replaced.
        """
        from rattle.compare.validation.page import write_one

        return write_one(self, Path(folder), overwrite)


def validate(
    scene: Scene,
    *,
    impacts: int = 12,
    closures: Sequence[str] | None = None,
    paths: int = 256_000,
    dt: float | None = None,
    scheme: str = "exact-flight",
    rng: int | np.random.SeedSequence = 0,
    workers: int = 1,
    order: int = 4,
    tolerances: Tolerances | None = None,
    progress: str | None = None,
) -> Validation:
    """Compare closures with a Monte Carlo simulation of the same scene.

    Parameters
    ----------
    scene : Scene
        The system, its noise and its start.
    impacts : int
        Number of impacts after the start that are compared.
    closures : sequence of str, optional
        Names of the closures; by default all that can be applied to the scene.
    paths, dt, scheme, rng, workers, progress
        Settings of the simulation, see `rattle.montecarlo.simulate`.  If the scheme has a step bias, 2 dt and 4 dt run
        on the same Brownian paths to measure it; if it has none, the linearised path may serve as control variate.
    order : int
        Order of the closures' moments.
    tolerances : Tolerances, optional
        What counts as accurate: 5 % of an sd for means, 10 % for sds, 0.05 for correlations.

    Returns
    -------
    Validation

    Raises
    ------
    InputError
        For any setting that cannot be run; nothing has started then.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> v = validate(Scene.from_gears(DAT21, sigma=0.01), impacts=2, closures=["saltation"], paths=20_000, rng=7)
    >>> row = v.table.query("quantity == 'tau' and moment == 'mean' and impact == 1").iloc[0]
    >>> row["verdict"], bool(row["low"] < 0.0 < row["high"])
    ('accurate', True)
    """
    if not isinstance(scene, Scene):
        raise InputError("scene", scene, "give a Scene")
    closures = closures_for(scene) if closures is None else closures
    if not isinstance(closures, list | tuple) or not closures:
        raise InputError("closures", closures, "give a list of " + ", ".join(CLOSURES))
    for closure in closures:
        choice("closures", closure, CLOSURES)
    limits = tolerances or Tolerances()
    # both sides are computed phase-reduced, so that a late start loses no digits of the times that are compared
    given, scene = scene, scene.phase_reduced
    biased = SCHEMES[choice("scheme", scheme, SCHEMES)].has_step_bias
    dt = default_step(scene, scheme, biased) if dt is None else dt
    check_settings(
        scene, paths=paths, impacts=impacts, dt=dt, scheme=scheme, rng=rng, workers=workers, step_bias=biased
    )
    predictions = {c: mean_map(scene, impacts=impacts, closure=c, order=order) for c in dict.fromkeys(closures)}
    orbit = follow(scene, impacts)
    tau = orbit.tau[: orbit.found + 1]
    grid = (4.0 if biased else 1.0) * dt  # fixed times are rounded to it; a flight shorter than it may contain none
    middle = (0.5 * (tau[1:] + tau[:-1]))[np.diff(tau) > grid]
    last = _last_impact(scene, impacts=impacts, dt=dt, scheme=scheme, rng=rng)
    run = simulate(
        scene,
        paths=paths,
        impacts=impacts,
        dt=dt,
        scheme=scheme,
        rng=rng,
        workers=workers,
        control=not biased and tau[-1] <= last,
        progress=progress,
        record=Record(
            step_bias=biased,
            histogram=True,
            energy=scene.gears is not None,
            times=middle[(middle - scene.phase > grid) & (middle <= last)],
            itineraries={name: m.itinerary for name, m in predictions.items()},
        ),
    )
    # the impact that ends the flight of each fixed time
    flights = np.searchsorted(tau, run.at_times().index.to_numpy(float))
    per_impact = len(SECTION) * 2 + 2 if scene.stages == 2 else (len(SECTION) - 2) * 2 + 1
    z = widest(per_impact * impacts * len(predictions))
    parts = [section_errors(m, run, z, limits) for m in predictions.values()]
    if scene.sigma > 0.0 and len(run.at_times()):
        parts += [mid_flight_errors(m, run, flights, z, limits) for m in predictions.values()]
    table = pd.concat(parts, ignore_index=True).reindex(columns=list(COLUMNS))
    table["remark"] = table["remark"].fillna("")
    valid = validity(list(predictions.values()), run, flights)
    predictions = {name: replace(m, scene=given) for name, m in predictions.items()}
    return Validation(
        given,
        predictions,
        replace(run, plan=run.plan._replace(scene=given)),
        to_absolute_time(table, given),
        valid,
        z,
        limits,
    )


def _last_impact(scene: Scene, **settings: Any) -> float:
    """Generous upper bound of the time of every path's last impact, from a pilot run; at most when paths are abandoned.

    If the noise-free orbit flies much longer than the paths do, nothing can be compared at its later times, and
    simulating up to them may take millions of steps.
    """
    pilot = simulate(scene, paths=PILOT, **settings)
    at, horizon = pilot.section.iloc[-1], scene.phase + (pilot.plan.most_steps - 1) * pilot.dt
    latest = scene.phase + MARGIN * (at["tau"] + 6.0 * at["sd_tau"] - scene.phase)
    return float(min(horizon, math.inf if math.isnan(latest) else latest))
