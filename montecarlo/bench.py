"""Cost of a path-step, next to the lower bound set by random numbers and arithmetic, and to a
skilled loop in numba.

All times are processor time of one core.  What is compared is measured in one run in slices that
take turns, for the clock and the neighbours of a machine change from second to second; a ratio is
the median over the turns.  Ratios carry over to machines of a kind; times may not.
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from rattle.montecarlo.kernel.block import BLOCK, run, sample
from rattle.montecarlo.noise.philox import STEP, Word, fill_normals, key_of
from rattle.montecarlo.schemes.euler import plain_lanes, step_forcing
from rattle.montecarlo.settings import Record, Sampling, plan_of
from rattle.scene import DAT21, Constants, Floats, Scene, Start, Tolerance, Wheel
from rattle.scene.compiled import jit, lean

TURNS_OF_SLICES = 25  # turns of slices
BENCH_STEP = 2.0 * math.pi / 1000.0
FLOOR_LANES = 256  # of the floor: as many as the kernel takes through its steps together
LOOPS = 100
# of the skilled loop: enough that caches and branch predictors have learned it after another slice
LOOP_PATHS = 1250
LOOP_STEPS = 800  # of the skilled loop's paths: about as many as twelve impacts take
NUMBERS_OF_WHEELS = (1, 2, 4, 8, 16)
FAR_GAP = 1e6  # half gap of which no wall is met
SKILLED = "a skilled loop in numba, without statistics"
SCALAR = "one normal by standard_normal"
NORMAL = "one standard normal"
ARITHMETIC = "arithmetic of one step"
EXACT_FLIGHTS: dict[str, Any] = {"scheme": "exact-flight", "dt": math.pi / 96.0}


@lean
def _normals(key: Any, paths: Any, z: Any, loops: int) -> None:
    for i in range(loops):
        fill_normals(key, paths, Word(i), Word(STEP), paths.size, z)


@lean
def _steps(
    c: Constants, forcing: Any, state: Any, speeds: Any, z: Any, beyond: Any, loops: int
) -> None:
    for _ in range(loops):  # so short that no path moves noticeably
        plain_lanes(c, c.wheels.size, forcing, 1e-12, False, state, state, speeds, z, beyond)


@jit
def _scalar_normals(generator: np.random.Generator, count: int) -> float:
    total = 0.0
    for _ in range(count):
        total += generator.standard_normal()
    return total


@jit
def _skill_loop(
    c: Constants, generator: np.random.Generator, paths: int, forcing: Floats, h: float
) -> float:
    """Euler-Maruyama with impacts as one writes it who knows numba: path by path, forcing
    tabulated, a fast generator.

    Both meshes' impacts are taken at the end of a step.  Nothing is recorded.
    """
    first = c.wheels[0]
    second = c.wheels[1]
    keep1 = 1.0 - h * first.beta
    keep2 = 1.0 - h * second.beta
    pull = h * second.coupling
    total = 0.0
    wall1 = first.wall
    wall2 = second.wall
    epsilon = first.epsilon
    jump = 1.0 + epsilon
    jump_back = jump * second.share
    for _ in range(paths):
        x1 = 0.0
        y1 = 0.0
        x2 = 0.0
        y2 = 0.0
        for i in range(forcing.shape[0]):
            z = generator.standard_normal()
            x1, y1, x2, y2 = (
                x1 + h * y1,
                keep1 * y1 + forcing[i, 0, 0] + forcing[i, 0, 1] * z,
                x2 + h * y2,
                keep2 * y2 + pull * y1 + forcing[i, 1, 0] + forcing[i, 1, 1] * z,
            )
            if (x1 > wall1 and y1 > 0.0) or (x1 < -wall1 and y1 < 0.0):
                x1 = wall1 if x1 > 0.0 else -wall1
                y1, y2 = -epsilon * y1, y2 - jump * y1
            if (x2 > wall2 and y2 > 0.0) or (x2 < -wall2 and y2 < 0.0):
                x2 = wall2 if x2 > 0.0 else -wall2
                y1 = y1 - jump_back * y2
                y2 = -epsilon * y2
        total += x1
    return total


Timed = tuple[Callable[[], Any], float]
"""A call, and its units of work."""


def slices(calls: Mapping[str, Timed], turns: int) -> dict[str, Floats]:
    """Processor time of calls that take turns, in ns per unit of work.

    Shapes: result (turns,).
    """
    taken = {name: np.empty(turns) for name in calls}
    for call, _ in calls.values():
        call()
    for turn in range(turns):
        for name, (call, units) in calls.items():
            begin = time.thread_time_ns()
            call()
            taken[name][turn] = (time.thread_time_ns() - begin) / units
    return taken


def _floor(scene: Scene) -> dict[str, Timed]:
    """A normal and the arithmetic of a step as they are here, and the loop and the generator that
    others take."""
    c = scene.constants
    key = key_of(np.random.SeedSequence(1))
    paths = np.arange(FLOOR_LANES, dtype=np.uint64)
    generator = np.random.Generator(np.random.SFC64(1))  # the fastest of numpy's
    z, state, speeds = np.zeros((3, 4, FLOOR_LANES + 8))
    beyond = np.zeros(FLOOR_LANES, np.bool_)
    still = np.zeros(FLOOR_LANES)
    forcing = np.empty((LOOP_STEPS, c.wheels.size, 2))
    for i in range(LOOP_STEPS):
        step_forcing(c, i * BENCH_STEP, BENCH_STEP, forcing[i])
    return {
        SKILLED: (
            lambda: _skill_loop(c, generator, LOOP_PATHS, forcing, BENCH_STEP),
            float(LOOP_PATHS * LOOP_STEPS),
        ),
        SCALAR: (lambda: _scalar_normals(generator, 100_000), 1e5),
        NORMAL: (lambda: _normals(key, paths, z, LOOPS), 4.0 * FLOOR_LANES * LOOPS),
        ARITHMETIC: (
            lambda: _steps(c, forcing[0], state, speeds, still, beyond, LOOPS),
            float(FLOOR_LANES * LOOPS),
        ),
    }


def _case(scene: Scene, statistics: bool = True, **settings: Any) -> tuple[Callable[[], Any], int]:
    """A call that runs a block, and its path-steps."""
    usual: dict[str, Any] = {
        "paths": BLOCK,
        "impacts": 12,
        "dt": BENCH_STEP,
        "scheme": "euler-maruyama",
    }
    plan = plan_of(scene, **usual | settings)
    call = partial(run, plan, 0) if statistics else partial(sample, plan, 0, reuse=True)
    return call, sample(plan, 0).path_steps


def _tree(base: Scene, wheels: int) -> Scene:
    """A tree of so many wheels far from any wall, at most two on each."""
    given = tuple(
        # dampings differ, so that no wheel flies as its parent does
        Wheel(
            beta=base.beta1 * (1.0 + 0.1 * number),
            gamma=base.gamma1,
            gap=FAR_GAP,
            parent=(number + 1) // 2,
        )
        for number in range(wheels)
    )
    start = Start(state=(0.0,) * 2 * wheels)
    return Scene(
        alpha=base.alpha, epsilon=base.epsilon, sigma=base.sigma, wheels=given, start=start
    )


def bench(scene: Scene | None = None) -> pd.DataFrame:
    """Time of a path-step for every scheme, and for each option of a scene or a run.

    Returns: Index ``what``; columns ``ns`` per path-step, the least; ``ns_wheel``, the same over
    the number of wheels; ``times_floor``, over a normal
    and the arithmetic of a step together; ``gain``, how many path-steps are done in the time of one
    of the skilled loop, or normals in that of one by ``standard_normal``, or paths of exact flights
    in that of one of the loop; ``steps`` of a path; ``us`` per path.
    """
    base = scene or Scene.from_gears(DAT21, sigma=math.sqrt(DAT21.alpha))
    alone = {"statistics": False}
    two_point = {"sampling": Sampling(increments="two-point")}
    loose, redrawn = (
        replace(base, tolerance=Tolerance(0.01, 0.01, draw=draw)) for draw in ("path", "contact")
    )
    briefly: dict[str, Any] = {"sampling": Sampling(horizon=4.0)} | alone
    cases: dict[str, tuple[Scene, dict[str, Any]]] = {
        "euler-maruyama, paths alone": (base, alone),
        "euler-maruyama, section statistics": (base, {}),
        "  the same, dt = 0.002": (base, {"dt": 2e-3}),
        "  with two-point increments, paths alone": (base, two_point | alone),
        "  with two-point increments": (base, two_point),
        "  without noise (gaps vary), paths alone": (replace(loose, sigma=0.0), alone),
        "  with one stage": (replace(base, stages=1), {}),
        "  with gaps that vary by path": (loose, {}),
        "  with gaps that vary by contact": (redrawn, {}),
        "  with moments at 12 fixed times": (
            base,
            {"record": Record(times=np.linspace(0.5, 4.0, 12))},
        ),
        "  with 2 dt and 4 dt for the step bias": (base, {"record": Record(step_bias=True)}),
        "euler-maruyama-located": (base, {"scheme": "euler-maruyama-located"}),
        "exact-flight, dt = pi/96": (base, EXACT_FLIGHTS),
        "  the same, sigma = 0.1": (replace(base, sigma=0.1), EXACT_FLIGHTS),
        "  the same, paths alone": (base, EXACT_FLIGHTS | alone),
        "  with gaps redrawn at each contact": (redrawn, EXACT_FLIGHTS),
        "  with the linearised path as control variate": (
            base,
            EXACT_FLIGHTS | {"sampling": Sampling(control=True)},
        ),
    }
    for wheels in NUMBERS_OF_WHEELS:
        tree = _tree(base, wheels)
        name = f"far from any wall, wheels: {wheels}, paths alone"
        cases[f"euler-maruyama {name}"] = (tree, briefly)
        cases[f"exact-flight {name}"] = (tree, EXACT_FLIGHTS | briefly)
    work = {name: _case(own, **settings) for name, (own, settings) in cases.items()}
    taken = slices(
        _floor(base) | {name: (call, float(steps)) for name, (call, steps) in work.items()},
        TURNS_OF_SLICES,
    )
    low = taken[NORMAL] + taken[ARITHMETIC]
    rows = {}
    for name, ns in taken.items():
        steps = work[name][1] / BLOCK if name in work else math.nan
        gain = np.median(taken[SCALAR if name in (SCALAR, NORMAL) else SKILLED] / ns)
        if name in work and cases[name][1].get("scheme") == "exact-flight":
            gain *= LOOP_STEPS / steps
        per_wheel = ns.min() / cases[name][0].stages if name in cases else math.nan
        shares = (per_wheel, np.median(ns / low), gain)
        rows[name] = (ns.min(), *shares, steps, 1e-3 * ns.min() * steps)
    columns = ["ns", "ns_wheel", "times_floor", "gain", "steps", "us"]
    return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("what")
