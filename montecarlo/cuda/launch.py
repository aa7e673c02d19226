"""Ensembles on a GPU: ``simulate(..., device="cuda")``.

Only this module and those it imports use CUDA, and nothing imports it before a GPU is asked for.

``python -m rattle.montecarlo.cuda.launch`` measures path-steps per second on the present GPU.  IT HAS NOT YET BEEN RUN
ON A GPU: so far the kernels have been compiled for one, and run on numba's simulator of one.

From the counts in `COSTS` an H200 (132 multiprocessors at 1.98 GHz, 128 instructions and 64 float64 ones per clock) can
start at most 2.3e11 path-steps of ``euler-maruyama`` per second, 6.6e11 with two-point increments.  An ESTIMATE, with
half to 0.7 of these instructions started, a tenth of the steps of a warp stopped by an impact, and threads that wait
for the slowest path of their warp (0.94 of them at work at sigma = 0.1, 0.64 at sigma = 1.2): 0.6e11 to 1.3e11, and
1.5e11 to 3e11 with two-point increments.
"""

import math
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.montecarlo.kernel.block import BlockResult, Plan, start_state
from rattle.montecarlo.kernel.kernel import COLUMNS, Job
from rattle.montecarlo.noise.backlash import backlash_of
from rattle.montecarlo.noise.philox import key_of
from rattle.montecarlo.schemes.table import SCHEMES
from rattle.montecarlo.settings import plan_of
from rattle.scene.errors import InputError
from rattle.scene.gears import DAT21
from rattle.scene.scene import Scene

Floats = NDArray[np.float64]

THREADS = 128
"""Threads of a thread block, one path each."""

ROUNDS = 8
"""Paths of a launch per resident thread: few launches, and few idle threads at the end of each."""

SIMULATED = 8
"""Paths of a launch on numba's simulator, with half as many threads per block."""


def check_gpu() -> None:
    """Raise an error if there is no GPU to run on."""
    if find_spec("numba_cuda") is None:
        raise InputError("device", "cuda", "needs the package numba-cuda; run: pip install 'rattle[gpu]'")
    from numba import cuda

    if cuda.is_available():
        return
    try:
        gpus = len(cuda.gpus)
    except cuda.CudaSupportError as error:
        reason = " ".join(str(error).split()).strip(" :")
        raise InputError("device", "cuda", f"needs an NVIDIA driver and a GPU; {reason}") from None
    if gpus == 0:
        raise InputError("device", "cuda", "needs a GPU; the driver finds none")
    raise InputError("device", "cuda", "needs CUDA's compiler libraries; run: pip install 'rattle[gpu]'")


def _is_simulated() -> bool:
    from numba import config

    return bool(getattr(config, "ENABLE_CUDASIM", False))


def _resident() -> int:
    """Threads that the GPU holds at a time."""
    from numba import cuda

    device = cuda.get_current_device()
    return int(device.MULTIPROCESSOR_COUNT * device.MAX_THREADS_PER_MULTIPROCESSOR)


def launch_size(plan: Plan) -> int:
    """Paths of a launch: `ROUNDS` per resident thread, or as many as fit a quarter of the GPU's free memory."""
    if _is_simulated():
        return min(SIMULATED, plan.paths)
    from numba import cuda

    free, _ = cuda.current_context().get_memory_info()
    bytes_per_path = 8 * (plan.impacts * COLUMNS + 4 * plan.fixed_steps.size)
    room = max(int(free / 4 / bytes_per_path) // THREADS * THREADS, THREADS)
    return min(ROUNDS * _resident(), room, plan.paths)


class _Resources(NamedTuple):
    """What stays the same from launch to launch."""

    plan: Plan
    job: Job
    start: tuple[float, ...]
    flanks: tuple[int, ...]
    follow: Callable[..., Any]
    fixed_steps: Any


def _prepare(plan: Plan) -> _Resources:
    from numba import cuda

    from rattle.montecarlo.cuda.paths import path_kernel

    scene, scheme, backlash = plan.scene, SCHEMES[plan.scheme].code, backlash_of(plan.scene)
    noise = "none" if scene.sigma == 0.0 else "two-point" if plan.two_point else "gaussian"
    job = Job(
        scene.constants, backlash, key_of(plan.seed), scene.phase, plan.dt, scheme, plan.two_point, plan.most_steps
    )
    sides = ((scene.start.x1, scene.gap1), (scene.start.x2, scene.gap2))
    gaps = np.repeat([[scene.gap1], [scene.gap2]], 2, axis=0)
    return _Resources(
        plan,
        job,
        tuple(start_state(scene, gaps)[:, 0].tolist()),
        tuple(int(np.sign(x)) if abs(x) == gap else 0 for x, gap in sides),
        path_kernel(scheme, noise, backlash.random, backlash.redrawn),
        cuda.to_device(plan.fixed_steps),
    )


def _follow(gpu: _Resources, first: int, paths: int) -> tuple[Any, Any, NDArray[np.int64]]:
    """Follow paths from number `first` on: impacts and states at fixed times (on the GPU), and counts of the work."""
    from numba import cuda

    from rattle.montecarlo.cuda.sums import launch

    plan = gpu.plan
    threads = SIMULATED // 2 if _is_simulated() else THREADS
    rows = cuda.device_array((plan.impacts, COLUMNS, paths), np.float64)
    fixed = cuda.device_array((plan.fixed_steps.size, 4, paths), np.float64)
    counts = cuda.to_device(np.zeros(3, np.int64))
    launch(
        gpu.follow,
        -(-paths // threads),
        threads,
        gpu.job,
        first,
        gpu.start,
        gpu.flanks,
        rows,
        gpu.fixed_steps,
        fixed,
        counts,
    )
    return rows, fixed, counts.copy_to_host()


def launches(plan: Plan, size: int) -> Iterator[tuple[BlockResult, Floats | None]]:
    """Results of the launches of a plan, in order, as `rattle.montecarlo.kernel.block.run` gives them for blocks.

    Shapes: `rows` (paths, impacts, COLUMNS), or None.
    """
    from rattle.montecarlo.cuda.sums import MOST_THREADS, reduce

    gpu = _prepare(plan)
    for first in range(0, plan.paths, size):
        rows, fixed, counts = _follow(gpu, first, min(size, plan.paths - first))
        kept = np.ascontiguousarray(rows.copy_to_host().transpose(2, 0, 1)) if plan.keep else None
        if kept is not None and plan.scene.stages == 1:
            kept[:, :, 4:6] = np.nan
        yield reduce(plan, rows, fixed, counts, 2 if _is_simulated() else MOST_THREADS), kept


FP64_LANES = {(6, 0): 32, (7, 0): 32, (8, 0): 32, (9, 0): 64, (10, 0): 64}
"""Float64 fused multiply-adds that a multiprocessor can start per clock, by compute capability; 2 on all others."""

LANES = 128
"""Thread instructions that a multiprocessor can start per clock: four warps' worth."""


class Cost(NamedTuple):
    """Cost of a path-step without an impact, counted in the machine code for compute capability 9.0."""

    instructions: float
    float64_instructions: float
    flops: float
    random_words: float


COSTS = {
    ("euler-maruyama", "gaussian"): Cost(148, 42, 62, 1.0),
    ("euler-maruyama", "two-point"): Cost(51, 15, 18, 1.0 / 16.0),
    ("euler-maruyama-located", "gaussian"): Cost(156, 42, 62, 1.0),
    ("exact-flight", "gaussian"): Cost(308, 93, 131, 2.0),
}
"""By scheme and increments, for two stages without tolerance."""


def speed(plan: Plan, repeats: int = 3) -> float:
    """Path-steps per second of a plan's first launch: the best of several, after one that compiles."""
    gpu, paths = _prepare(plan), launch_size(plan)
    _follow(gpu, 0, paths)
    best = 0.0
    for _ in range(repeats):
        begin = time.perf_counter()
        *_, counts = _follow(gpu, 0, paths)  # fetching the counts waits for the paths
        best = max(best, float(counts[0]) / (time.perf_counter() - begin))
    return best


def measure(dt: float = 2e-3, impacts: int = 12) -> pd.DataFrame:
    """Path-steps per second in float64 on the present GPU, and the shares of its limits that they reach.

    Not yet run on a GPU.  The goal is 1e11 path-steps per second on an H200.

    Returns: Index ``scheme, increments``; columns ``path_steps_per_s``, ``flops_per_s``, ``words_per_s``
    (random), and the shares of two limits of the GPU, without impacts and idle threads: ``of_float64`` (all
    float64 pipes always busy) and ``of_issue`` (an instruction issued at every clock).
    """
    from numba import cuda

    check_gpu()
    device = cuda.get_current_device()
    clocks = 1e3 * device.CLOCK_RATE * device.MULTIPROCESSOR_COUNT
    lanes = FP64_LANES.get(tuple(device.compute_capability), 2)
    scene = Scene.from_gears(DAT21, sigma=math.sqrt(DAT21.alpha))
    rows = []
    for (scheme, increments), cost in COSTS.items():
        plan = plan_of(
            scene,
            paths=ROUNDS * _resident(),
            impacts=impacts,
            dt=dt,
            scheme=scheme,
            increments=increments,
            device="cuda",
        )
        rate = speed(plan)
        rows.append(
            {
                "scheme": scheme,
                "increments": increments,
                "path_steps_per_s": rate,
                "flops_per_s": cost.flops * rate,
                "words_per_s": cost.random_words * rate,
                "of_float64": cost.float64_instructions * rate / (clocks * lanes),
                "of_issue": cost.instructions * rate / (clocks * LANES),
            }
        )
    return pd.DataFrame(rows).set_index(["scheme", "increments"])


if __name__ == "__main__":
    try:
        print(measure().to_string(float_format="{:.3g}".format))
    except InputError as error:
        raise SystemExit(str(error)) from None
