"""The public entry of the closures: one call, three closures, one result."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.closure import corrected as corrected
from rattle.closure import published as published
from rattle.closure import saltation
from rattle.closure.branching import trace as branching
from rattle.closure.edgeworth import Edgeworth, coefficients, has_series, mixture_density, section_density
from rattle.closure.moments import Trace
from rattle.scene.errors import InputError
from rattle.scene.moments import SECTION, STATE, correlation, realizability
from rattle.scene.scene import Scene
from rattle.scene.validate import choice, count

__all__ = ["CLOSURES", "Breakdown", "Closure", "MeanMap", "closures_for", "mean_map", "refusals"]

Floats = NDArray[np.float64]


class Closure(NamedTuple):
    """How a closure is followed, and what refuses the scenes that it cannot take."""

    trace: Callable[[Scene, int, int], Trace]
    check: Callable[[Scene], None] = lambda scene: None


CLOSURES = {
    "published": Closure(published.trace, published.check),
    "corrected": Closure(corrected.trace),
    "saltation": Closure(saltation.trace),
    "branching": Closure(branching.trace),
}
"""The closures, by name."""

ORDERS = (2, 6)
VELOCITIES = ("y1", "y2")


MOST_IMPACTS = 100_000  # an impact takes some kilobytes; a long orbit is followed by rattle.closure.long_orbit


class Breakdown(NamedTuple):
    """The first impact at which a stage's moments belong to no distribution; stage 0 is the time of flight."""

    impact: int
    stage: int
    reason: str


@dataclass(frozen=True)
class MeanMap:
    """A closure followed through its impacts.

    Attributes
    ----------
    scene, closure, impacts, order
        What was asked.
    trace : Trace
        The arrays behind the tables.
    """

    scene: Scene
    closure: str
    impacts: int
    order: int
    trace: Trace

    @cached_property
    def phase_reduced(self) -> "MeanMap":
        """The same result for the scene begun at its phase (`Scene.near`): tau has all its digits, however late."""
        return self if self.scene.phase_reduced is self.scene else replace(self, scene=self.scene.phase_reduced)

    @property
    def stopped(self) -> str:
        """Why the closure ended before the last impact asked for, or an empty string."""
        return self.trace.stopped

    @property
    def itinerary(self) -> tuple[int, ...]:
        """``mesh * side`` of impacts 1, 2, ...: +1, -1, +2, -2, and 0 where the closure has ended."""
        return tuple(int(m * s) for m, s in zip(self.trace.mesh[1:], self.trace.side[1:], strict=True))

    def stage_covariance(self, impact: int, stage: int) -> Floats:
        """Covariance of displacement and velocity of a stage just before an impact, shape (2, 2)."""
        j = 2 * (stage - 1)
        return self.trace.covariance[impact, j : j + 2, j : j + 2]

    @cached_property
    def breakdown(self) -> Breakdown | None:
        """The first impact at which the moments are not realizable, or None; a mixture's covariances always are."""
        for k in range(1, self.trace.found + 1):
            for stage in self._stages if self.trace.parts is None else ():
                judged = realizability(self.stage_covariance(k, stage))
                if not judged.realizable:
                    return Breakdown(k, stage, judged.reason)
            flight = float(self.trace.tau[k] - self.trace.tau[k - 1])
            if flight < 0.0:
                return Breakdown(k, 0, f"mean time of flight = {flight:.3g} < 0")
        return None

    @cached_property
    def section(self) -> pd.DataFrame:
        """Moments of the state just before impact 1, 2, ... (dimensionless); NaN where the closure predicts none.

        Columns: ``tau, flight, mesh, side, x1, y1, x2, y2``, ``sd_`` and ``skew_`` of each quantity, ``rho1, rho2``
        (correlation of displacement and velocity perturbation of a stage) and ``realizable`` (a mean time of flight
        below 0 is not); for ``branching`` also
        ``agreement``, the share of paths expected on the orbit's itinerary so far, and ``lost``, the weight dropped.
        """
        t = self.trace
        columns: dict[str, object] = {
            "tau": self.scene.to_absolute_time(t.tau[1:]),
            "flight": np.diff(t.tau),
            "mesh": t.mesh[1:],
            "side": t.side[1:],
        }
        columns |= {name: t.mean[1:, i] for i, name in enumerate(STATE)}
        columns |= {f"sd_{name}": t.sd[1:, i] for i, name in enumerate(SECTION)}
        columns |= {f"skew_{name}": t.skew[1:, i] for i, name in enumerate(SECTION)}
        impacts = range(1, self.impacts + 1)
        for stage in (1, 2):
            columns[f"rho{stage}"] = [correlation(self.stage_covariance(k, stage)) for k in impacts]
        columns["realizable"] = [
            k <= t.found
            and t.tau[k] >= t.tau[k - 1]
            and (
                t.parts is not None or all(realizability(self.stage_covariance(k, s)).realizable for s in self._stages)
            )
            for k in impacts
        ]
        table = pd.DataFrame(columns, index=pd.RangeIndex(1, self.impacts + 1, name="impact"))
        if t.agreement is not None and t.lost is not None:
            table["agreement"], table["lost"] = t.agreement[1:], t.lost[1:]
        if self.scene.stages == 1:
            table[["x2", "y2", "sd_x2", "sd_y2", "skew_x2", "skew_y2", "rho2"]] = np.nan
        return table

    @property
    def _stages(self) -> range:
        return range(1, self.scene.stages + 1)

    def at_times(self, times: Sequence[float] | Floats) -> pd.DataFrame:
        """Means, covariances and ``rho1, rho2`` at fixed times between the start and the last impact.

        Columns: ``x1, y1, x2, y2``, ``cov_x1_x1, cov_x1_y1, ...`` and ``rho1, rho2``; index ``time``.

        Raises
        ------
        InputError
            If a time lies outside what was followed.
        """
        low, high = self.trace.span
        rows = []
        for time in _listed(times):
            if not low <= self.scene.to_local_time(time) <= high:
                followed = f"{self.scene.to_absolute_time(low):g} to {self.scene.to_absolute_time(high):g}"
                raise InputError("times", time, f"lies outside the times followed, {followed}")
            mean, covariance = self.trace.at(self.scene.to_local_time(time))
            rows.append(fixed_row(mean, covariance))
        columns = list(fixed_row(np.zeros(4), np.zeros((4, 4))))
        index = pd.Index(np.asarray(times, dtype=float), name="time")
        return pd.DataFrame(rows, index=index, columns=columns, dtype=float)

    def density(self, impact: int, quantity: str, values: Floats) -> Floats | None:
        """Density that the closure gives to a section quantity at an impact; None where it gives none.

        Around the closure's mean, with its sd and skewness; ``published`` gives a velocity the marginal of its
        bivariate series, for it speaks of raw moments; ``branching`` has its mixture.  Values of tau are counted
        from the start's phase (`Scene.phase`).
        """
        i = SECTION.index(choice("quantity", quantity, SECTION))
        count("impact", impact, least=1, most=self.impacts)
        if impact > self.trace.found:
            return None
        if self.trace.sd[impact, i] == 0.0:
            return None  # the displacement at the wall that is struck: one value, no density
        if self.trace.parts is not None:
            weights, means, variances = (a if a.ndim == 1 else a[:, i] for a in self.trace.parts[impact])
            return mixture_density(values, weights, means, variances)
        skew, sd = float(self.trace.skew[impact, i]), float(self.trace.sd[impact, i])
        if np.isfinite(self.trace.sd[impact, 0]) and np.isnan(self.trace.skew[impact]).all():
            skew = 0.0  # section moments of first order: Gaussian
        if np.isfinite(skew) and sd > 0.0:
            return section_density(values, float(self.phase_reduced.section[quantity].loc[impact]), sd, skew)
        if quantity not in VELOCITIES:
            return None
        stage = VELOCITIES.index(quantity) + 1
        vx, vy = self.stage_covariance(impact, stage).diagonal()
        if not has_series(vx, vy, self.order):
            return None
        series = self.edgeworth(impact, stage)
        return series.velocity_density(np.asarray(values) - self.trace.mean[impact, 2 * stage - 1])

    def edgeworth(self, impact: int, stage: int) -> Edgeworth:
        """Edgeworth series of a stage's perturbation just before an impact (Eqs. 18, 19).

        Raises
        ------
        InputError
            If a variance is not positive there: no series can be formed.
        """
        count("impact", impact, least=1, most=max(self.trace.found, 1))
        count("stage", stage, least=1, most=self.scene.stages)
        raw = self.trace.raw[impact, stage - 1]
        if not has_series(raw[2, 0], raw[0, 2], self.order):
            raise InputError("impact", impact, f"stage {stage} has no positive variance there, so no Edgeworth series")
        sd_x, sd_y = float(np.sqrt(raw[2, 0])), float(np.sqrt(raw[0, 2]))
        return Edgeworth(coefficients(raw, sd_x, sd_y), sd_x, sd_y)


def _listed(times: Sequence[float] | Floats) -> list[float]:
    try:
        return list(np.asarray(times, dtype=float).tolist())
    except (TypeError, ValueError, OverflowError):
        raise InputError("times", times, "give a sequence of times") from None


def fixed_row(mean: Floats, covariance: Floats) -> dict[str, float]:
    """One row of a table at fixed times, in the column order that both sides share."""
    row = {name: float(mean[i]) for i, name in enumerate(STATE)}
    for i, a in enumerate(STATE):
        for j in range(i, 4):
            row[f"cov_{a}_{STATE[j]}"] = float(covariance[i, j])
    for stage in (1, 2):
        j = 2 * (stage - 1)
        row[f"rho{stage}"] = correlation(covariance[j : j + 2, j : j + 2])
    return row


def mean_map(scene: Scene, *, impacts: int = 12, closure: str = "saltation", order: int = 4) -> MeanMap:
    """Predict the moments of the first impacts of a scene by a moment closure.

    Parameters
    ----------
    scene : Scene
        What is modelled.
    impacts : int
        How many impacts after the start.
    closure : {"saltation", "branching", "corrected", "published"}
        Which closure (docs/model.md section 6).  ``saltation`` is right for small noise,
        ``branching`` follows the itineraries that larger noise parts; it predicts section moments and itineraries only.
    order : int
        Highest order of moments that the Edgeworth series carries, 2 to 6.  ``saltation`` stays with first-order
        means and sds at order 2, and adds mean shifts and skewness from order 3 on.

    Returns
    -------
    MeanMap

    Raises
    ------
    InputError
        For an unknown closure or an order out of range; names the valid ones.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> m = mean_map(Scene.from_gears(DAT21, sigma=1.5**0.5), impacts=4, closure="published")
    >>> m.breakdown.impact
    2
    """
    if not isinstance(scene, Scene):
        raise InputError("scene", scene, "give a Scene")
    count("impacts", impacts, most=MOST_IMPACTS)
    choice("closure", closure, CLOSURES)
    count("order", order, *ORDERS)
    CLOSURES[closure].check(scene)
    return MeanMap(scene, closure, impacts, order, CLOSURES[closure].trace(scene, impacts, order))


def refusals(scene: Scene) -> dict[str, str]:
    """Why closures cannot take a scene, by name; a closure that can has no entry.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene, Start
    >>> refusals(Scene.from_gears(DAT21, start=Start()))
    {'published': 'start.mesh = 0: the published closure needs a start at mesh 1 (Eq. 10)'}
    """
    found = {}
    for name, closure in CLOSURES.items():
        try:
            closure.check(scene)
        except InputError as error:
            found[name] = str(error)
    return found


def closures_for(scene: Scene) -> tuple[str, ...]:
    """The closures that can take a scene.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene, Start
    >>> closures_for(Scene.from_gears(DAT21, start=Start()))
    ('corrected', 'saltation', 'branching')
    """
    refused = refusals(scene)
    return tuple(name for name in CLOSURES if name not in refused)
