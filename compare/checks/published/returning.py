"""Bounces of a randomly accelerated particle on one wall, without an end in time.

Return times are heavy-tailed, ``P(T > t) ~ t^(-1/4)``: no fixed step reaches them all.  But ``x'' = sigma eta`` is the
same at every scale, ``(t, y, x) -> (s^2 t, s y, s^3 x)``.  So before each step the state is brought to the scale at
which the step is `GROWTH` times its memory ``max(y^2, d^(2/3)) / sigma^2``, d its distance to the wall; the step is one
of the project's own (`rattle.montecarlo.coupling.dyadic.walk_step`: flow, noise cut in halves where the wall may be
near, impact) at the phase where the modulation is stationary; and the scales are kept apart, in their logarithm.  Every
step but a share of about ``GROWTH^(-1/4)`` ends at the wall.  Nothing is truncated; noise is smooth below a millionth
of the memory.
"""

import math

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.coupling.dyadic import DEEPEST, HIT, Clockwork, new_room, walk_step
from rattle.montecarlo.noise.philox import STEP, Key, Word, key_of, normals
from rattle.montecarlo.schemes.exact_flight import flight_forcing
from rattle.scene import Scene, Start
from rattle.scene.compiled import jit
from rattle.scene.errors import RattleError
from rattle.scene.impact import struck
from rattle.scene.scene import Constants

__all__ = ["log_speeds"]

Floats = NDArray[np.float64]

GROWTH = 64.0
ROW = 4096  # the step's number: it begins at 3 pi / 2 and the modulation, 1 there, strays by 7e-7 in it
STEP_TIME = 1.5 * math.pi / ROW
HALF = 1e-3  # half gap: the far wall is 50 excursions of a step away
MOST = 200  # steps of one flight, far beyond the longest of a correct program
APART = Word(2**24)  # numbers of a path's steps


@jit
def _bounce(c: Constants, w: Clockwork, key: Key, log_speed: Floats) -> int:
    """Fill `log_speed`, shape (paths, bounces), with ln of the speed after each impact; flights without an end."""
    room, hits, state = new_room(w.depth), np.empty((1, HIT)), np.zeros(4)  # a step ends with its first impact
    lost = 0
    for p in range(len(log_speed)):
        n, scale, y = Word(p) * APART, 0.0, 1.0
        for bounce in range(log_speed.shape[1]):
            distance, y = 0.0, -y  # y is towards the wall
            met = 0
            for _ in range(MOST):
                s = math.sqrt(w.h * c.sigma**2 / (GROWTH * max(y * y, (distance * c.sigma**2) ** (2.0 / 3.0))))
                scale -= math.log(s)
                state[0], state[1] = c.wall1 - s**3 * distance, s * y
                z0, z1, _, _ = normals(key, n, Word(ROW), Word(STEP))
                met, _ = walk_step(c, w, room, key, n, ROW, (z0, z1), state, hits)
                n += Word(1)
                if met > 0:
                    break
                distance, y = c.wall1 - state[0], state[1]
            if met == 0 or hits[0, 1] != 1.0:
                lost += 1
                continue
            y = -struck(c, 1, hits[0, 3], 0.0)[0]
            log_speed[p, bounce] = scale + math.log(y)
    return lost


def _clockwork(c: Constants) -> Clockwork:
    """Of one short step at the phase 3 pi / 2 alone."""
    f = flight_forcing(c, ROW * STEP_TIME, STEP_TIME)
    table = np.zeros((ROW + 1, 14))
    table[ROW] = (*f.drift, *f.along, *f.across, f.margin1, f.margin2)
    return Clockwork(STEP_TIME, DEEPEST, table, np.array([f.x1y1, f.y1y1, f.x2y1, f.x2y2, f.y2y1, f.y2y2]))


def log_speeds(epsilon: float, paths: int, bounces: int, seed: int) -> Floats:
    """ln of the speed after each of `bounces` impacts, shape (paths, bounces), from a speed 1 off the wall.

    Parameters
    ----------
    epsilon : float
        Restitution, above 0.
    paths, bounces, seed : int

    Raises
    ------
    RattleError
        If a flight has no end within `MOST` steps, each 64 times as long as the particle's memory.

    Examples
    --------
    >>> log_speeds(0.2, paths=5, bounces=3, seed=1).shape
    (5, 3)
    """
    start = Start(0.0, 0.0, -1.0)
    scene = Scene(alpha=0.0, epsilon=epsilon, beta1=0.0, gamma1=0.0, gap1=HALF, sigma=1.0, start=start, stages=1)
    out = np.empty((paths, bounces))
    lost = _bounce(scene.constants, _clockwork(scene.constants), key_of(np.random.SeedSequence([seed, 2])), out)
    if lost:
        raise RattleError(f"{lost} of {out.size} flights had no end in {MOST} steps, or one at the far wall")
    return out
