"""Random half gaps: the flank positions of each path at the start and after a redraw (docs/model.md
section 4)."""

import math
from typing import NamedTuple

import numpy as np

from rattle.montecarlo.noise.philox import CONTACT, Key, Word, normals, uniforms
from rattle.scene import Floats, Scene, Tolerance
from rattle.scene.compiled import lean, lean_internal
from rattle.scene.types import CUT

DISTRIBUTION_CODES = {"fixed": 0, "uniform": 1, "normal": 2}
ATTEMPTS = Word(64)  # rejection sampling of the truncated normal, which accepts 95 %


class Backlash(NamedTuple):
    """Half gaps and their tolerance, as compiled code reads them."""

    gap: Floats  # nominal half gaps; (wheels,)
    c_max: Floats  # largest deviation of a half gap; (wheels,)
    distribution: int  # 0 fixed, 1 uniform, 2 truncated normal
    random: bool  # whether half gaps differ between paths
    uneven: bool  # whether they do, or a mesh has one wall only: a step reads each lane's flanks
    redrawn: bool  # whether an impact redraws the opposite flank


def backlash_of(scene: Scene) -> Backlash:
    """Backlash of a scene."""
    t = scene.tolerance or Tolerance(distribution="fixed")
    kind = DISTRIBUTION_CODES[t.distribution]
    random = t.distribution != "fixed"
    gap, c_max = np.array([(wheel.gap, wheel.tolerance) for wheel in scene.tree]).T.copy()
    uneven = random or any(wheel.one_sided for wheel in scene.tree)
    return Backlash(gap, c_max, kind, random, uneven, random and t.draw == "contact")


@lean_internal
def _deviation(key: Key, path: Word, contact: Word, distribution: int) -> float:
    """Deviation number `contact` of a path, in units of c_max."""
    if distribution == 0:
        return 1.0
    first = contact * ATTEMPTS
    purpose = Word(CONTACT)
    if distribution == 1:
        return 2.0 * uniforms(key, path, first, purpose)[0] - 1.0
    for attempt in range(ATTEMPTS):
        c = normals(key, path, first + Word(attempt), purpose)[0] / CUT
        if abs(c) <= 1.0:
            return c
    return 0.0  # all attempts rejected: probability 0.05^64, about 1e-83


@lean_internal
def half_gap(b: Backlash, key: Key, path: Word, contact: Word, mesh: int) -> float:
    """Half gap of a flank by draw number `contact` of a path."""
    deviation = _deviation(key, path, contact, b.distribution)
    gap: float = b.gap[mesh - 1] + b.c_max[mesh - 1] * deviation
    return gap


@lean
def draw_walls(b: Backlash, key: Key, first: int, walls: Floats) -> None:
    """Distances of the flanks +1, -1, +2, -2, ... from the middle of their gap at the start, into
    `walls`; both flanks of a mesh share a draw unless impacts redraw them.

    `walls`: Output.  Draws 0 to 3 belong to the flanks of two wheels, or more of more wheels; the
    draws of the impacts follow. Shapes: `walls` (2 wheels, paths).
    """
    for flank in range(walls.shape[0]):
        draw = Word(flank if b.redrawn else 2 * (flank // 2))
        for p in range(walls.shape[1]):
            if walls[flank, p] < math.inf:
                walls[flank, p] = half_gap(b, key, Word(first + p), draw, 1 + flank // 2)
