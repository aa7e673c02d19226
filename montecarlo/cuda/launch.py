"""Ensembles on a GPU: ``simulate(..., sampling=Sampling(device="cuda"))``.

Only this folder uses CUDA, and nothing imports it before a GPU is asked for and found (`check_gpu` in the settings).
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from rattle.montecarlo.kernel.block import BlockResult, Plan, begin_block, start_state
from rattle.montecarlo.kernel.kernel import COLUMNS, Job
from rattle.scene.types import Floats, Ints

THREADS = 128
"""Threads of a thread block, one path each."""

ROUNDS = 8
"""Paths of a launch per resident thread: few launches, and few idle threads at the end of each."""

SIMULATED = 8
"""Paths of a launch on numba's simulator, with half as many threads per block."""


def _is_simulated() -> bool:
    from numba import config

    return bool(getattr(config, "ENABLE_CUDASIM", False))


def resident_threads() -> int:
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
    return min(ROUNDS * resident_threads(), room, plan.paths)


class _Resources(NamedTuple):
    """What stays the same from launch to launch."""

    plan: Plan
    job: Job
    start: tuple[float, ...]
    flanks: tuple[int, ...]
    follow: Callable[..., Any]
    fixed_steps: Any


def prepare(plan: Plan) -> _Resources:
    """Compile the kernel of a plan, and copy to the GPU what all launches share."""
    from numba import cuda

    from rattle.montecarlo.cuda.paths import path_kernel

    scene, (job, _, _) = plan.scene, begin_block(plan, 0, 1)
    noise = "none" if scene.sigma == 0.0 else "two-point" if plan.two_point else "gaussian"
    sides = ((scene.start.x1, scene.gap1), (scene.start.x2, scene.gap2))
    gaps = np.repeat([[scene.gap1], [scene.gap2]], 2, axis=0)
    start, flanks = start_state(scene, gaps)[:, 0].tolist(), (int(np.sign(x)) * (abs(x) == gap) for x, gap in sides)
    kernel = path_kernel(job.scheme, noise, job.backlash.random, job.backlash.redrawn)
    return _Resources(plan, job, tuple(start), tuple(flanks), kernel, cuda.to_device(plan.fixed_steps))


def follow(gpu: _Resources, first: int, paths: int) -> tuple[Any, Any, Ints]:
    """Follow paths from number `first` on: impacts and states at fixed times (on the GPU), and counts of the work."""
    from numba import cuda

    from rattle.montecarlo.cuda.sums import launch

    plan = gpu.plan
    threads = SIMULATED // 2 if _is_simulated() else THREADS
    rows = cuda.device_array((plan.impacts, COLUMNS, paths), np.float64)
    fixed = cuda.device_array((plan.fixed_steps.size, 4, paths), np.float64)
    counts = cuda.to_device(np.zeros(3, np.int64))
    asked = gpu.job, first, gpu.start, gpu.flanks
    launch(gpu.follow, -(-paths // threads), threads, *asked, rows, gpu.fixed_steps, fixed, counts)
    return rows, fixed, counts.copy_to_host()


def launches(plan: Plan, size: int) -> Iterator[tuple[BlockResult, Floats | None]]:
    """Results of the launches of a plan, in order, as `rattle.montecarlo.kernel.block.run` gives them for blocks.

    Shapes: `rows` (paths, impacts, COLUMNS), or None.
    """
    from rattle.montecarlo.cuda.sums import MOST_THREADS, reduce

    gpu = prepare(plan)
    for first in range(0, plan.paths, size):
        rows, fixed, counts = follow(gpu, first, min(size, plan.paths - first))
        kept = np.ascontiguousarray(rows.copy_to_host().transpose(2, 0, 1)) if plan.keep else None
        if kept is not None and plan.scene.stages == 1:
            kept[:, :, 4:6] = np.nan
        yield reduce(plan, rows, fixed, counts, 2 if _is_simulated() else MOST_THREADS), kept
