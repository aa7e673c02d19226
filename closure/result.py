"""What a closure predicts: its moments by impact and at fixed times, where they break down, and its
densities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rattle.closure.closure import Closure, moment_names
from rattle.closure.edgeworth import (
    Edgeworth,
    coefficients,
    has_series,
    mixture_density,
    section_density,
)
from rattle.closure.moments import Trace, advice, largest_error, within
from rattle.scene import Floats, InputError, Scene, choice, count, section_names, state_names
from rattle.scene.moments import (
    RHO_ROUNDING,
    SMALLEST_DIVISOR,
    Realizability,
    correlation,
    realizability,
)
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.section_result import SectionResult
from rattle.scene.units import at_times_in, check_units

if TYPE_CHECKING:  # tables are made when they are asked for, see `SectionResult`
    import pandas as pd


DEFAULT_TOLERANCE = 0.05
"""Error of a mean, in sds, above which a bound says "simulate" where no tolerance is given; twice
that of an sd."""

IMPACTS_SHOWN = 12  # impacts of an itinerary that a repr shows


class Breakdown(NamedTuple):
    """The first impact at which predicted moments are not realizable.

    Attributes
    ----------
    impact : int
        Its number.
    stage : int
        Number of the gap, 1 to the number of wheels; 0 if the mean flight time is negative.
    reason : str
        What fails.

    Examples
    --------
    >>> from rattle import DAT21, Scene, mean_map
    >>> found = mean_map(
    ...     Scene.from_gears(DAT21, sigma=0.1), impacts=4, closure="published"
    ... ).breakdown
    >>> found.impact, found.stage
    (2, 1)
    """

    impact: int
    stage: int
    reason: str


@numpy_defaults
@dataclass(frozen=True)
class MeanMap(SectionResult):
    """Prediction of a closure, from `mean_map`.

    Attributes
    ----------
    scene, impacts, order
        Arguments of `mean_map`.
    method : Closure
        The closure; ``closure`` is its name.
    trace : Trace
        The arrays behind the tables, in local time.
    tolerance : float, optional
        Argument of `mean_map`.

    Examples
    --------
    >>> from rattle import DAT21, Scene, mean_map
    >>> orbit = mean_map(Scene.from_gears(DAT21, sigma=0.01), impacts=2, closure="saltation")
    >>> orbit.section[["tau", "sd_tau"]].round(4).loc[1].tolist()
    [0.56, 0.0002]
    """

    scene: Scene
    method: Closure
    impacts: int
    order: int
    trace: Trace
    tolerance: float | None = None
    # what a closure of one's own is asked at fixed times of, where `scene` is phase-reduced
    given: Scene | None = None

    def __repr__(self) -> str:
        """What was predicted, on a few lines."""
        shown = " ".join(f"{code:+d}" for code in self.itinerary[:IMPACTS_SHOWN]) + " ..." * (
            self.impacts > IMPACTS_SHOWN
        )
        broken = self.breakdown
        where = ""
        if broken is not None:
            where = f" from impact {broken.impact} on" + f", stage {broken.stage}" * (
                broken.stage > 0
            )
        lines = [
            (
                f"MeanMap: {self.closure}, order {self.order}, impacts 1 to {self.impacts}, sigma ="
                f" {self.scene.sigma:.4g}"
            ),
            f"  itinerary (mesh * side): {shown}",
            (
                "  moments are realizable"
                if broken is None
                else f"  moments are not realizable{where}: {broken.reason}"
            ),
        ]
        lines += [f"  {self.advice}"] * bool(self.advice)
        return "\n".join(lines + [f"  ended: {self.stopped}"] * bool(self.stopped))

    @property
    def closure(self) -> str:
        """Name of the closure."""
        return self.method.name

    @cached_property
    def phase_reduced(self) -> MeanMap:
        """The same result for `Scene.phase_reduced`: tau is in local time, with full precision for
        a late start."""
        reduced = self.scene.phase_reduced
        return self if reduced is self.scene else replace(self, scene=reduced, given=self.scene)

    @property
    def advice(self) -> str:
        """Whether to use the closure or to simulate, by the bound of its errors; empty for a
        closure without one."""
        return "" if self.trace.error is None else advice(self.trace, self._asked)

    @property
    def _asked(self) -> float:
        """The tolerance, or the one that is taken where none is given."""
        return DEFAULT_TOLERANCE if self.tolerance is None else self.tolerance

    @property
    def stopped(self) -> str:
        """Why the closure ended before the last impact requested, or an empty string."""
        return self.trace.stopped

    @property
    def itinerary(self) -> tuple[int, ...]:
        """``mesh * side`` of impacts 1, 2, ...: +1, -1, +2, -2, ..., and 0 where the closure has
        ended."""
        return tuple(
            int(m * s) for m, s in zip(self.trace.mesh[1:], self.trace.side[1:], strict=True)
        )

    def on_itinerary(self) -> MeanMap:
        """The same prediction for the paths alone that have followed the closure's itinerary up to
        each impact.

        ``branching`` tells them from the others: by its components that have.  Every other closure
        follows one itinerary and predicts one set of moments, which is taken for theirs.

        Returns
        -------
        MeanMap
            `Ensemble.on_itinerary` has the simulated moments to it.

        Examples
        --------
        >>> from rattle import DAT21, Scene, mean_map
        >>> every = mean_map(Scene.from_gears(DAT21, sigma=0.1), impacts=3, closure="branching")
        >>> bool(every.on_itinerary().section["sd_y2"][3] < 0.9 * every.section["sd_y2"][3])
        True
        """
        if self.trace.followed is None:
            return self
        mean, sd, skew = self.trace.followed
        followed = {
            "tau": mean[:, 0],
            "flight": mean[:, 1],
            "mean": mean[:, 2:],
            "sd": sd,
            "skew": skew,
        }
        return replace(self, trace=replace(self.trace, error=None, **followed))

    def stage_covariance(self, impact: int, stage: int) -> Floats:
        """Covariance of displacement and velocity in a gap just before an impact.

        Parameters
        ----------
        impact : int
            Number of the impact; 0 is the start.
        stage : int
            Number of the gap, from 1 on.

        Returns
        -------
        ndarray, shape (2, 2)
            NaN where the closure has none.
        """
        j = 2 * (stage - 1)
        return self.trace.covariance[impact, j : j + 2, j : j + 2]

    def stage_realizability(self, impact: int, stage: int) -> Realizability:
        """Whether a distribution can have the second moments of a gap; of one's own closure, those
        it predicts."""
        covariance = self.stage_covariance(impact, stage)
        t = self.trace
        if t.rho is None:
            return realizability(covariance)
        rho = float(t.rho[impact, stage - 1])
        times = section_names(0) if stage == 1 else ()
        checked = (*times, f"x{stage}", f"y{stage}")
        sds = dict(zip(self._quantities, t.sd[impact], strict=True))
        reasons = [f"sd of {name} = {sds[name]:.3g} < 0" for name in checked if sds[name] < 0.0]
        reasons += [f"|rho| = {abs(rho):.4g} > 1"] * (abs(rho) > 1.0 + RHO_ROUNDING)
        vx, vy = covariance.diagonal()
        return Realizability(
            not reasons, ", ".join(reasons), float(vx), float(vy), rho, float("nan")
        )

    @property
    def _quantities(self) -> tuple[str, ...]:
        """The section quantities, in the order of the trace."""
        return section_names(self.trace.wheels)

    @property
    def _gaps_judged(self) -> range:
        """Numbers of the gaps whose second moments are judged: those of a mixture are always
        realizable."""
        return range(1, self.trace.wheels + 1 if self.trace.parts is None else 1)

    @cached_property
    def breakdown(self) -> Breakdown | None:
        """The first impact at which the moments are not realizable, or None; those of a mixture
        always are."""
        broken = (self._break_at(k) for k in range(1, self.trace.found + 1))
        return next(filter(None, broken), None)

    def _break_at(self, impact: int) -> Breakdown | None:
        """What is not realizable at an impact, or None."""
        for stage in self._gaps_judged:
            judged = self.stage_realizability(impact, stage)
            if not judged.realizable:
                return Breakdown(impact, stage, judged.reason)
        flight = float(self.trace.tau[impact] - self.trace.tau[impact - 1])
        if flight < 0.0:
            return Breakdown(impact, 0, f"mean time of flight = {flight:.3g} < 0")
        return None

    @cached_property
    def section(self) -> pd.DataFrame:
        """Moments of the state just before impact 1, 2, ... (dimensionless); NaN where the closure
        predicts none.

        Columns: ``tau, flight, mesh, side, x1, y1, x2, y2, ...``, ``sd_`` and ``skew_`` of each
        quantity, ``rho1, rho2, ...`` (correlation of displacement and velocity perturbation in a
        gap) and ``realizable`` (false also for a negative mean flight time); for ``branching`` also
        ``agreement``, the predicted share of paths that have followed the orbit's itinerary so far,
        ``discarded``, the probability discarded so far, ``error_mean`` and ``error_sd``, the bounds
        of the errors of the worst mean and the worst sd in sds (by quantity in `errors`; the
        displacement of the struck mesh is left out), and ``within``, whether they are within the
        tolerance (0.05 if none was given; twice that for sds).  ``tau`` is in absolute time.

        ``saltation`` and ``branching`` predict the state that each path has just before its own
        k-th impact (a Poincaré section at the impacts), as simulation samples it.  ``published``
        and ``corrected`` approximate it by the state at one impact time for all paths.
        """
        import pandas as pd

        t = self.trace
        flight = np.diff(t.tau) if t.flight is None else t.flight[1:]
        columns: dict[str, object] = {
            "tau": self.scene.to_absolute_time(t.tau[1:]),
            "flight": flight,
        }
        columns |= {"mesh": t.mesh[1:], "side": t.side[1:]}
        columns |= {name: t.mean[1:, i] for i, name in enumerate(state_names(t.wheels))}
        columns |= {f"sd_{name}": t.sd[1:, i] for i, name in enumerate(self._quantities)}
        columns |= {f"skew_{name}": t.skew[1:, i] for i, name in enumerate(self._quantities)}
        impacts = range(1, self.impacts + 1)
        for stage in range(1, t.wheels + 1):
            rho = [correlation(self.stage_covariance(k, stage)) for k in impacts]
            columns[f"rho{stage}"] = rho if t.rho is None else t.rho[1:, stage - 1]
        columns["realizable"] = [k <= t.found and self._break_at(k) is None for k in impacts]
        table = pd.DataFrame(columns, index=pd.RangeIndex(1, self.impacts + 1, name="impact"))
        if t.agreement is not None and t.discarded is not None:
            table["agreement"] = t.agreement[1:]
            table["discarded"] = t.discarded[1:]
        if t.error is not None:
            table["error_mean"], table["error_sd"] = (
                [largest_error(e[i]) for e in t.error[1:]] for i in (0, 1)
            )
            table["within"] = within(t.error, self._asked)[1:]
            table.loc[t.found + 1 :, "within"] = False
        return table

    @property
    def errors(self) -> pd.DataFrame | None:
        """The closure's bounds of its errors by impact and quantity, ``mean`` and ``sd`` in sds;
        None without."""
        import pandas as pd

        if self.trace.error is None:
            return None
        index = pd.MultiIndex.from_product(
            [range(1, self.impacts + 1), self._quantities], names=["impact", "quantity"]
        )
        table = pd.DataFrame(
            self.trace.error[1:].transpose(0, 2, 1).reshape(-1, 2), index, ["mean", "sd"]
        )
        return table.dropna()

    @property
    def _title(self) -> str:
        return self.closure

    def at_times(
        self, times: Sequence[float] | Floats, units: str = "dimensionless"
    ) -> pd.DataFrame:
        """Means, covariances and ``rho1, rho2, ...`` of the state at fixed times between the start
        and the last impact.

        Parameters
        ----------
        times : sequence of float
            Absolute times, dimensionless.
        units : {"dimensionless", "physical"}
            Units of the table; the second for a scene that was made from gears.

        Returns
        -------
        DataFrame
            Index ``time``; columns ``x1, y1, x2, y2, ...``, ``cov_x1_x1, cov_x1_y1, ...`` and
            ``rho1, rho2, ...``.  In physical units index ``time_ms`` and columns ``x1_mm,
            y1_mm_per_s, ..., cov_x1_x1_mm2, cov_x1_y1_mm2_per_s, ...``. ``branching`` counts every
            path on the flight on which it is at that time, whichever that is; NaN where the flights
            that it follows (twice as many as impacts, and eight) do not hold nearly all paths.

        Raises
        ------
        InputError
            If a time lies outside the times followed, for unknown units, or physical ones of a
            scene without gears.

        Examples
        --------
        >>> from rattle import DAT21, Scene, mean_map
        >>> m = mean_map(Scene.from_gears(DAT21, sigma=0.1), impacts=1)
        >>> m.at_times(
        ...     [0.3], units="physical"
        ... )[["x1_mm", "y1_mm_per_s"]].round(3).reset_index().loc[0].tolist()
        [1.0, -0.006, -106.119]

        At the mean time of an impact half of the paths have had it: their velocities have two
        signs.

        >>> m = mean_map(Scene.from_gears(DAT21, sigma=0.01), impacts=2, closure="branching")
        >>> at = m.at_times([m.section["tau"].loc[1]])
        >>> at[["x1", "y1"]].assign(sd_y1=at["cov_y1_y1"] ** 0.5).round(2).to_numpy().tolist()
        [[-0.5, -0.09, 1.75]]
        """
        import pandas as pd

        check_units(units, self.scene.gears)
        asked = _as_list(times)
        index = pd.Index(asked, dtype=float, name="time")
        local = [self.scene.to_local_time(time) for time in asked]
        if self.method.own:
            given = self.given or self.scene
            table = self.method.fixed_times(
                given, [given.to_absolute_time(time) for time in local]
            ).set_axis(index)
            return at_times_in(table, self.scene.gears, units)
        low, high = self.trace.span
        for time, own in zip(asked, local, strict=True):
            if not low <= own <= high:
                followed = (
                    f"{self.scene.to_absolute_time(low):g} to {self.scene.to_absolute_time(high):g}"
                )
                raise InputError("times", time, f"lies outside the times followed, {followed}")
        rows = [row_of_moments(*self.trace.at(own)) for own in local]
        table = pd.DataFrame(
            rows, index=index, columns=moment_names(self.trace.wheels), dtype=float
        )
        return at_times_in(table, self.scene.gears, units)

    def density(self, impact: int, quantity: str, values: Floats) -> Floats | None:
        """Density that the closure predicts for a section quantity at an impact.

        From the mean, sd and skewness.  ``branching`` has the density of its mixture, and
        ``published`` the velocity marginals of its bivariate Edgeworth series, around its mean.

        Parameters
        ----------
        impact : int
            Number of the impact, from 1 on.
        quantity : str
            One of ``tau, flight, x1, y1, x2, y2, ...``.
        values : ndarray
            Where to evaluate it; tau in local time (`Scene.phase`).

        Returns
        -------
        ndarray or None
            Density at `values`; None where the closure predicts none.

        Raises
        ------
        InputError
            For an unknown quantity or an impact that was not requested.
        """
        i = self._quantities.index(choice("quantity", quantity, self._quantities))
        count("impact", impact, least=1, most=self.impacts)
        if impact > self.trace.found or self.trace.sd[impact, i] ** 2 < SMALLEST_DIVISOR:
            # the displacement at the wall that is struck is one value, which has no density
            return None
        if self.trace.parts is not None:
            weights, means, variances = (
                a if a.ndim == 1 else a[:, i] for a in self.trace.parts[impact]
            )
            return mixture_density(values, weights, means, variances)
        skew = float(self.trace.skew[impact, i])
        sd = float(self.trace.sd[impact, i])
        if np.isfinite(self.trace.sd[impact, 0]) and np.isnan(self.trace.skew[impact]).all():
            skew = 0.0  # section moments of first order: Gaussian
        mean = float(self.phase_reduced.section[quantity].loc[impact])
        if np.isfinite(skew) and sd > 0.0 and np.isfinite(mean):
            return section_density(values, mean, sd, skew)
        if not quantity.startswith("y") or self.trace.rho is not None:
            return None
        stage = int(quantity[1:])
        vx, vy = self.stage_covariance(impact, stage).diagonal()
        if not has_series(vx, vy, self.order):
            return None
        series = self.edgeworth(impact, stage)
        return series.velocity_density(np.asarray(values) - self.trace.mean[impact, 2 * stage - 1])

    def edgeworth(self, impact: int, stage: int) -> Edgeworth:
        """Edgeworth series of the perturbation in a gap just before an impact (Eqs. 18, 19).

        Parameters
        ----------
        impact : int
            Number of the impact, from 1 on.
        stage : int
            Number of the gap, from 1 on.

        Returns
        -------
        Edgeworth
            Coefficients and standard deviations.

        Raises
        ------
        InputError
            If a variance is not positive there: no series can be formed.
        """
        count("impact", impact, least=1, most=max(self.trace.found, 1))
        count("stage", stage, least=1, most=self.trace.wheels)
        raw = self.trace.raw[impact, stage - 1]
        if not has_series(raw[2, 0], raw[0, 2], self.order):
            raise InputError(
                "impact",
                impact,
                f"stage {stage} has no positive variance there, so no Edgeworth series",
            )
        sd_x = float(np.sqrt(raw[2, 0]))
        sd_y = float(np.sqrt(raw[0, 2]))
        return Edgeworth(coefficients(raw, sd_x, sd_y), sd_x, sd_y)


def _as_list(times: Sequence[float] | Floats) -> list[float]:
    try:
        return [float(time) for time in np.asarray(times, dtype=float)]
    except (TypeError, ValueError, OverflowError):
        raise InputError("times", times, "give a sequence of times") from None


def row_of_moments(mean: Floats, covariance: Floats) -> list[float]:
    """One row of a table of moments at fixed times, `rattle.closure.closure.moment_names`."""
    gaps = range(0, len(mean), 2)
    rho = (correlation(covariance[j : j + 2, j : j + 2]) for j in gaps)
    return [*mean.tolist(), *covariance[np.triu_indices(len(mean))].tolist(), *rho]
