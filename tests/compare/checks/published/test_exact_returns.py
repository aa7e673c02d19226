"""The return-speed result holds for the step of ``exact-flight``, which follows no tree of the noise."""

import math

import numpy as np

from rattle.compare.checks.check import limit
from rattle.compare.checks.published.noise import MEAN
from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.noise.philox import BRIDGE, STEP, Word, key_of, normals
from rattle.montecarlo.schemes.exact_flight import PARTS, advance_exactly
from rattle.montecarlo.schemes.step_state import Progress, Walls
from rattle.scene import Scene, Start
from rattle.scene.compiled import jit
from rattle.scene.drive import sine_cosine

GROWTH, STEP_TIME, NEAR, FAR, MOST, CALLS = 64.0, 1e-4, 1e-5, 1.0, 200, Word(2**16)
NOWHERE = (0.0, 0.0, 0.0, 0.0)


@jit
def _returns(c, key, log_speed):
    """Wall at 0, particle below it; impacts are found to 1e-10 of NEAR, 5e-7 of a particle's own scale."""
    walls, tau, h = Walls(0.0, FAR, FAR, FAR), -0.5 * (math.pi + STEP_TIME), STEP_TIME
    room = np.empty((PARTS, 3))
    for p in range(log_speed.size):
        x, y, scale = 0.0, -1.0, 0.0
        for n in range(MOST):
            s = math.sqrt(h / (GROWTH * max(y * y, abs(x) ** (2.0 / 3.0))))
            x, y, scale = s**3 * x, s * y, scale - math.log(s)
            z0, z1, _, _ = normals(key, Word(p), Word(n), Word(STEP))
            noise = Noise(math.sqrt(h) * z0, math.sqrt(h / 12.0) * z1)
            at = Progress(0, tau, h, noise, x, y, 0.0, 0.0)
            phase = sine_cosine(at.tau)
            at, _ = advance_exactly(
                c, key, Word(p), Word(n) * CALLS, Word(BRIDGE), at, phase, NOWHERE, False, walls, room
            )  # fmt: skip
            x, y = at.x1, at.y1
            if at.code != 0:
                break
        log_speed[p] = scale + math.log(y)


def test_steps_of_exact_flight_obey_the_published_result():
    """A trial step is cut depending on its end; drawing the end anew instead of keeping it made E ln rho 1.93."""
    start, ln = Start(0.0, 0.0, -1.0), np.empty(40_000)
    scene = Scene(alpha=0.0, epsilon=1.0, beta1=0.0, gamma1=0.0, gap1=NEAR, sigma=1.0, start=start, stages=1)
    _returns(scene.constants, key_of(np.random.SeedSequence(3)), ln)
    assert abs(ln.mean() - MEAN) < limit(1) * ln.std() / math.sqrt(ln.size)
