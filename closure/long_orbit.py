"""Orbits of any length, computed a stretch of impacts at a time, with the growth of their neighbours.

Times are kept modulo the period of the excitation, so that the accuracy does not decrease along the orbit.
"""

import math

import numpy as np
from numpy.typing import NDArray

from rattle.closure.orbit import HORIZON
from rattle.scene.compiled import jit
from rattle.scene.constants import Constants
from rattle.scene.flight import flow
from rattle.scene.impact import REST, next_impact, struck
from rattle.scene.scene import Scene
from rattle.scene.sticking import complete_chatter
from rattle.scene.tangent import Stretch, carry_frame, strike_frame

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PERIOD = 2.0 * math.pi


@jit
def _stretch(
    c: Constants,
    tangent: bool,
    at: Floats,
    frame: Floats,
    flight: Floats,
    phase: Floats,
    code: Ints,
    before: Floats,
    growth: Floats,
) -> tuple[int, int]:
    """Fill the arrays with impacts from ``at = (tau, x1, y1, x2, y2)`` on, up to a sticking phase; updates `at`.

    Returns the number of impacts, and 1 or a code of `MISSES`.
    """
    tau, x1, y1, x2, y2 = at[0], at[1], at[2], at[3], at[4]
    for k in range(flight.size):
        t, mesh, side, x1, y1, x2, y2 = next_impact(c, tau, x1, y1, x2, y2, HORIZON)
        if mesh <= 0:
            return k, mesh
        tau = (tau + t) % PERIOD
        flight[k], phase[k], code[k] = t, tau, mesh * side
        before[k, 0], before[k, 1], before[k, 2], before[k, 3] = x1, y1, x2, y2
        if tangent:
            carry_frame(c, t, frame)
            strike_frame(c, mesh, tau, y1, y2, frame, growth[k])
        y1, y2 = struck(c, mesh, y1, y2)
        if complete_chatter(c, tau, x1, y1, x2, y2, mesh, side)[0] < math.inf:
            return k + 1, REST
    at[0], at[1], at[2], at[3], at[4] = tau, x1, y1, x2, y2
    return flight.size, 1


@jit
def _sample(c: Constants, step: float, s: Stretch, velocity: Floats) -> int:
    """Write ``(y1, y2)`` at equal time steps of a stretch; returns how many rows."""
    n, t = 0, 0.0
    for k in range(s.flight.size - 1):
        y1, y2 = struck(c, abs(s.code[k]), s.before[k, 1], s.before[k, 3])
        while t < s.flight[k + 1] and n < len(velocity):
            _, velocity[n, 0], _, velocity[n, 1] = flow(c, s.phase[k], s.before[k, 0], y1, s.before[k, 2], y2, t)
            n += 1
            t += step
        t -= s.flight[k + 1]
    return n


class LongOrbit:
    """The deterministic orbit of a scene from one of many starts, followed a stretch at a time.

    `start`: 0 for the scene's own start; start number n is the same state at a phase later by n times 0.618
    periods (the golden ratio, so that the phases of many starts are spread evenly).

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> orbit = LongOrbit(Scene.from_gears(DAT21))
    >>> s = orbit.stretch(3)
    >>> s.code.tolist(), s.growth.shape
    ([-1, 2, -1], (3, 4))
    """

    def __init__(self, scene: Scene, start: int = 0) -> None:
        self.c = scene.noise_free.constants
        x1, y1, x2, y2 = scene.noise_free.start_state
        if scene.start.mesh != 0:
            y1, y2 = struck(self.c, scene.start.mesh, y1, y2)
        tau = (scene.phase + start * PERIOD * (math.sqrt(5.0) - 1.0) / 2.0) % PERIOD
        self.at = np.array([tau, x1, y1, x2, y2])
        self.frame = np.eye(4)
        self.ended = 1

    def stretch(self, impacts: int, tangent: bool = True) -> Stretch:
        """The next impacts of the orbit.

        Returns: Fewer impacts where the orbit has ended; the attribute `ended` is then a code of
        `rattle.scene.impact.MISSES`.
        """
        flight, phase, code = np.empty(impacts), np.empty(impacts), np.empty(impacts, np.int64)
        before, growth = np.empty((impacts, 4)), np.zeros((impacts, 4))
        n = 0
        if self.ended > 0:
            n, self.ended = _stretch(self.c, tangent, self.at, self.frame, flight, phase, code, before, growth)
        return Stretch(flight, phase, code, before, growth).first(n)


def velocities(scene: Scene, s: Stretch, step: float) -> Floats:
    """``(y1, y2)`` at equal time steps from the first to the last impact of a stretch of the orbit.

    Shapes: result (steps, 2).

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> scene = Scene.from_gears(DAT21)
    >>> velocities(scene, LongOrbit(scene).stretch(100), 0.05).shape[1]
    2
    """
    velocity = np.empty((int(s.flight[1:].sum() / step) + 2, 2))
    return velocity[: _sample(scene.noise_free.constants, step, s, velocity)]
