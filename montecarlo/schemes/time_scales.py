"""Time scales that a step must resolve, and limits of a step with their reasons.

`rattle check stability` measures both sides of these limits (reports/stability).
"""

import math
from typing import NamedTuple

from rattle.scene import Scene
from rattle.scene.drive import most_modulation, most_velocity
from rattle.scene.orbit import first_state

Limit = tuple[float, str]
"""A longest step, and the reason for it as part of a message."""


class TimeScales(NamedTuple):
    """Time scales that a step must resolve; infinite where there is no such process."""

    damping: float  # relaxation time of the faster damped wheel, ``1 / beta``
    # time to cross the narrowest half gap at a typical speed: that of the start, or what excitation
    # and drag make of a path within one crossing
    crossing: float
    # time in which noise alone takes a path across that half gap: ``(g / sigma)^(2/3)``, or by
    # diffusion ``(beta g / sigma)^2`` where damping is faster than that
    shaking: float
    # time in which noise reverses the velocity of a path that leaves its wall at the start:
    # ``(speed / sigma)^2``
    turning: float


def time_scales(scene: Scene) -> TimeScales:
    """The time scales of a scene."""
    c = scene.constants
    start = scene.start
    tolerance = scene.tolerance
    narrow = (0.0, 0.0)
    if tolerance is not None and tolerance.distribution != "fixed":
        # at most to a tenth: few paths have a narrower gap, however large c_max is
        narrow = min(tolerance.c1_max, 0.9 * c.wall1), min(tolerance.c2_max, 0.9 * c.wall2)
    gap = min((c.wall1 - narrow[0], c.wall2 - narrow[1])[: c.stages])
    damping = _over(1.0, max(c.beta1, c.beta2))
    # largest modulation of excitation and noise in y1 (Eq. 5)
    most = math.hypot(1.0, c.beta1) if not c.drive else most_modulation(c.drive, c.beta1)
    # a narrow gap bounds the relative speed
    driven = min(c.alpha * most_velocity(c.drive), 2.0 * math.sqrt(c.alpha * most * gap))
    drags = (c.gamma1, c.beta1), (c.gamma2, c.beta2)
    dragged = (min(_over(gamma, beta), 2.0 * math.sqrt(gamma * gap)) for gamma, beta in drags)
    typical = max(driven, *dragged, *(abs(start.y1), abs(start.y2))[: c.stages])
    noise = c.sigma * most
    shaking = _over(gap, noise) ** (2.0 / 3.0)
    if shaking > damping:
        shaking = max(damping, _over(gap, noise * damping) ** 2)
    return TimeScales(damping, _over(gap, typical), shaking, _over(_leaving(scene), noise) ** 2)


MEMORY_REASON = "a longer step cannot follow the memory of the noise"


def memory_step(scene: Scene) -> float:
    """The longest step for noise with a memory, a tenth of it; infinite for white noise."""
    return 0.1 * scene.correlation_time if scene.correlation_time else math.inf


def _over(a: float, b: float) -> float:
    """``a / b``, infinite for b = 0."""
    return a / b if b > 0.0 else math.inf


def _leaving(scene: Scene) -> float:
    """Slowest speed with which a stage leaves a wall at the start; infinite if none does."""
    c = scene.constants
    x1, y1, x2, y2 = first_state(scene)
    stages = ((x1, y1, c.wall1), (x2, y2, c.wall2))[: c.stages]
    return min((abs(y) for x, y, wall in stages if abs(x) >= wall), default=math.inf)


def least_limit(limits: dict[str, float]) -> Limit:
    """The least of some limits, with its reason."""
    reason = min(limits, key=lambda name: limits[name])
    return limits[reason], reason
