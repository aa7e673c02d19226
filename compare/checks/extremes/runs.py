"""Long runs: conservation of energy and timing over ten million impacts, and the phase of a periodic forced motion."""

import math
from collections.abc import Iterator

import numpy as np

from rattle.closure import long_orbit
from rattle.compare.checks.extremes.extreme import extreme, farthest
from rattle.scene import Scene, Start

IMPACTS, STRETCH = 10_000_000, 500_000
PERIODS = 1_000_000


@extreme(
    "energy over 1e7 impacts",
    "epsilon = 1, all else 0",
    "1e7 impacts at two meshes",
    "conservation",
    allowed=1e-9,
    unit="the energy",
)
def energy() -> Iterator[float]:
    """Elastic impacts at both meshes without excitation, damping or drag conserve energy."""
    speed1, speed2, mu = 1.3, -0.7, 0.6
    start = Start(0.0, 0.1, speed1, -0.2, speed2)
    orbit = long_orbit.LongOrbit(
        Scene(alpha=0.0, epsilon=1.0, beta1=0.0, gamma1=0.0, mu=mu, gap1=0.5, gap2=0.7, start=start)
    )
    heavy = mu / (1.0 - mu)  # mass of wheel 2 over that of wheel 1
    most = 0.5 * (speed1**2 + heavy * (speed2 - speed1) ** 2)
    for _ in range(IMPACTS // STRETCH):
        s = orbit.stretch(STRETCH, tangent=False)
        y1, y2 = s.before[:, 1], s.before[:, 3]
        yield farthest(0.5 * (y1**2 + heavy * (y2 - y1) ** 2), most, most)
        yield 0.0 if len(s.flight) == STRETCH else math.inf


@extreme(
    "speed, displacement, phase over 1e7 impacts",
    "epsilon = 1, all else 0",
    "1e7 impacts at one mesh",
    "gap over speed",
    allowed=1e-6,
    unit="each; phase in radians",
)
def elastic_flights() -> Iterator[float]:
    """Elastic impacts at one mesh: every flight takes gap over speed, and the phase is the sum of the flights."""
    speed, gap = 1.7, 0.5
    start = Start(0.0, gap, speed, mesh=1)
    orbit = long_orbit.LongOrbit(Scene(alpha=0.0, epsilon=1.0, beta1=0.0, gamma1=0.0, gap1=gap, start=start, stages=1))
    flight = 2.0 * gap / speed
    for k in range(IMPACTS // STRETCH):
        s = orbit.stretch(STRETCH, tangent=False)
        yield farthest(s.flight, flight, flight)
        yield farthest(np.abs(s.before[:, :2]), [gap, speed], [gap, speed])
        turn = math.remainder((k + 1) * STRETCH * flight - s.phase[-1], 2.0 * math.pi)
        yield abs(turn)


@extreme(
    "phase of a periodic motion",
    "alpha, gamma",
    "1e6 impacts, one per period",
    "closed form",
    allowed=1e-12,
    unit="radians, speeds, times",
)
def periodic_motion() -> Iterator[float]:
    """A periodic motion with one impact per period of the excitation, whose phase and speed are known in closed form.

    ``x'' = gamma - alpha sin tau`` returns to the wall after 2 pi if ``y0 + pi gamma = alpha cos tau0``, with a
    velocity larger by ``2 pi gamma``; the impact restores y0 if ``y0 = -2 pi gamma epsilon / (1 + epsilon)``.
    """
    alpha, epsilon, gamma, gap = 1.0, 0.5, 0.3, 10.0
    y0 = -2.0 * math.pi * gamma * epsilon / (1.0 + epsilon)
    phase = math.acos((y0 + math.pi * gamma) / alpha)
    start = Start(phase, gap, -y0 / epsilon, mesh=1)
    orbit = long_orbit.LongOrbit(
        Scene(alpha=alpha, epsilon=epsilon, beta1=0.0, gamma1=gamma, gap1=gap, start=start, stages=1)
    )
    for _ in range(PERIODS // STRETCH):
        s = orbit.stretch(STRETCH, tangent=False)
        turn = np.abs(np.angle(np.exp(1j * (s.phase - phase))))
        yield float(turn.max())
        yield farthest(s.before[:, 1], -y0 / epsilon, 1.0)
        yield farthest(s.flight, 2.0 * math.pi)
        yield 0.0 if len(s.flight) == STRETCH else math.inf


ROWS = (energy, elastic_flights, periodic_motion)
