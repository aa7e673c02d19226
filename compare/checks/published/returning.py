"""Bounces of a randomly accelerated particle on one wall, simulated without a time limit.

Return times are heavy-tailed, ``P(T > t) ~ t^(-1/4)``, so that a fixed step and horizon would truncate them.  But
``x'' = sigma eta`` is self-similar under ``(t, y, x) -> (s^2 t, s y, s^3 x)``.  So the state is rescaled before each
step such that the step is `GROWTH` times the particle's time scale ``max(y^2, d^(2/3)) / sigma^2``, where d is the
distance to the wall.  The logarithm of the accumulated scale is kept separately.  The step itself is one of
`rattle.montecarlo.coupling.dyadic.walk_step` (flow, Brownian bridge bisection near the wall, impact), at the phase
where the modulation of the noise is stationary.  A step fails to return to the wall with a probability of about
``GROWTH^(-1/4)`` and is then followed by another.  The bisection resolves the noise down to a millionth of the time
scale.
"""

import math

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.coupling.dyadic import DEEPEST, HIT, Clockwork, new_room, walk_step
from rattle.montecarlo.noise.philox import STEP, Key, Word, key_of, normals
from rattle.montecarlo.schemes.whole_step import flight_forcing
from rattle.scene import Scene, Start
from rattle.scene.compiled import jit
from rattle.scene.constants import Constants
from rattle.scene.errors import RattleError
from rattle.scene.impact import struck

Floats = NDArray[np.float64]

GROWTH = 64.0
ROW = 4096  # index of the step, such that it begins at 3 pi / 2; the modulation, 1 there, varies by 7e-7 in the step
STEP_TIME = 1.5 * math.pi / ROW
HALF = 1e-3  # half gap; the far wall is 50 typical excursions away
MOST = 200  # steps after which a flight counts as lost; a correct program never needs as many
APART = Word(2**24)  # distance of the random-number counters of two paths


@jit
def _bounce(c: Constants, w: Clockwork, key: Key, log_speed: Floats) -> int:
    """Fill `log_speed`, shape (paths, bounces), with ln of the speed after each impact; return the lost flights."""
    room, hits, state = new_room(w.depth), np.empty((1, HIT)), np.zeros(4)  # room for one impact: it ends the step
    lost = 0
    for p in range(len(log_speed)):
        n, scale, y = Word(p) * APART, 0.0, 1.0
        for bounce in range(log_speed.shape[1]):
            distance, y = 0.0, -y  # positive y is towards the wall
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
    """Tables of the dyadic walk for the single step at the phase 3 pi / 2."""
    f = flight_forcing(c, ROW * STEP_TIME, STEP_TIME)
    table = np.zeros((ROW + 1, 14))
    table[ROW] = (*f.drift, *f.along, *f.across, f.margin1, f.margin2)
    return Clockwork(STEP_TIME, DEEPEST, table, np.array([f.x1y1, f.y1y1, f.x2y1, f.x2y2, f.y2y1, f.y2y2]))


def log_speeds(epsilon: float, paths: int, bounces: int, seed: int) -> Floats:
    """Simulate bounces of a randomly accelerated particle that leaves the wall at speed 1.

    Shapes: result (paths, bounces).
    """
    start = Start(0.0, 0.0, -1.0)
    scene = Scene(alpha=0.0, epsilon=epsilon, beta1=0.0, gamma1=0.0, gap1=HALF, sigma=1.0, start=start, stages=1)
    out = np.empty((paths, bounces))
    lost = _bounce(scene.constants, _clockwork(scene.constants), key_of(np.random.SeedSequence([seed, 2])), out)
    if lost:
        raise RattleError(f"{lost} of {out.size} flights did not return in {MOST} steps, or reached the far wall")
    return out
