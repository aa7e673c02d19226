"""The result of a long run: its quantities, the density of its section, its energy balance, its
burn-in and reach."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd

from rattle.montecarlo.long_run.estimates import Estimates, all_names, estimates
from rattle.montecarlo.long_run.sums import (
    ENERGY,
    LEFT_OUT,
    NUMBER,
    PHASES,
    VELOCITY_CELLS,
    Sums,
)
from rattle.scene import Floats, Scene, duration_text
from rattle.scene.drive import PERIOD, mean_square

KEPT_APART = 4.0  # ratio of variances from which paths look as if they never met


class Contrast(NamedTuple):
    """The largest difference between two parts of a run, or between its paths."""

    quantity: str  # where it is largest
    # in standard errors; or the variance between paths over that expected from the parts of each
    size: float
    allowed: float  # the largest that is put down to chance
    share: float = math.nan  # difference between the parts over the mean

    @property
    def reached(self) -> bool:
        """Whether the parts, or the paths, agree."""
        return abs(self.size) <= self.allowed


class BurnIn(NamedTuple):
    """The burn-in of a run."""

    periods: int  # periods of the excitation that were left out
    drift: Contrast  # of the test that it passed
    # of the other test; None where paths differ for good, because each has a backlash of its own
    apart: Contrast | None
    reached: bool  # whether the start was seen to be forgotten, or a burn-in was given

    @property
    def keeps_apart(self) -> bool:
        """Whether the start was not forgotten because paths look as if they never met."""
        return not self.reached and self.apart is not None and self.apart.size > KEPT_APART

    @property
    def sentence(self) -> str:
        """What was left out, and why it suffices, as text."""
        if not self.reached:
            return (
                "The start may not be forgotten: the budget ended before the motion was seen to be"
                f" stationary. The first {self.periods} periods are left out, and all intervals are"
                " wider for that reason; a larger budget helps."
            )
        return (
            f"Burn-in: {self.periods} periods; its second quarter and its second half agree within "
            f"{abs(self.drift.size):.1f} standard errors (allowed {self.drift.allowed:.1f})."
        )


class LongReach(NamedTuple):
    """The accuracy that a long run reached, compared with the accuracy asked for."""

    asked: float  # largest half width of the 95 % intervals over their value
    worst: str  # the quantity whose interval is widest
    width: float  # half width of its interval over its value
    more_seconds: float  # estimated time that is missing; 0 where the accuracy was reached
    sets: int = 0  # gear sets that would suffice, where only more of them narrow the interval

    @property
    def reached(self) -> bool:
        """Whether all intervals that were asked for are within the accuracy."""
        return self.width <= self.asked

    @property
    def sentence(self) -> str:
        """What was reached, as text."""
        width = f"the widest interval is ± {self.width:.2g} of its value ({self.worst})"
        if self.reached:
            return f"Accuracy {self.asked:g} reached: {width}."
        if self.sets:
            return (
                f"Accuracy {self.asked:g} NOT reached: {width}, because gear sets differ; longer"
                f" paths do not help, about {self.sets:,} sets (paths) would."
            )
        if math.isinf(self.width):
            return (
                f"Accuracy {self.asked:g} NOT reached within the budget: the error of {self.worst}"
                " is not known, for too few paths say anything of it; a larger budget helps."
            )
        more = f"{duration_text(self.more_seconds)} of processor time more"
        return (
            f"Accuracy {self.asked:g} NOT reached within the budget: {width}; about {more} would"
            " suffice."
        )


@dataclass(frozen=True)
class SectionDensity:
    """Impacts at a mesh by the phase of the excitation and the velocity just before them."""

    mesh: int  # mesh that is struck
    phase: Floats  # phase, velocity: edges of the cells; phases in [0, 2 pi]; (cells + 1,)
    velocity: Floats
    # density, se: probability density of the section, and its standard error from the variation
    # between paths; (phases, velocities)
    density: Floats
    se: Floats
    outside: float  # share of the impacts with a velocity beyond the edges

    @property
    def table(self) -> pd.DataFrame:
        """Cells that are not empty: ``mesh, phase, velocity`` (middles), ``density, se``."""
        i, j = np.nonzero(self.density)
        phase, velocity = (0.5 * (edges[1:] + edges[:-1]) for edges in (self.phase, self.velocity))
        columns = {
            "mesh": self.mesh,
            "phase": phase[i],
            "velocity": velocity[j],
            "density": self.density[i, j],
        }
        return pd.DataFrame(columns | {"se": self.se[i, j]})


def _shares(counts: Floats, n: Floats) -> tuple[Floats, Floats]:
    """Shares of counts, shape (units, ...), in n of each unit, and their standard errors over
    units."""
    share = counts.sum(axis=0) / n.sum()
    rest = counts - share * n.reshape(-1, *[1] * (counts.ndim - 1))
    return share, np.sqrt((rest**2).sum(axis=0) * len(n) / (len(n) - 1)) / n.sum()


@dataclass(frozen=True, repr=False)
class LongRun:
    """Stationary quantities of an ensemble, from `rattle.montecarlo.long_run.long_run`."""

    scene: Scene
    sums: Sums  # the sums of all paths
    burn_in: BurnIn
    reach: LongReach | None  # none where a number of periods was given
    late: Contrast  # first quarter against last half of the stationary motion
    slow: float  # speed below which an impact is slow
    quiet: float  # speed down to which impacts at closed meshes are followed; 0 for all of them
    widened: float  # times that all intervals are wider, where the start may not be forgotten
    asked_periods: int | None  # periods that were asked for, in place of an accuracy
    wall_seconds: float

    @property
    def paths(self) -> int:
        """Number of paths."""
        return self.sums.paths

    @property
    def periods(self) -> int:
        """Periods of each path after the burn-in."""
        return self.sums.periods

    @property
    def impacts(self) -> int:
        """Impacts of all paths after the burn-in."""
        return int(self.sums.main[:, :, NUMBER].sum())

    @property
    def is_scattered(self) -> bool:
        """Whether each path is a gear set with backlashes of its own."""
        return self.scene.differs_by_set

    @cached_property
    def estimates(self) -> Estimates:
        """All quantities by name, in the order of the table."""
        known = estimates(self.sums)
        return {
            name: known[name].widen(self.widened)
            for name in all_names(self.scene.stages)
            if name in known
        }

    @property
    def reached(self) -> bool:
        """Whether all that was asked for was reached before the budget ended."""
        enough = self.asked_periods is None or self.periods >= self.asked_periods
        accurate = self.reach is None or self.reach.reached
        return self.burn_in.reached and enough and accurate

    @property
    def reach_sentence(self) -> str:
        """The accuracy or the periods that were reached, as text; empty where periods were asked
        for and reached."""
        if self.reach is not None:
            return self.reach.sentence
        if self.reached or self.asked_periods is None or self.periods >= self.asked_periods:
            return ""
        return f"The budget ended after {self.periods} of {self.asked_periods} periods."

    @property
    def left_out(self) -> tuple[float, float, float]:
        """What impacts at closed meshes add that are not followed: share of the time in which
        meshes are held closed, share of the energy lost, and a bound of the rate of those not
        slow."""
        lost, time, above = self.sums.main[:, :, LEFT_OUT : LEFT_OUT + 3].sum(axis=(0, 1)).tolist()
        whole = self.sums.time * self.paths
        energy = float(self.sums.main[:, :, ENERGY].sum())
        return time / whole, lost / energy if energy > 0.0 else 0.0, above / whole

    @cached_property
    def densities(self) -> tuple[SectionDensity, ...]:
        """Density of the section at each mesh that is struck."""
        tables = []
        r = self.sums.scales
        for mesh in range(1, self.scene.stages + 1):
            n = self.sums.impacts_at(mesh)
            low = r.low[mesh - 1]
            high = r.high[mesh - 1]
            if n.sum() > 0.0:
                area = PERIOD / PHASES * (high - low) / VELOCITY_CELLS
                share, se = _shares(self.sums.section[:, mesh - 1].astype(float), n)
                edges = (
                    np.linspace(0.0, PERIOD, PHASES + 1),
                    np.linspace(low, high, VELOCITY_CELLS + 1),
                )
                tables.append(
                    SectionDensity(mesh, *edges, share / area, se / area, float(1.0 - share.sum()))
                )
        return tuple(tables)

    def velocity_density(self, mesh: int) -> tuple[Floats, Floats]:
        """Density of the velocity before an impact at a mesh, and its standard error, in the cells
        of the section.

        Shapes: result (velocities,).
        """
        counts = self.sums.section[:, mesh - 1].sum(axis=1).astype(float)
        r = self.sums.scales
        share, se = _shares(counts, self.sums.impacts_at(mesh))
        width = (r.high[mesh - 1] - r.low[mesh - 1]) / VELOCITY_CELLS
        return share / width, se / width

    def energy_balance(self) -> tuple[Floats, Floats]:
        """Energy lost in impacts, and energy supplied, per unit of time on each path (docs/model.md
        section 10), by white noise.

        Returns: Their means agree within the standard error of the mean of their difference, as
        long as no mesh is closed, and noise spreads the impacts over the phase: what is supplied is
        known from `SAMPLES` instants of each period, of which one more or less may lie before an
        impact that comes at the same phase each time. Shapes: result (paths,).
        """
        c = self.scene.constants
        columns = self.sums.columns
        means = self.sums.main.sum(axis=1) / self.sums.samples
        squared = means[:, columns.squared : columns.work]
        driven = means[:, columns.work : columns.above_speed]
        lost = self.sums.main[:, :, ENERGY].sum(axis=1) / self.sums.time
        supplied = np.zeros(self.paths)
        for i, wheel in enumerate(c.wheels):
            square = c.modulates * wheel.turn**2 * mean_square(c.drive, wheel.beta)
            square += wheel.own**2 + wheel.alone**2
            noise = 0.5 * c.sigma**2 * square
            power = noise - wheel.beta * squared[:, i] + c.alpha * driven[:, i]
            supplied += wheel.mass * power
        return lost, supplied
