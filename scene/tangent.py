"""How neighbours of a path part: the saltation matrix at an impact, and orthonormal frames that keep the growth.

A neighbour meets the wall at another instant.  Carried back to the path's own instant, its displacement after the
impact is ``Xi = R + (F+ - R F-) g' / (g' F-)`` times that before it (docs/model.md section 6), F the rate just before
and just after, R the contact law, g the normal of the wall.  Whatever the accelerations, ``det Xi = epsilon^2``.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.scene.compiled import jit
from rattle.scene.damping import pair
from rattle.scene.flight import field
from rattle.scene.impact import contact_matrix, struck
from rattle.scene.scene import Constants

__all__ = ["Stretch", "carry_frame", "saltation_matrix", "strike_frame"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


SLOWEST = 1e-150
"""Slower impacts part neighbours as if they had this speed: what is larger has no square in the floats."""


class Stretch(NamedTuple):
    """A stretch of impacts of an orbit or of a path, and how its neighbours part.

    Attributes
    ----------
    flight : ndarray, shape (impacts,)
        Time since the last impact.
    phase : ndarray, shape (impacts,)
        Time of the impact, modulo the period 2 pi of the excitation.
    code : ndarray of int, shape (impacts,)
        ``mesh * side``.
    before : ndarray, shape (impacts, 4)
        ``(x1, y1, x2, y2)`` just before the impact.
    growth : ndarray, shape (impacts, 4)
        Logarithms by which a frame of neighbours has grown since the last impact, along its four axes (two for a
        single stage, the others 0); minus infinity along an axis that the impact or the damping has brought to nothing.
    """

    flight: Floats
    phase: Floats
    code: Ints
    before: Floats
    growth: Floats

    def first(self, impacts: int) -> "Stretch":
        """The first so many of them."""
        n = impacts
        return Stretch(self.flight[:n], self.phase[:n], self.code[:n], self.before[:n], self.growth[:n])


@jit
def saltation_matrix(c: Constants, mesh: int, tau: float, y1: float, y2: float) -> Floats:
    """``Xi`` of an impact from the velocities before it, shape (4, 4).

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> c = Scene.from_gears(DAT21).constants
    >>> round(float(np.linalg.det(saltation_matrix(c, 2, 0.3, 0.4, -1.0))), 12) == round(c.epsilon**2, 12)
    True
    """
    xi = contact_matrix(c, mesh)
    z1, z2 = struck(c, mesh, y1, y2)
    before, after = field(c, tau, y1, y2), field(c, tau, z1, z2)
    j = 2 * (mesh - 1)
    jump = np.zeros(4)
    for i in range(4):
        total = after[i]
        for k in range(4):
            total -= xi[i, k] * before[k]
        jump[i] = total / (before[j] if abs(before[j]) > SLOWEST else np.copysign(SLOWEST, before[j]))
    for i in range(4):
        xi[i, j] += jump[i]
    return xi


@jit
def carry_frame(c: Constants, t: float, frame: Floats) -> None:
    """Fly all columns of a frame, shape (4, 4), for a time t, in place."""
    p = pair(c.beta1, c.beta2, t)
    for k in range(4):
        v1, v2 = frame[1, k], frame[3, k]
        frame[0, k] += p.e1 * v1
        frame[1, k] = p.d1 * v1
        if c.stages == 2:
            frame[2, k] += p.e12 * v1 + p.e2 * v2
            frame[3, k] = p.d12 * v1 + p.d2 * v2


@jit
def _across(frame: Floats, size: int, k: int) -> float:
    """Take out of column k, twice over, what lies along the columns before it; returns the length that is left."""
    for _ in range(2):
        for j in range(k):
            dot = 0.0
            for i in range(size):
                dot += frame[i, j] * frame[i, k]
            for i in range(size):
                frame[i, k] -= dot * frame[i, j]
    length, largest = 0.0, 0.0
    for i in range(size):
        length += frame[i, k] * frame[i, k]
        largest = max(largest, abs(frame[i, k]))
    if length < np.inf:
        return float(np.sqrt(length))
    length = 0.0  # a square beyond the floats
    for i in range(size):
        length += (frame[i, k] / largest) ** 2
    return float(largest * np.sqrt(length))


@jit
def _replace(frame: Floats, size: int, k: int) -> float:
    """Put into column k the axis that lies most across the columns before it; returns the length of what does."""
    best, axis = -1.0, 0
    for a in range(size):
        across = 1.0
        for j in range(k):
            across -= frame[a, j] * frame[a, j]
        if across > best:
            best, axis = across, a
    for i in range(size):
        frame[i, k] = 1.0 if i == axis else 0.0
    return _across(frame, size, k)


@jit
def _orthonormalise(frame: Floats, size: int, growth: Floats) -> None:
    """Gram and Schmidt on the first `size` rows and columns, in place; adds logarithms of lengths."""
    for k in range(size):
        length = _across(frame, size, k)
        growth[k] += np.log(length)
        if not length > 0.0:  # without restitution, or damped to nothing: this direction is forgotten
            length = _replace(frame, size, k)
        for i in range(size):
            frame[i, k] /= length


@jit
def strike_frame(c: Constants, mesh: int, tau: float, y1: float, y2: float, frame: Floats, growth: Floats) -> None:
    """Take a frame that has flown to an impact through it, and add to `growth`, shape (4,), what it has grown by.

    Orthonormalised on both sides of the impact: a slow one parts neighbours by a matrix as large as 1 / speed.
    """
    size = 2 * c.stages
    _orthonormalise(frame, size, growth)
    xi = saltation_matrix(c, mesh, tau, y1, y2)
    moved = np.zeros(4)
    for k in range(size):
        for i in range(size):
            moved[i] = 0.0
            for j in range(size):
                moved[i] += xi[i, j] * frame[j, k]
        for i in range(size):
            frame[i, k] = moved[i]
    _orthonormalise(frame, size, growth)
