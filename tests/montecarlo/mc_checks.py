"""What the tests share: limits on z-scores corrected for how many are looked at, common scenes, a path's own noise."""

import numpy as np
from scipy import stats

from montecarlo.noise import BRIDGE, STEP, Key, normals
from scene import DAT21, Scene, Start
from scene.compiled import jit

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


@jit
def _steps(key, path, count):
    out = np.empty((count + 3) // 4 * 4)
    for n in range(out.size // 4):
        out[4 * n], out[4 * n + 1], out[4 * n + 2], out[4 * n + 3] = normals(
            key, np.uint64(path), np.uint64(n), np.uint64(STEP)
        )
    return out


def step_normals(key: Key, path: int, steps: int) -> np.ndarray:
    """Standard normals of a path's first finest steps under the Euler schemes, at least so many.

    Read in pairs, they are increments and areas, in standard units, of the steps of the exact flight.
    """
    return _steps(key, path, steps)


def bridge_normal(key: Key, path: int, step: int, call: int, level: int = 0) -> float:
    """The normal that splits an increment: of a call within the step that begins at finest step `step`."""
    index = np.uint64(step * 2**16 + call)
    return normals(key, np.uint64(path), index, np.uint64(BRIDGE + level))[0]
