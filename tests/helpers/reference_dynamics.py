"""The equations of docs/model.md sections 3 and 4 written a second time: y-form, integrated
numerically, no product formula."""

import math

import numpy as np
from scipy.integrate import solve_ivp

from rattle.scene import Order

SINE = (Order(1),)


def rates(c, tau, s):
    """Right-hand side of Eq. 5 with sigma = 0, state (x1, y1, x2, y2)."""
    _, y1, _, y2 = s
    sine = math.sin(tau)
    cosine = math.cos(tau)
    return (
        y1,
        -c.beta1 * y1 + c.gamma1 + c.alpha * (-sine + c.beta1 * cosine),
        y2,
        -c.beta2 * y2
        + (c.beta2 - c.beta1) * y1
        + c.gamma1
        - c.gamma2
        + c.alpha * (c.beta1 - c.beta2) * cosine,
    )


def drift_matrix(c):
    """A of the linear system s' = A s + ..., from the same equations."""
    return np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [0.0, -c.beta1, 0.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [0.0, c.beta2 - c.beta1, 0.0, -c.beta2],
        ]
    )


def modulation(c, tau, orders=SINE):
    """What one unit of the noise adds to (x1, y1, x2, y2), for a drive ``sum a sin(j tau +
    phase)``."""
    first = sum(o.amplitude * o.order * math.cos(o.order * tau + o.phase) for o in orders)
    second = -sum(o.amplitude * o.order**2 * math.sin(o.order * tau + o.phase) for o in orders)
    return np.array([0.0, second + c.beta1 * first, 0.0, (c.beta1 - c.beta2) * first])


def contact(c, mesh, s):
    """State after an impact, docs/model.md section 3."""
    x1, y1, x2, y2 = s
    if mesh == 1:
        return np.array([x1, -c.epsilon * y1, x2, y2 - (1 + c.epsilon) * y1])
    if mesh == 2:
        return np.array([x1, y1 - (1 + c.epsilon) * c.mu * y2, x2, -c.epsilon * y2])
    return np.array(s, dtype=float)


def fly(c, tau, s, t):
    """State after a flight of time t."""
    return solve_ivp(
        lambda time, z: rates(c, time, z),
        (tau, tau + t),
        s,
        method="DOP853",
        rtol=1e-12,
        atol=1e-14,
    ).y[:, -1]


def first_crossing(c, tau, s, horizon, max_step=0.02):
    """(t, mesh, side, state) of the first outward crossing, or None; blind to excursions shorter
    than a step."""
    walls = [(0, 1, c.wall1), (0, -1, c.wall1), (2, 1, c.wall2), (2, -1, c.wall2)][: 2 * c.stages]
    events = []
    for i, side, wall in walls:

        def beyond(time, z, i=i, side=side, wall=wall):
            return side * z[i] - wall

        beyond.terminal = True
        beyond.direction = 1.0
        events.append(beyond)
    run = solve_ivp(
        lambda time, z: rates(c, time, z),
        (tau, tau + horizon),
        s,
        method="DOP853",
        rtol=1e-12,
        atol=1e-14,
        events=events,
        max_step=max_step,
    )
    for (i, side, _), times, states in zip(walls, run.t_events, run.y_events, strict=True):
        if times.size:
            return times[0] - tau, 1 + i // 2, side, states[0]
    return None


def covariance_flight(c, tau, cov, t):
    """Covariance after a flight, by its own differential equation P' = A P + P A' + sigma^2 m
    m'."""
    a = drift_matrix(c)

    def rate(time, p):
        p = p.reshape(4, 4)
        m = modulation(c, time)
        return (a @ p + p @ a.T + c.sigma**2 * np.outer(m, m)).ravel()

    scale = max(c.sigma**2, float(np.abs(cov).max()), 1e-300)
    run = solve_ivp(
        rate, (tau, tau + t), np.ravel(cov), method="DOP853", rtol=1e-12, atol=1e-14 * scale
    )
    return run.y[:, -1].reshape(4, 4)
