"""Time scales that a step must resolve, and limits of a step with their reasons.

`rattle check stability` measures both sides of these limits (reports/stability).
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rattle.scene import Constants, Scene, Wheel
from rattle.scene.drive import most_modulation, most_velocity
from rattle.scene.orbit import first_state

Limit = tuple[float, str]
"""A longest step, and the reason for it as part of a message."""


class TimeScales(NamedTuple):
    """Time scales that a step must resolve; infinite where there is no such process."""

    damping: float  # relaxation time of the faster damped wheel, ``1 / beta``
    swing: float  # time of a radian of the faster wheel that a spring holds
    # time to cross the narrowest half gap at a typical speed: that of the start, or what excitation
    # and drag make of a path within one crossing
    crossing: float
    # time in which noise alone takes a path across that half gap: ``(g / sigma)^(2/3)``, or by
    # diffusion ``(beta g / sigma)^2`` where damping is faster than that
    shaking: float
    # time in which noise reverses the velocity of a path that leaves its wall at the start:
    # ``(speed / sigma)^2``
    turning: float


@lru_cache(maxsize=32)  # each limit of a step asks for them
def time_scales(scene: Scene) -> TimeScales:
    """The time scales of a scene."""
    c = scene.constants
    wheels = scene.tree
    # of random gaps at most a tenth: few paths have a narrower one, however large c_max is
    random = scene.tolerance is not None and scene.tolerance.distribution != "fixed"
    state = scene.start_state
    gap = math.inf
    for i, (wheel, wall) in enumerate(zip(wheels, c.wheels["wall"].tolist(), strict=True)):
        narrow = wall - min(wheel.tolerance, 0.9 * wall) * random
        gap = min(gap, _fall(wheel, *state[2 * i : 2 * i + 2]) if wheel.one_sided else narrow)
    beta = c.wheels["beta"]
    damping = _over(1.0, float(beta.max()))
    # largest modulation of excitation and noise in the rate of a gap at the driver (Eq. 5)
    first = np.flatnonzero(c.wheels["parent"] < 0)
    turns = c.wheels["turn"]
    most = max(float(turns[i]) * _modulation(c, float(beta[i])) for i in first)
    driver = c.alpha * float(turns[first].max()) * most_velocity(c.drive)
    # a narrow gap bounds the relative speed
    driven = min(driver, 2.0 * math.sqrt(c.alpha * most * gap))
    pulled = (w for w in wheels if w.gamma > 0.0)
    dragged = (min(_over(w.gamma, w.beta), 2.0 * math.sqrt(w.gamma * gap)) for w in pulled)
    starting = np.abs(state[1::2]).max()
    typical = max(driven, *dragged, float(starting))
    forces = float(c.wheels["own"].max()) + float(c.wheels["shaking"].max())
    noise = c.sigma * (c.modulates * most + forces)
    shaking = _over(gap, noise) ** (2.0 / 3.0)
    if shaking > damping:
        shaking = max(damping, _over(gap, noise * damping) ** 2)
    swing = _over(1.0, math.sqrt(float(c.wheels["stiffness"].max())))
    return TimeScales(
        damping, swing, _over(gap, typical), shaking, _over(_leaving(scene), noise) ** 2
    )


def _fall(wheel: Wheel, x: float, y: float) -> float:
    """How far a body with one wall falls to it, from the top of its first flight; infinite without
    a drag."""
    if wheel.gamma == 0.0:
        return math.inf
    return (wheel.gap - x) + y * y / (2.0 * wheel.gamma) or wheel.gap


def _modulation(c: Constants, beta: float) -> float:
    """Bound of ``|f'' + beta f'|``."""
    return math.hypot(1.0, beta) if not c.drive else most_modulation(c.drive, beta)


SPRING_REASON = "a longer step cannot follow the spring"
MEMORY_REASON = "a longer step cannot follow the memory of the noise"


def memory_step(scene: Scene) -> float:
    """The longest step for noise with a memory, a tenth of it; infinite for white noise."""
    return 0.1 * scene.correlation_time if scene.correlation_time else math.inf


def _over(a: float, b: float) -> float:
    """``a / b``, infinite for b = 0."""
    return a / b if b > 0.0 else math.inf


def _leaving(scene: Scene) -> float:
    """Slowest speed with which a gap leaves a wall at the start; infinite if none does."""
    state = first_state(scene)
    wheels = scene.constants.wheels
    leaving = (state[::2] >= wheels["wall"]) | (-state[::2] >= wheels["low"])
    return float(np.abs(state[1::2])[leaving].min(initial=math.inf))


def least_limit(limits: dict[str, float]) -> Limit:
    """The least of some limits, with its reason."""
    reason = min(limits, key=lambda name: limits[name])
    return limits[reason], reason
