"""What the statistical tests share: a limit on z-scores corrected for how many are looked at, and common scenes."""

import numpy as np
from scipy import stats

from scene import DAT21, Scene, Start

FALSE_ALARM = 1e-3
"""Chance that a whole family of z-scores of a correct program fails, before its seed was fixed."""


def limit(checks: int) -> float:
    """Largest |z| allowed among so many z-scores (Bonferroni)."""
    return float(stats.norm.isf(0.5 * FALSE_ALARM / checks))


def agrees(value, truth, se, slack=0.0) -> bool:
    """Whether all values lie within the corrected limit of the truth, after a stated systematic `slack`."""
    value, truth, se, slack = np.broadcast_arrays(value, truth, se, slack)
    return bool((np.abs(value - truth) <= limit(value.size) * se + slack).all())


def dat21(sigma: float = 0.0, **settings) -> Scene:
    """The paper's scene."""
    return Scene.from_gears(DAT21, sigma=sigma, **settings)


def open_space(sigma: float, **changes) -> Scene:
    """DAT21 with walls so far off that nothing is met, from an arbitrary state in flight."""
    s = dat21()
    values = {name: getattr(s, name) for name in ("alpha", "epsilon", "beta1", "beta2", "gamma1", "gamma2", "mu")}
    start = Start(0.3, 0.1, -0.4, -0.2, 0.5)
    return Scene(**(values | {"gap1": 1e6, "gap2": 1e6, "sigma": sigma, "start": start} | changes))
