"""Extreme impacts: saltation matrices, grazing hits and near misses, simultaneous impacts, sticking phases."""

import math
from collections.abc import Iterator

import mpmath as mp
import numpy as np

from rattle import montecarlo
from rattle.closure import orbit
from rattle.compare.checks.check import extreme, farthest, spread
from rattle.compare.checks.extremes import truth
from rattle.compare.checks.extremes.formulas import constants
from rattle.scene import Scene, Start, impact, tangent
from rattle.scene.impact import TOUCH

EPSILONS = (0.0, 1e-12, 0.1, math.exp(-math.pi / math.sqrt(3.0)), 0.9, 1.0 - 2.0**-53, 1.0)


@extreme()
def saltation() -> Iterator[float]:
    """Saltation matrix."""
    rng = np.random.default_rng(5)
    for epsilon in EPSILONS:
        for speed in spread(1e-9, 1e4, 8):
            for mesh in (1, 2):
                beta1, beta2, alpha = (float(v) for v in rng.choice(spread(1e-6, 1e3, 4, 0.0), 3))
                gamma1 = float(rng.choice([0.0, 1e4]))
                c = constants(epsilon=epsilon, beta1=beta1, beta2=beta2, alpha=alpha, gamma1=gamma1)
                other, tau = float(rng.normal()), float(rng.uniform(-3.0, 3.0))
                y1, y2 = (speed, other) if mesh == 1 else (other, -speed)
                exact, size = truth.saltation(c, mesh, tau, y1, y2)
                yield farthest(tangent.saltation_matrix(c, mesh, tau, y1, y2), exact, size)


@extreme()
def grazing() -> Iterator[float]:
    """A parabolic flight whose apex passes or misses a wall by a small fraction of the gap."""
    for gap in (1e-8, 0.5, 1e4):
        for share in spread(1e-12, 1e-1, 7):
            for pull in (0.01, 1.0, 100.0):  # acceleration by drag, in half gaps per unit of time squared
                drag = pull * gap
                c = constants(alpha=0.0, beta1=0.0, gamma1=drag, wall1=gap, stages=1)
                for hits in (True, False):
                    rise = gap * (1.0 + share) if hits else gap * (1.0 - share)  # from 0 towards the lower wall
                    y = -math.sqrt(2.0 * drag * rise)
                    t, mesh, side, *_ = impact.next_impact(c, 0.0, 0.0, y, 0.0, 0.0, 1e4)
                    exact, sign, speed = _meet(y, drag, gap)
                    # the wall is known to rounding, so the time to rounding of gap / speed
                    yield farthest(t, exact, exact + gap / speed) if (mesh, side) == (1, sign) else math.inf


@truth.in_digits
def _meet(y: float, drag: float, gap: float) -> tuple[float, int, float]:
    """Time, side and speed at which ``y t + drag t^2 / 2`` meets a wall at distance `gap`."""
    a, v, fall = mp.mpf(drag), mp.mpf(y), 2 * mp.mpf(drag) * mp.mpf(gap)
    side = -1 if v * v > fall else 1
    speed = mp.sqrt(v * v + side * fall)
    return float((-v + side * speed) / a), side, float(speed)


@extreme(allowed=1e-9)
def simultaneous() -> Iterator[float]:
    """Simultaneous impacts at both meshes: mesh 1 comes first, then mesh 2 with the velocity left by it."""
    for gap in (2.0**-27, 0.5, 2.0**13):
        start = Start(0.0, 0.0, 2.0 * gap, 0.0, -3.0 * gap)
        scene = Scene(alpha=0.0, epsilon=0.5, beta1=0.0, gamma1=0.0, mu=0.25, gap1=gap, gap2=1.5 * gap, start=start)
        # at tau = 1/2: mesh 1 at +gap1 and mesh 2 at -gap2; the impact at mesh 1 leaves y = (-gap, -6 gap)
        exact: dict[str, list[float]] = {"tau": [0.5, 0.5], "flight": [0.5, 0.0], "mesh": [1, 2], "side": [1, -1]}
        lengths = {"x1": [1.0, 1.0], "y1": [2.0, -1.0], "x2": [-1.5, -1.5], "y2": [-3.0, -6.0]}  # in gaps
        followed = orbit.follow(scene, 2)
        found = {"tau": followed.tau[1:], "flight": np.diff(followed.tau), "mesh": followed.mesh[1:]}
        sides = [found | {"side": followed.side[1:]} | dict(zip(lengths, followed.before[1:].T, strict=True))]
        for scheme in ("euler-maruyama-located", "exact-flight"):
            sides.append(dict(montecarlo.simulate(scene, paths=1, impacts=2, scheme=scheme, dt=2.0**-7).columns))
        for side in sides:
            yield from (farthest(side[name], exact[name]) for name in exact)
            yield from (farthest(side[name] / gap, lengths[name]) for name in lengths)


@extreme(allowed=1e-9)
def chatter_time() -> Iterator[float]:
    """A ball that falls from the middle of the gap completes its chatter after ``(1 + eps) / (1 - eps)`` fall times."""
    for gap in (2.0**-26, 0.5, 2.0**13):
        for pull in (0.01, 1.0, 100.0):  # acceleration by drag, in half gaps per unit of time squared
            drag, fall = pull * gap, math.sqrt(2.0 / pull)
            for epsilon in (0.0, 1e-12, 0.1, 0.5, 0.9, 0.99):
                scene = Scene(alpha=0.0, epsilon=epsilon, beta1=0.0, gamma1=drag, gap1=gap, stages=1, start=Start())
                phases = orbit.follow(scene, 5000).sticking
                closed = phases[0].closed if len(phases) == 1 and math.isinf(phases[0].opened) else math.nan
                exact = fall * (1.0 + epsilon) / (1.0 - epsilon)
                yield farthest(closed, exact, exact)


@extreme(allowed=2.0 * TOUCH)
def sticking_end() -> Iterator[float]:
    """A mesh that drag keeps closed opens when the driver's acceleration exceeds the drag."""
    for size in (2.0**-26, 1.0, 2.0**13):
        start = Start(0.0, 0.5 * size, 0.1 * size, 0.0, 0.0, mesh=1)
        for share in (0.3, 0.9, 0.999):  # drag over the largest acceleration of the driver
            for beta in spread(1e-6, 1.0, 3, 0.0):
                drag = share * math.hypot(1.0, beta) * size  # the driver's is |beta cos tau - sin tau|
                scene = Scene(alpha=size, epsilon=0.2, beta1=beta, gamma1=drag, gap1=0.5 * size, stages=1, start=start)
                phases = [p for p in orbit.follow(scene, 60).sticking if p.opened - p.closed > 0.1]
                # the decreasing zero of share + sin(atan beta - tau)
                exact = [math.asin(share) + math.atan(beta) + 2.0 * math.pi * n for n in range(200)]
                yield math.inf if not phases else 0.0
                yield from (min(abs(p.opened - e) for e in exact) for p in phases)
