"""The result of a long run."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.long_run.burn_in import BurnIn, Drift
from rattle.montecarlo.long_run.collected import Collected, time_averages
from rattle.montecarlo.long_run.density import SectionDensity, section_densities, velocity_density
from rattle.montecarlo.long_run.estimates import StationaryEstimate, estimates
from rattle.montecarlo.long_run.names import all_names
from rattle.montecarlo.long_run.reach import LongReach
from rattle.montecarlo.long_run.sums import NUMBER
from rattle.scene.scene import Scene

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LongRun:
    """Stationary quantities of an ensemble, from `rattle.montecarlo.long_run.long_run`."""

    scene: Scene
    sums: Collected  # the sums of all paths
    periods: int  # periods of each path after the burn-in
    burn_in: BurnIn
    reach: LongReach | None  # none where a number of periods was given
    late: Drift  # first quarter against last half of the stationary motion
    slow: float  # speed below which an impact is slow
    wall_seconds: float

    @property
    def paths(self) -> int:
        """Number of paths."""
        return self.sums.paths

    @property
    def impacts(self) -> int:
        """Impacts of all paths after the burn-in."""
        return int(self.sums.main[:, :, NUMBER].sum())

    @cached_property
    def estimates(self) -> dict[str, StationaryEstimate]:
        """All quantities by name, in the order of the table."""
        found = estimates(self.sums)
        return {name: found[name] for name in all_names(self.scene.stages) if name in found}

    @cached_property
    def densities(self) -> tuple[SectionDensity, ...]:
        """Density of the section at each mesh."""
        return section_densities(self.sums)

    def velocity_density(self, mesh: int) -> tuple[Floats, Floats]:
        """Density of the velocity before an impact at a mesh, and its standard error, in the cells of the section.

        Shapes: result (velocities,).
        """
        return velocity_density(self.sums, mesh)

    @property
    def averages(self) -> Floats:
        """Averages over time on each path, see `time_averages`."""
        return time_averages(self.sums)
