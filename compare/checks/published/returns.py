"""A randomly accelerated particle at a wall: its speed on return, and the restitution below which it collapses.

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
from scipy.integrate import quad

from rattle.compare.checks.check import Check, Found, self_test
from rattle.montecarlo.coupling.dyadic import DEEPEST, HIT, Tree, clockwork_of, new_room, walk_step
from rattle.montecarlo.noise.philox import STEP, Word, key_of, normals
from rattle.montecarlo.schemes.whole_step import flight_forcing
from rattle.scene import Scene, Start
from rattle.scene.compiled import jit
from rattle.scene.errors import RattleError
from rattle.scene.impact import struck
from rattle.scene.types import Floats

GROWTH = 64.0
ROW = 4096  # index of the step, such that it begins at 3 pi / 2; the modulation, 1 there, varies by 7e-7 in the step
STEP_TIME = 1.5 * math.pi / ROW
HALF = 1e-3  # half gap; the far wall is 50 typical excursions away
MOST = 200  # steps after which a flight counts as lost; a correct program never needs as many
APART = Word(2**24)  # distance of the random-number counters of two paths


@jit
def _bounce(tree: Tree, log_speed: Floats) -> int:
    """Fill `log_speed`, shape (paths, bounces), with ln of the speed after each impact; return the lost flights."""
    c, w, hits, state = tree.c, tree.clock, np.empty((1, HIT)), np.zeros(4)  # one hit: it ends the step
    room = new_room(w.depth)
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
                z0, z1, _, _ = normals(tree.key, n, Word(ROW), Word(STEP))
                met, _ = walk_step(tree, room, n, ROW, (z0, z1), state, hits)
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


def log_speeds(epsilon: float, paths: int, bounces: int, seed: int) -> Floats:
    """Simulate bounces of a randomly accelerated particle that leaves the wall at speed 1.

    Shapes: result (paths, bounces).
    """
    start = Start(0.0, 0.0, -1.0)
    scene = Scene(alpha=0.0, epsilon=epsilon, beta1=0.0, gamma1=0.0, gap1=HALF, sigma=1.0, start=start, stages=1)
    whole = flight_forcing(scene.constants, ROW * STEP_TIME, STEP_TIME)  # of the single step, at the phase 3 pi / 2
    clock, out = clockwork_of([whole] * (ROW + 1), STEP_TIME, DEEPEST), np.empty((paths, bounces))
    lost = _bounce(Tree(scene.constants, clock, key_of(np.random.SeedSequence([seed, 2]))), out)
    if lost:
        raise RattleError(f"{lost} of {out.size} flights did not return in {MOST} steps, or reached the far wall")
    return out


MEAN = math.pi / math.sqrt(3.0)
"""E ln rho, rho being the ratio of consecutive speeds, with the density ``3 / (2 pi) rho^(3/2) / (1 + rho^3)``."""

VARIANCE = 4.0 * math.pi**2 / 9.0
"""Var ln rho."""

RETURNS = 300_000
ORDERS = (-0.6, -0.3, 0.1)
"""Orders s of the moments E rho^s; E rho^(4 s) is finite too, so that standard errors can be estimated."""
BELOW, ABOVE = 0.12, 0.22  # restitutions below and above the critical one, exp(-MEAN) = 0.163
PATHS, BOUNCES = 20_000, 8


@self_test
def return_speed(seed: int = 0, workers: int = 2) -> Found:
    """Check mean and variance of ln rho, and P(rho < 1), over `RETURNS` flights that start at speed 1."""
    flights = log_speeds(1.0, RETURNS, 1, seed)[:, 0]
    slower = quad(lambda r: 1.5 / math.pi * r**1.5 / (1.0 + r**3), 0.0, 1.0)[0]

    def checks(mean: float = MEAN, variance: float = VARIANCE, ln: Floats = flights) -> list[Check]:
        own, share = float(ln.var()), float((ln < 0.0).mean())
        fourth = float(((ln - ln.mean()) ** 4).mean())
        return [
            Check("E ln rho", float(ln.mean()), mean, math.sqrt(own / RETURNS)),
            Check("Var ln rho", own, variance, math.sqrt((fourth - own**2) / RETURNS)),
            Check("P(rho < 1)", share, slower, math.sqrt(share * (1.0 - share) / RETURNS)),
        ]

    return checks(), {
        "mean 3 % larger": checks(mean=1.03 * MEAN),
        "variance 3 % smaller": checks(variance=0.97 * VARIANCE),
        "an impact that keeps 97 %": checks(ln=flights + math.log(0.97)),
    }


@self_test
def return_moments(seed: int = 0, workers: int = 2) -> Found:
    """Check moments of the ratio of consecutive speeds, ``E rho^s = 1 / (2 cos(pi (1 + s) / 3))``."""
    ln = log_speeds(1.0, RETURNS, 1, seed + 2)[:, 0]
    powers = {s: np.exp(s * ln) for s in ORDERS}

    def checks(wrong: float = 1.0, shifted: float = 0.0) -> list[Check]:
        truth = {s: wrong / (2.0 * math.cos(math.pi * (1.0 + s + shifted) / 3.0)) for s in ORDERS}
        return [
            Check(f"E rho^{s:g}", float(power.mean()), truth[s], float(power.std()) / math.sqrt(RETURNS))
            for s, power in powers.items()
        ]

    return checks(), {"moments 1 % larger": checks(wrong=1.01), "orders 0.02 larger": checks(shifted=0.02)}


def mean_drift(epsilon: float, paths: int, bounces: int, seed: int) -> tuple[float, float]:
    """Mean change of ln speed per bounce, and its standard error."""
    whole = log_speeds(epsilon, paths, bounces, seed)[:, -1] / bounces
    return float(whole.mean()), float(whole.std()) / math.sqrt(paths)


@self_test
def critical_restitution(seed: int = 0, workers: int = 2) -> Found:
    """Check the drift of ln speed per bounce below and above the critical restitution, and where it is zero."""
    (d0, s0), (d1, s1) = (mean_drift(eps, PATHS, BOUNCES, seed + i) for i, eps in enumerate((BELOW, ABOVE)))
    span = math.log(ABOVE / BELOW)
    share = -d0 / (d1 - d0)  # linear interpolation in ln epsilon to zero drift
    zero = BELOW * math.exp(span * share)
    se = zero * span / (d1 - d0) * float(np.hypot((1.0 - share) * s0, share * s1))

    def checks(power: float = 1.0, mean: float = MEAN) -> list[Check]:
        return [
            Check(f"drift per bounce at epsilon {BELOW:g}", d0, power * math.log(BELOW) + mean, s0),
            Check(f"drift per bounce at epsilon {ABOVE:g}", d1, power * math.log(ABOVE) + mean, s1),
            Check("critical restitution", zero if d0 < 0.0 < d1 else math.nan, math.exp(-mean / power), se),
        ]

    return checks(), {"mean 3 % larger": checks(mean=1.03 * MEAN), "epsilon squared": checks(power=2.0)}
