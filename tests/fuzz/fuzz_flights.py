"""Without noise every flight of every path is that of Eq. 3, within the order of its scheme.

Each flight is judged by itself, from where the path was at the impact before: what one flight leaves, the next makes
worse by as much as the orbit is unstable, and that is no error of the scheme.
"""

import math

import numpy as np
from fuzz_must import must

from rattle.montecarlo import Ensemble
from rattle.scene.constants import Constants
from rattle.scene.flight import flow, wheel_speeds
from rattle.scene.impact import struck

__all__ = ["follows_the_flow"]

PATHS, FLIGHTS, INSTANTS = 3, 8, 16  # paths, flights of each, and times in a flight that are checked
CLOSE = 1e-7  # admissible error of exact flights, relative to gap and speed
STEPS = 4.0  # admissible error of the Euler schemes, in steps
LATE = {"euler-maruyama": 1.0, "euler-maruyama-located": 0.0, "exact-flight": 0.0}
"""Steps by which an impact is late."""


def follows_the_flow(run: Ensemble) -> None:
    """Compare the first flights of the first paths of a run without noise with the flow."""
    scene, c = run.scene, run.scene.constants
    if scene.sigma > 0.0 or run.sticking_steps or run.raw is None:
        return
    dt, late = (0.0 if run.scheme == "exact-flight" else run.dt), LATE[run.scheme]
    for rows in np.asarray(run.raw)[:PATHS]:
        rows = rows[~np.isnan(rows[:, 0])]
        known = scene.tolerance is None or scene.tolerance.distribution == "fixed"
        before = (scene.phase, *scene.start_state, scene.start.mesh) if known else None
        for tau, flight, x1, y1, x2, y2, code in rows[:FLIGHTS]:
            if before is not None:
                _one_flight(c, before, flight, (x1, y1, x2, y2), dt, late, scene.windows)
            before = (tau, x1, y1, x2, y2, int(abs(code)))


def _one_flight(
    c: Constants, before: tuple[float, ...], flight: float, end: tuple[float, ...], dt: float, late: float,
    windows: tuple[float, float],
) -> None:  # fmt: skip
    tau, x1, y1, x2, y2, mesh = before
    if c.stages == 1:
        x2 = y2 = 0.0
    if mesh:
        y1, y2 = struck(c, int(mesh), y1, y2)
    u1, u2 = wheel_speeds(c, tau, y1, y2)
    pulls = [b * abs(u) + g for b, u, g in ((c.beta1, u1, c.gamma1), (c.beta2, u2, c.gamma2))]
    drawn = c.alpha * math.hypot(1.0, c.beta1) + max(pulls) * 2.0  # largest acceleration
    met = abs(before[2]) + abs(before[4])  # what came later in the same step had begun at these speeds
    speed = max(abs(y1) + abs(y2), met) + drawn * flight
    rate = c.alpha + (1.0 + c.beta1 + c.beta2) * drawn  # of an acceleration
    blurred = 4.0 * np.spacing(abs(tau) + flight)  # of a flight that is the difference of two times
    wrong_y = STEPS * dt * (drawn + rate * flight) + CLOSE * speed + blurred * drawn
    wrong_x = STEPS * dt * (flight + dt) * (drawn + rate * flight) + CLOSE * speed * flight
    wrong_x += (late * dt + blurred) * speed
    found = flow(c, tau, x1, y1, x2, y2, flight)
    for i in range(c.stages):
        slack = wrong_x + CLOSE * windows[i]
        away = abs(found[2 * i] - end[2 * i])
        must(away <= slack, f"x{i + 1} leaves the flow:", found, end, slack, before, flight)
        must(
            abs(found[2 * i + 1] - end[2 * i + 1]) <= wrong_y, f"y{i + 1} leaves the flow", found, end, wrong_y, before
        )
    most = [max(windows[i], abs((x1, x2)[i])) for i in range(c.stages)]  # a stage may be left beyond its wall
    for t in np.linspace(0.0, flight, INSTANTS + 1)[:-1]:
        place = flow(c, tau, x1, y1, x2, y2, t)
        for i in range(c.stages):
            must(abs(place[2 * i]) <= most[i] * (1.0 + CLOSE) + wrong_x, "flew through a wall", place, before, t)
