"""Rigid walls as the limit of stiff springs with dampers, an independent model of sticking and opening."""

import math

import numpy as np
from reference_dynamics import rates
from scipy.integrate import solve_ivp


def spring_and_damper(epsilon, stiffness):
    """Damping at which a unit mass leaves a spring with epsilon of its speed."""
    log = math.log(epsilon)
    return -2.0 * log / math.hypot(math.pi, log) * math.sqrt(stiffness)


def compliant(c, tau, state, until, stiffness):
    """Solution from a state, with contact forces in the proportions of the impact rules (docs/model.md section 3)."""
    damping = spring_and_damper(c.epsilon, stiffness)

    def push(x, y, wall):
        beyond = x - math.copysign(wall, x)
        return -(stiffness * beyond + damping * y) if beyond * x > 0.0 else 0.0

    def rate(time, s):
        x1, y1, x2, y2 = rates(c, time, s)
        first = push(s[0], s[1], c.wall1)
        second = push(s[2], s[3], c.wall2) if c.stages == 2 else 0.0
        return x1, y1 + first + c.mu * second, x2, y2 + first + second

    return solve_ivp(
        rate, (tau, until), state, method="DOP853", rtol=1e-9, atol=1e-12, max_step=10.0 / math.sqrt(stiffness),
        dense_output=True,
    )  # fmt: skip


def furthest(orbit, since, until, stiffness):
    """Largest distance in x between an orbit and the compliant system started on it, over a stretch of time."""
    used = slice(0, 2 * orbit.constants.stages, 2)
    run = compliant(orbit.constants, since, orbit.state(since), until, stiffness)
    times = np.linspace(since, until, 300)
    return max(float(np.abs(orbit.state(t) - run.sol(t))[used].max()) for t in times)
