"""What the tests share: limits on z-scores corrected for how many are looked at, common scenes, a
path's own noise."""

from dataclasses import replace

import numpy as np
from scenes import UNEQUAL, dat21

from rattle import Record, Start, Tolerance, follow, simulate
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.kernel.blocks import in_threads
from rattle.montecarlo.long_run.walk import Walk
from rattle.montecarlo.noise.philox import BRIDGE, STEP, key_of, normals
from rattle.scene.compiled import jit

__all__ = ["BLOCK", "Walk", "in_threads", "key_of"]  # of the package, for several tests


def stepped(scene, record=None, **settings):
    """An ensemble of located Euler-Maruyama steps; their bias is measured where it is asked for
    only."""
    record = record or Record()
    return simulate(
        scene,
        record=replace(record, step_bias=bool(record.step_bias)),
        **({"scheme": "euler-maruyama-located"} | settings),
    )


NOISY = dat21(0.1)
"""With a rare branch at impact 3."""


def largest_z(one, other, names):
    """Largest difference of columns of two sections in standard errors."""
    errors = [f"se_{name}" for name in names]
    se = np.hypot(one[errors].to_numpy(), other[errors].to_numpy())
    return np.abs((one[names] - other[names]).to_numpy() / se).max()


def open_space(sigma, **changes):
    """DAT21 with walls so far off that nothing is met, from an arbitrary state in flight."""
    start = Start(0.3, 0.1, -0.4, -0.2, 0.5)
    return replace(dat21(sigma), **({"gap1": 1e6, "gap2": 1e6, "start": start} | changes))


def step_normals(key, path, steps):
    """Standard normals of a path's first finest steps under the Euler schemes, at least so many."""
    word = np.uint64
    return np.ravel([normals(key, word(path), word(n), word(STEP)) for n in range(steps // 4 + 1)])


def bridge_normal(key, path, step, call):
    """The normal that splits an increment: of a call within the step that begins at finest step
    `step`."""
    index = np.uint64(step * 2**16 + call)
    return normals(key, np.uint64(path), index, np.uint64(BRIDGE))[0]


def orbit_of(scene, impacts):
    """Noise-free impacts: rows tau, x1, y1, x2, y2, mesh * side."""
    orbit = follow(scene, impacts)
    assert orbit.found == impacts
    code = orbit.mesh * orbit.side
    return np.column_stack([orbit.tau, orbit.before, code])[1:]


TOLERANT = replace(UNEQUAL, tolerance=Tolerance(0.05, 0.03, draw="contact"))


def for_python(function):
    """A function that only compiled code calls, compiled for Python too: called as it stands it
    would crash."""
    return jit(getattr(function, "py_func", function))
