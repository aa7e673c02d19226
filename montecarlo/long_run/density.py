"""The density of the section over phase and velocity, with an error in every cell."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

__all__ = ["SectionDensity"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SectionDensity:
    """Impacts at a mesh by the phase of the excitation and the velocity just before them.

    Attributes
    ----------
    mesh : int
        Mesh that is struck.
    phase, velocity : ndarray, shape (cells + 1,)
        Edges of the cells; phases in [0, 2 pi].
    density, se : ndarray, shape (phases, velocities)
        Probability density of the section, and its standard error from the variation between paths.
    outside : float
        Share of the impacts with a velocity beyond the edges.
    """

    mesh: int
    phase: Floats
    velocity: Floats
    density: Floats
    se: Floats
    outside: float

    @property
    def table(self) -> pd.DataFrame:
        """Cells that are not empty: ``mesh, phase, velocity`` (middles), ``density, se``."""
        i, j = np.nonzero(self.density)
        middle = [0.5 * (edges[1:] + edges[:-1]) for edges in (self.phase, self.velocity)]
        return pd.DataFrame({
            "mesh": self.mesh, "phase": middle[0][i], "velocity": middle[1][j], "density": self.density[i, j],
            "se": self.se[i, j],
        })  # fmt: skip
