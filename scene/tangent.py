"""Growth of neighbouring paths: the saltation matrix at an impact, and orthonormal tangent frames
(Lyapunov exponents).

A neighbour meets the wall at another time.  Extrapolated to the path's own impact time, its
displacement after the impact is ``Xi = R + (F+ - R F-) g' / (g' F-)`` times that before it
(docs/model.md section 6): F is the drift just before and just after, R the restitution map, g the
normal of the wall.  ``det Xi = epsilon^2`` for any drift.
"""

from typing import NamedTuple

import numpy as np

from rattle.scene.compiled import internal, jit
from rattle.scene.flight import field, jacobian
from rattle.scene.impact import contact_matrix, strike
from rattle.scene.linear_algebra import (
    add_outer,
    dot,
    norm,
    put,
    put_scaled,
    times,
    times_transposed,
)
from rattle.scene.types import Constants, Floats, Ints

SLOWEST_DIVISOR = 1e-150
"""Impact speeds below this are replaced by it in the saltation matrix, whose squares would
overflow."""


class Stretch(NamedTuple):
    """A stretch of impacts of an orbit or of a path, and the growth of its neighbours."""

    flight: Floats  # time since the last impact; (impacts,)
    phase: Floats  # time of the impact, modulo the period 2 pi of the excitation; (impacts,)
    code: Ints  # ``mesh * side``; (impacts,)
    before: Floats  # the state just before the impact; (impacts, 2 wheels)
    # logarithmic growth of an orthonormal tangent frame since the last impact, along its axes;
    # minus infinity along an axis that the impact or the damping has reduced to zero; (impacts,
    # 2 wheels)
    growth: Floats

    @classmethod
    def empty(cls, impacts: int, wheels: int) -> "Stretch":
        """Room for impacts; nothing has grown yet."""
        shape = (impacts, 2 * wheels)
        times_of = np.empty((2, impacts))
        codes = np.empty(impacts, np.int64)
        return cls(times_of[0], times_of[1], codes, np.empty(shape), np.zeros(shape))

    def first(self, impacts: int) -> "Stretch":
        """Keep the first impacts only."""
        return Stretch._make(part[:impacts] for part in self)


@internal
def land(rate: Floats, i: int, flown: Floats) -> Floats:
    """Derivative of the delay until displacement `i` is on its wall, ``-flown_i / rate_i``.

    `flown` is the derivative of the state at the orbit's own impact time, at which the state has
    the drift `rate`; it becomes that of the state on the wall, ``flown + rate late``.

    Shapes: `rate` (n,); `flown` (n, m); `late` (m,).
    """
    speed = rate[i] if abs(rate[i]) > SLOWEST_DIVISOR else np.copysign(SLOWEST_DIVISOR, rate[i])
    late = np.empty(flown.shape[1])
    for m in range(late.size):
        late[m] = -flown[i, m] / speed
        for k in range(rate.size):
            flown[k, m] += rate[k] * late[m]
    return late


@jit
def saltation_matrix(c: Constants, mesh: int, tau: float, before: Floats) -> Floats:
    """``Xi`` of an impact.

    Shapes: `before` (2 wheels,), the state just before it; result (2 wheels, 2 wheels).
    """
    after = before.copy()
    strike(c, mesh, after)
    # R (1 - F- g' / (g' F-)) + F+ g' / (g' F-)
    xi = np.eye(before.size)
    late = land(field(c, tau, before), 2 * (mesh - 1), xi)
    xi = times(contact_matrix(c, mesh, before[2 * mesh - 1]), xi)
    add_outer(xi, -1.0, field(c, tau, after), late)
    return xi


@internal
def _across(frame: Floats, size: int, k: int) -> float:
    """Gram-Schmidt step, applied twice: remove the earlier vectors from vector k; returns the
    length that is left."""
    v = frame[k, :size]
    for _ in range(2):
        for j in range(k):
            along = dot(frame[j, :size], v)
            for i in range(size):
                v[i] -= along * frame[j, i]
    length = norm(v)
    if length < np.inf:
        return length
    # the sum of squares has overflowed: scale first
    largest = 0.0
    part = np.empty(size)
    for i in range(size):
        largest = max(largest, abs(v[i]))
    put_scaled(part, v, largest)
    return largest * norm(part)


@internal
def _replace(frame: Floats, size: int, k: int) -> float:
    """Replace vector k by the coordinate axis furthest from the span of the earlier vectors;
    returns its length."""
    best = -1.0
    axis = 0
    for a in range(size):
        across = 1.0
        for j in range(k):
            across -= frame[j, a] * frame[j, a]
        if across > best:
            best = across
            axis = a
    for i in range(size):
        frame[k, i] = 1.0 if i == axis else 0.0
    return _across(frame, size, k)


@internal
def _orthonormalise(frame: Floats, size: int, growth: Floats) -> None:
    """Gram-Schmidt on the first `size` vectors, in place; adds the logarithms of the lengths to
    `growth`."""
    for k in range(size):
        length = _across(frame, size, k)
        growth[k] += np.log(length)
        if not length > 0.0:  # epsilon = 0, or damped to zero: this direction has collapsed
            length = _replace(frame, size, k)
        put_scaled(frame[k, :size], frame[k, :size], length)


@jit
def grow(c: Constants, frame: Floats, s: Stretch) -> None:
    """Take a tangent frame through the flights and impacts of a stretch, and record its growth.

    Orthonormalised on both sides of an impact: the saltation matrix of a slow one is as large as 1
    / speed.

    Shapes: `frame` (2 wheels, 2 wheels), a vector in each row.
    """
    size = 2 * c.wheels.size
    for k in range(s.flight.size):
        mesh = abs(s.code[k])
        xi = saltation_matrix(c, mesh, s.phase[k], s.before[k])
        put(frame, times_transposed(frame, jacobian(c, s.flight[k])))
        _orthonormalise(frame, size, s.growth[k])
        put(frame, times_transposed(frame, xi))
        _orthonormalise(frame, size, s.growth[k])
