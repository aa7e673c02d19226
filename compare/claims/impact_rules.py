"""Which of the published rules at impacts breaks the moments of which stage: Eq. 15 and Eq. 17, each mended alone.

The second moments of stage 2 follow Eq. 15 alone, those of stage 1 Eq. 17, which takes the moments of stage 2 away
from them: ``lambda - kappa m``.  Both are followed along the impact times of the published map.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.closure import mean_map
from rattle.closure.raw_moments import after_flight, unmodulated_covariance
from rattle.scene.flight import noise_covariance
from rattle.scene.moments import realizability
from rattle.scene.scene import Scene

Floats = NDArray[np.float64]

PUBLISHED, MEND_15, MEND_17, MEND_BOTH = "as published", "Eq. 15 mended", "Eq. 17 mended", "both mended"
FOLLOWED = 12  # impacts


class Failure(NamedTuple):
    """Where the second moments of a stage are not realizable first."""

    stage: int
    impact: int  # 0 if they do not fail
    reason: str  # what is wrong with them; empty if nothing is


def _struck(scene: Scene, stage1: Floats, stage2: Floats, rule: str) -> tuple[Floats, Floats]:
    """Second moments ``E[xi^n zeta^p]`` of both stages after an impact; first moments are zero."""
    kappa, e = (1.0 + scene.epsilon) * scene.mu, scene.epsilon
    one, two = stage1.copy(), stage2.copy()
    if rule in (MEND_15, MEND_BOTH):
        two[1, 1], two[0, 2] = -e * stage2[1, 1], e**2 * stage2[0, 2]
    else:
        two[1, 1], two[0, 2] = -e * stage2[1, 1], -e * stage2[0, 2]
    if rule in (MEND_17, MEND_BOTH):  # stages independent of each other, as the paper assumes
        one[0, 2] = stage1[0, 2] + kappa**2 * stage2[0, 2]
    else:
        one[1, 1], one[0, 2] = stage1[1, 1] - kappa * stage2[1, 1], stage1[0, 2] - kappa * stage2[0, 2]
    return one, two


def _failure(stage: int, moments: list[Floats]) -> Failure:
    for impact, raw in enumerate(moments, start=1):
        found = realizability(np.array([[raw[2, 0], raw[1, 1]], [raw[1, 1], raw[0, 2]]]))
        if not found.realizable:
            return Failure(stage, impact, found.reason)
    return Failure(stage, 0, "")


def failures(scene: Scene) -> dict[str, list[Failure]]:
    """Follow the second moments of both stages by the published rules and with one of them, or both, mended.

    Returns: By `PUBLISHED`, `MEND_15`, `MEND_17` and `MEND_BOTH`: of stage 1 and of stage 2, the first to fail
    first.
    """
    tau = mean_map(scene, impacts=FOLLOWED, closure="published").trace.tau
    c, tau = scene.constants, tau[np.isfinite(tau)]
    found = {}
    for rule in (PUBLISHED, MEND_15, MEND_17, MEND_BOTH):
        one, two = np.zeros((3, 3)), np.zeros((3, 3))
        one[0, 0] = two[0, 0] = 1.0
        before: tuple[list[Floats], list[Floats]] = ([], [])
        for start, t in zip(tau, np.diff(tau), strict=False):
            one = after_flight(one, c.beta1, t, noise_covariance(c, start, t))
            two = after_flight(two, c.beta2, t, unmodulated_covariance(c.beta2, c.sigma, t))
            before[0].append(one)
            before[1].append(two)
            one, two = _struck(scene, one, two, rule)
        both = [_failure(stage, before[stage - 1]) for stage in (1, 2)]
        found[rule] = sorted(both, key=lambda f: f.impact or FOLLOWED + 1)
    return found
