"""The bouncing ball: under constant drag flights form a geometric series, and chatter is completed in finite time."""

import numpy as np
from numpy.typing import NDArray

from rattle.closure.orbit import follow
from rattle.compare.checks.check import Check, Result
from rattle.montecarlo import Record, simulate
from rattle.montecarlo.schemes.crossing import CLOSE
from rattle.scene import Scene, Start

Floats = NDArray[np.float64]

GAMMA, EPSILON, SPEED, HALF = 1.0, 0.7, 1.0, 0.5
IMPACTS = 12  # impacts of the simulated path
ROUNDING = 1e-15 + 4e-16 * HALF  # distance within which the orbit locates a wall


def _checks(who: str, tau: Floats, close: float, epsilon: float) -> list[Check]:
    """Worst flight time, and the time to rest; impacts are located within `close` of their wall."""
    flights = np.diff(tau)
    first = 2.0 * epsilon * SPEED / GAMMA
    speeds = 0.5 * GAMMA * flights
    slack = 2.0 * close / speeds[-1] / (1.0 - EPSILON)  # in time: close / speed at both ends of each flight
    k = np.arange(flights.size)
    worst = int(np.argmax(np.abs(flights - first * epsilon**k)))
    exact = first * epsilon**worst
    rest = float(tau[-1] - tau[0] + flights[-1] * epsilon / (1.0 - epsilon))
    return [
        Check(f"flight {worst + 1} of {flights.size}, {who}", float(flights[worst]), exact, 0.0, slack),
        Check(f"time to rest, {who}", rest, first / (1.0 - epsilon), 0.0, slack),
    ]


def bouncing_ball(seed: int = 0, workers: int = 2) -> Result:
    """Check flights and time to rest of one stage under constant drag, for the orbit and for a simulated path.

    With ``alpha = beta = sigma = 0`` Eq. 3 is ``y' = gamma``: an impact at speed v is followed by a flight of
    ``2 epsilon v / gamma`` and an impact at ``epsilon v``, so that all flights add up to ``t1 / (1 - epsilon)``.
    """
    start = Start(0.0, HALF, SPEED, mesh=1)
    scene = Scene(alpha=0.0, epsilon=EPSILON, beta1=0.0, gamma1=GAMMA, gap1=HALF, start=start, stages=1)
    orbit = follow(scene, 40)
    run = simulate(scene, paths=1, impacts=IMPACTS, scheme="exact-flight", record=Record(raw=True))
    assert run.raw is not None
    sides = {"orbit": (orbit.tau, ROUNDING), "exact-flight": (np.append(0.0, run.raw[0, :, 0]), CLOSE * HALF)}

    def checks(epsilon: float) -> list[Check]:
        return [check for who, (tau, close) in sides.items() for check in _checks(who, tau, close, epsilon)]

    return Result(
        "bouncing-ball sum",
        "Luck & Mehta 1993",
        "under constant drag flights shrink by epsilon and add up to t1 / (1 - epsilon): the orbit, simulate()",
        checks(EPSILON),
        {
            "epsilon 1 % larger": checks(1.01 * EPSILON),
            "epsilon squared": checks(EPSILON**2),
        },
    )
