"""Toleranced backlash: where the flanks of each path stand, and where they stand after a redraw (MODEL section 4)."""

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from scene.compiled import jit
from scene.scene import CUT, Scene

__all__ = ["LAWS", "deviation", "draw_walls"]

Floats = NDArray[np.float64]

LAWS = {"fixed": 0, "uniform": 1, "normal": 2}
"""Code of a law in compiled code."""


@jit
def deviation(law: int, generator: np.random.Generator) -> float:
    """One deviation in units of c_max."""
    if law == 0:
        return 1.0
    if law == 1:
        return 2.0 * generator.random() - 1.0
    while True:  # a normal law truncated at c_max keeps 95 % of its draws
        c = generator.standard_normal() / CUT
        if abs(c) <= 1.0:
            return c


def draw_walls(scene: Scene, impacts: int, generator: np.random.Generator, paths: int) -> tuple[Floats, Floats]:
    """Distances of the flanks from the middle.

    Parameters
    ----------
    scene : Scene
    impacts : int
        Impacts of each path.
    generator : Generator
    paths : int

    Returns
    -------
    walls : ndarray, shape (4, paths)
        Of the flanks +1, -1, +2, -2 at the start.
    fresh : ndarray, shape (2, draws, paths)
        Half gaps that flanks of mesh 1, 2 take later, one for each impact; no draws where they keep their own.
    """
    gaps = np.array([scene.gap1, scene.gap2])
    tolerance = scene.tolerance
    if tolerance is None:
        return np.repeat(gaps, 2)[:, None] + np.zeros((4, paths)), np.empty((2, 0, paths))
    c_max = np.array([tolerance.c1_max, tolerance.c2_max])

    def draw(shape: tuple[int, ...]) -> Floats:
        if tolerance.law == "fixed":
            return np.ones(shape)
        if tolerance.law == "uniform":
            return generator.uniform(-1.0, 1.0, shape)
        return np.asarray(stats.truncnorm.rvs(-CUT, CUT, scale=1.0 / CUT, size=shape, random_state=generator))

    if tolerance.draw == "path" or tolerance.law == "fixed":
        half = gaps[:, None] + c_max[:, None] * draw((2, paths))
        return np.repeat(half, 2, axis=0), np.empty((2, 0, paths))
    walls = np.repeat(gaps, 2)[:, None] + np.repeat(c_max, 2)[:, None] * draw((4, paths))
    return walls, gaps[:, None, None] + c_max[:, None, None] * draw((2, impacts + 1, paths))
