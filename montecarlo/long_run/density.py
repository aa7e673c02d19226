"""The density of the section over phase and velocity, with an error in every cell."""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.montecarlo.long_run.collected import Collected
from rattle.montecarlo.long_run.sums import NUMBER, PHASES, VELOCITIES

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SectionDensity:
    """Impacts at a mesh by the phase of the excitation and the velocity just before them."""

    mesh: int  # mesh that is struck
    phase: Floats  # phase, velocity: edges of the cells; phases in [0, 2 pi]; (cells + 1,)
    velocity: Floats
    # density, se: probability density of the section, and its standard error from the variation between paths;
    # (phases, velocities)
    density: Floats
    se: Floats
    outside: float  # share of the impacts with a velocity beyond the edges

    @property
    def table(self) -> pd.DataFrame:
        """Cells that are not empty: ``mesh, phase, velocity`` (middles), ``density, se``."""
        i, j = np.nonzero(self.density)
        middle = [0.5 * (edges[1:] + edges[:-1]) for edges in (self.phase, self.velocity)]
        return pd.DataFrame(
            {
                "mesh": self.mesh,
                "phase": middle[0][i],
                "velocity": middle[1][j],
                "density": self.density[i, j],
                "se": self.se[i, j],
            }
        )


def section_densities(c: Collected) -> tuple[SectionDensity, ...]:
    """Density of the section at each mesh."""
    found = []
    for mesh in range(1, c.stages + 1):
        at = 4 * (mesh if c.stages == 2 else 0) + NUMBER
        n = c.of_units(c.main[:, :, at].sum(axis=1))
        if n.sum() == 0.0:
            continue
        low, high = c.scales.low[mesh - 1], c.scales.high[mesh - 1]
        area = 2.0 * math.pi / PHASES * (high - low) / VELOCITIES
        share, se = _shares(c.section[:, mesh - 1].astype(float), n)
        edges = np.linspace(0.0, 2.0 * math.pi, PHASES + 1), np.linspace(low, high, VELOCITIES + 1)
        found.append(SectionDensity(mesh, *edges, share / area, se / area, float(1.0 - share.sum())))
    return tuple(found)


def _shares(counts: Floats, n: Floats) -> tuple[Floats, Floats]:
    """Shares of counts, shape (units, ...), in n of each unit, and their standard errors over units."""
    share = counts.sum(axis=0) / n.sum()
    rest = counts - share * n.reshape(-1, *[1] * (counts.ndim - 1))
    return share, np.sqrt((rest**2).sum(axis=0) * len(n) / (len(n) - 1)) / n.sum()


def velocity_density(c: Collected, mesh: int) -> tuple[Floats, Floats]:
    """Density of the velocity before an impact at a mesh, in the cells of the section, and its standard error.

    Shapes: result (VELOCITIES,).
    """
    at = 4 * (mesh if c.stages == 2 else 0) + NUMBER
    n = c.of_units(c.main[:, :, at].sum(axis=1))
    share, se = _shares(c.section[:, mesh - 1].sum(axis=1).astype(float), n)
    width = (c.scales.high[mesh - 1] - c.scales.low[mesh - 1]) / VELOCITIES
    return share / width, se / width
