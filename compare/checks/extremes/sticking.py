"""Begin and end of sticking phases, for extreme gaps, drag and restitution."""

import math

from rattle.closure import orbit
from rattle.compare.checks.extremes.row import Extreme, farthest, spread, worst_of
from rattle.scene import Scene, Start
from rattle.scene.impact import TOUCH


def chatter_time() -> Extreme:
    """A ball that falls from the middle of the gap completes its chatter after ``(1 + eps) / (1 - eps)`` fall times."""
    errors = []
    for gap in (2.0**-26, 0.5, 2.0**13):
        for pull in (0.01, 1.0, 100.0):  # acceleration by drag, in half gaps per unit of time squared
            fall = math.sqrt(2.0 / pull)
            for epsilon in (0.0, 1e-12, 0.1, 0.5, 0.9, 0.99):
                scene = Scene(
                    alpha=0.0, epsilon=epsilon, beta1=0.0, gamma1=pull * gap, gap1=gap, stages=1, start=Start()
                )
                phases = orbit.follow(scene, 5000).sticking
                closed = phases[0].closed if len(phases) == 1 and math.isinf(phases[0].opened) else math.nan
                exact = fall * (1.0 + epsilon) / (1.0 - epsilon)
                errors.append(farthest(closed, exact, exact))
    return Extreme(
        "completed chatter",
        "epsilon, gamma",
        "epsilon 0 to 0.99; gaps 1e-8 to 8e3; drag 0.01 to 100 gaps",
        "geometric sum of the flights",
        worst_of(errors),
        1e-9,
        "its time",
    )


def sticking_end() -> Extreme:
    """A mesh that drag keeps closed opens when the driver's acceleration exceeds the drag."""
    errors = []
    for size in (2.0**-26, 1.0, 2.0**13):
        for share in (0.3, 0.9, 0.999):  # drag over the largest acceleration of the driver
            for beta in spread(1e-6, 1.0, 3, 0.0):
                most = math.hypot(1.0, beta)  # of |beta cos tau - sin tau|
                scene = Scene(
                    alpha=size,
                    epsilon=0.2,
                    beta1=beta,
                    gamma1=share * most * size,
                    gap1=0.5 * size,
                    stages=1,
                    start=Start(0.0, 0.5 * size, 0.1 * size, 0.0, 0.0, mesh=1),
                )
                phases = [p for p in orbit.follow(scene, 60).sticking if p.opened - p.closed > 0.1]
                # the decreasing zero of share + sin(atan beta - tau)
                exact = [math.asin(share) + math.atan(beta) + 2.0 * math.pi * n for n in range(200)]
                errors.append(math.inf if not phases else 0.0)
                errors += [min(abs(p.opened - e) for e in exact) for p in phases]
    return Extreme(
        "end of a sticking phase",
        "gamma, beta",
        "drag 0.3 to 0.999 of the driver's largest acceleration; beta 0 to 1; sizes 1e-8 to 8e3",
        "root of the contact force",
        worst_of(errors),
        2.0 * TOUCH,
        "unit of time",
    )


ROWS = (chatter_time, sticking_end)
