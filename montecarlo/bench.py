"""Cost of a path-step, next to the lower bound set by random numbers and arithmetic on the same machine.

All times are processor time of one core, the least of several repeats, in one run.  The ratios carry over to other
machines; the times may not.
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from rattle.montecarlo.kernel.block import BLOCK, run, sample
from rattle.montecarlo.noise.philox import Word, fill_normals, key_of
from rattle.montecarlo.record import Record
from rattle.montecarlo.schemes.euler import euler_lanes, step_forcing
from rattle.montecarlo.settings import plan_of
from rattle.scene.compiled import lean
from rattle.scene.constants import Constants
from rattle.scene.gears import DAT21
from rattle.scene.parts import Tolerance
from rattle.scene.scene import Scene

__all__ = ["bench", "floor"]

REPEATS = 15
STEP = 2.0 * math.pi / 1000.0
LOOPS = 400


@lean
def _normals(key: Any, paths: Any, z: Any, loops: int) -> None:
    for i in range(loops):
        fill_normals(key, paths, Word(i), paths.size, z)


@lean
def _steps(c: Constants, state: Any, z: Any, beyond: Any, loops: int) -> None:
    f = step_forcing(c, 0.0, 1e-12)  # so short that no path moves noticeably
    for _ in range(loops):
        euler_lanes(c, f, 1e-12, False, state, state, z, beyond, z.size)


def _least(call: Callable[[], Any]) -> float:
    """Least processor time of a call, in ns."""
    call()
    best = math.inf
    for _ in range(REPEATS):
        begin = time.process_time_ns()
        call()
        best = min(best, time.process_time_ns() - begin)
    return best


def floor() -> tuple[float, float]:
    """Time of one standard normal, and of the arithmetic of one Euler-Maruyama step with its wall test, on one core.

    Returns
    -------
    normal, step : float
        ns.
    """
    c = Scene.from_gears(DAT21, sigma=1.0).constants
    key, paths = key_of(np.random.SeedSequence(1)), np.arange(BLOCK, dtype=np.uint64)
    z, state, beyond = np.zeros((4, BLOCK)), np.zeros((4, BLOCK)), np.zeros(BLOCK, np.bool_)
    normal = _least(lambda: _normals(key, paths, z, LOOPS)) / (4.0 * BLOCK * LOOPS)
    step = _least(lambda: _steps(c, state, z[0], beyond, LOOPS)) / (BLOCK * LOOPS)
    return normal, step


def _measured(scene: Scene, statistics: bool = True, **settings: Any) -> tuple[float, float, float]:
    """Time of a path-step in ns, steps of a path, time of a path in us."""
    usual: dict[str, Any] = {"paths": BLOCK, "impacts": 12, "dt": STEP, "scheme": "euler-maruyama"}
    plan = plan_of(scene, **usual | settings)
    steps = sample(plan, 0).path_steps
    ns = _least(lambda: run(plan, 0) if statistics else sample(plan, 0, reuse=True))
    return ns / steps, steps / BLOCK, 1e-3 * ns / BLOCK


def bench(scene: Scene | None = None) -> pd.DataFrame:
    """Time of a path-step for every scheme, and for each option of a scene or a run.

    Parameters
    ----------
    scene : Scene or None
        By default DAT21 with ``sigma = sqrt(alpha)``.

    Returns
    -------
    DataFrame
        Index ``what``; columns ``ns`` per path-step, ``times_floor`` (over the sum of both times of `floor`), ``steps``
        of a path, ``us`` per path.
    """
    base = scene or Scene.from_gears(DAT21, sigma=math.sqrt(DAT21.alpha))
    normal, arithmetic = floor()
    low = normal + arithmetic
    walls = Tolerance(0.01, 0.01, draw="path")
    contact = Tolerance(0.01, 0.01, draw="contact")
    loose = replace(base, tolerance=walls)
    cases: Mapping[str, tuple[Scene, dict[str, Any]]] = {
        "euler-maruyama, paths alone": (base, {"statistics": False}),
        "euler-maruyama, section statistics": (base, {}),
        "  the same, dt = 0.002": (base, {"dt": 2e-3}),
        "  with two-point increments, paths alone": (base, {"increments": "two-point", "statistics": False}),
        "  with two-point increments": (base, {"increments": "two-point"}),
        "  without noise (gaps vary), paths alone": (
            replace(loose, sigma=0.0), {"statistics": False}
        ),
        "  with one stage": (replace(base, stages=1), {}),
        "  with gaps that vary by path": (loose, {}),
        "  with gaps that vary by contact": (replace(base, tolerance=contact), {}),
        "  with moments at 12 fixed times": (base, {"record": Record(times=np.linspace(0.5, 4.0, 12))}),
        "  with 2 dt and 4 dt for the step bias": (base, {"record": Record(step_bias=True)}),
        "euler-maruyama-located": (base, {"scheme": "euler-maruyama-located"}),
        "exact-flight, dt = pi/64": (base, {"scheme": "exact-flight", "dt": math.pi / 64.0}),
        "  with the linearised path as control variate": (
            base, {"scheme": "exact-flight", "dt": math.pi / 64.0, "control": True}
        ),
    }  # fmt: skip
    rows: dict[str, tuple[float, ...]] = {
        "one standard normal": (normal, normal / low, math.nan, math.nan),
        "arithmetic of one step": (arithmetic, arithmetic / low, math.nan, math.nan),
    }
    for name, (own, settings) in cases.items():
        ns, steps, us = _measured(own, **settings)
        rows[name] = (ns, ns / low, steps, us)
    return pd.DataFrame.from_dict(
        rows, orient="index", columns=["ns", "times_floor", "steps", "us"]
    ).rename_axis("what")  # fmt: skip
