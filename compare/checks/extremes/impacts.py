"""Extreme impacts: saltation matrices, grazing hits and near misses, simultaneous impacts at both meshes."""

import math

import numpy as np

from rattle import montecarlo
from rattle.closure import orbit
from rattle.compare.checks.extremes import truth
from rattle.compare.checks.extremes.flights import constants
from rattle.compare.checks.extremes.row import ROUNDING, Extreme, farthest, spread, worst_of
from rattle.scene import Scene, Start, impact, tangent

EPSILONS = (0.0, 1e-12, 0.1, math.exp(-math.pi / math.sqrt(3.0)), 0.9, 1.0 - 2.0**-53, 1.0)


def saltation() -> Extreme:
    """Saltation matrix."""
    rng, errors = np.random.default_rng(5), []
    for epsilon in EPSILONS:
        for speed in spread(1e-9, 1e4, 8):
            for mesh in (1, 2):
                beta1, beta2, alpha = (float(v) for v in rng.choice(spread(1e-6, 1e3, 4, 0.0), 3))
                c = constants(
                    epsilon=epsilon, beta1=beta1, beta2=beta2, alpha=alpha, gamma1=float(rng.choice([0.0, 1e4]))
                )
                other, tau = float(rng.normal()), float(rng.uniform(-3.0, 3.0))
                y1, y2 = (speed, other) if mesh == 1 else (other, -speed)
                exact, size = truth.saltation(c, mesh, tau, y1, y2)
                found = tangent.saltation_matrix(c, mesh, tau, y1, y2)
                errors.append(farthest(found, exact, np.maximum(size, 1e-300)))
    return Extreme(
        "saltation matrix",
        "epsilon",
        "epsilon 0 to 1, speed 1e-9 to 1e4, beta 0 to 1e3",
        "MODEL 6 in 400 digits",
        worst_of(errors),
        ROUNDING,
        "the sum of its terms",
    )


def grazing() -> Extreme:
    """A parabolic flight whose apex passes or misses a wall by a small fraction of the gap."""
    errors = []
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
                    if (mesh, side) != (1, sign):
                        errors.append(math.inf)
                    else:  # the wall is known to rounding, so the time to rounding of gap / speed
                        errors.append(farthest(t, exact, exact + gap / speed))
    return Extreme(
        "grazing hit, and near miss",
        "gap",
        "past the wall by 1e-12 to 0.1 of a gap of 1e-8, 0.5, 1e4",
        "roots of a parabola",
        worst_of(errors),
        ROUNDING,
        "flight, gap over speed",
    )


@truth.in_digits
def _meet(y: float, drag: float, gap: float) -> tuple[float, int, float]:
    """Time, side and speed at which ``y t + drag t^2 / 2`` meets a wall at distance `gap`."""
    import mpmath as mp

    a, v, g = mp.mpf(drag), mp.mpf(y), mp.mpf(gap)
    if v * v > 2 * a * g:
        speed = mp.sqrt(v * v - 2 * a * g)
        return float((-v - speed) / a), -1, float(speed)
    speed = mp.sqrt(v * v + 2 * a * g)
    return float((-v + speed) / a), 1, float(speed)


def simultaneous() -> Extreme:
    """Simultaneous impacts at both meshes: mesh 1 comes first, then mesh 2 with the velocity left by it."""
    errors = []
    for gap in (2.0**-27, 0.5, 2.0**13):
        start = Start(0.0, 0.0, 2.0 * gap, 0.0, -3.0 * gap)
        scene = Scene(alpha=0.0, epsilon=0.5, beta1=0.0, gamma1=0.0, mu=0.25, gap1=gap, gap2=1.5 * gap, start=start)
        # at tau = 1/2: mesh 1 at +gap1 and mesh 2 at -gap2; the impact at mesh 1 leaves y = (-gap, -6 gap)
        exact: dict[str, list[float]] = {
            "tau": [0.5, 0.5],
            "flight": [0.5, 0.0],
            "mesh": [1, 2],
            "side": [1, -1],
            "x1": [gap, gap],
            "y1": [2.0 * gap, -gap],
            "x2": [-1.5 * gap] * 2,
            "y2": [-3.0 * gap, -6.0 * gap],
        }
        followed = orbit.follow(scene, 2)
        found = {"tau": followed.tau[1:], "flight": np.diff(followed.tau), "mesh": followed.mesh[1:]}
        found |= {"side": followed.side[1:]} | dict(zip(("x1", "y1", "x2", "y2"), followed.before[1:].T, strict=True))
        sides = [found]
        for scheme in ("euler-maruyama-located", "exact-flight"):
            sides.append(dict(montecarlo.simulate(scene, paths=1, impacts=2, scheme=scheme, dt=2.0**-7).columns))
        units = {"tau": 1.0, "flight": 1.0, "mesh": 1.0, "side": 1.0}
        for side in sides:
            errors += [farthest(side[name], exact[name], units.get(name, gap)) for name in exact]
    return Extreme(
        "simultaneous impacts at both meshes",
        "gap1, gap2",
        "gaps 7e-9 to 8e3; the orbit, located Euler, exact flights",
        "restitution maps by hand",
        worst_of(errors),
        1e-9,
        "gap, unit of time",
    )


ROWS = (saltation, grazing, simultaneous)
