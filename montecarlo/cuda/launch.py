"""Ensembles on a GPU: ``simulate(..., sampling=Sampling(device="cuda"))``.

Only this folder uses CUDA, and nothing imports it before a GPU is asked for and found (`check_gpu` in the settings).
Sums over paths are taken on the GPU, one thread block per cell, so that only sums are copied to the host.  The order of
summation depends on the numbers of threads and paths only: a run is repeatable bit for bit.
"""

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numba import config, cuda

from rattle.montecarlo.cuda.paths import STEPS, STICKING, UNFINISHED, path_kernel
from rattle.montecarlo.kernel.block import CODES, CROSS, SECTION_PAIRS, BlockResult, Plan, begin_block, start_state
from rattle.montecarlo.kernel.kernel import COLUMNS
from rattle.montecarlo.statistics.central_sums import COVARIANCE, PAIR, SINGLE, CentralSums, Orders
from rattle.scene import SECTION, Floats, Ints

THREADS = 128
"""Threads of a thread block, one path each."""

ROUNDS = 8
"""Paths of a launch per resident thread: few launches, and few idle threads at the end of each."""

SIMULATED = 8
"""Paths of a launch on numba's simulator, with half as many threads per block."""

SIMULATOR = bool(getattr(config, "ENABLE_CUDASIM", False))
"""Whether there is numba's simulator in place of a GPU."""

MOST_THREADS = 256  # of a thread block; a power of two
MOST_ORDERS, MOST_POWERS = 16, 9  # sizes of local arrays: orders of a cell, and powers 0 to 8


@cuda.jit(device=True)
def _reduce(value, scratch, least):  # type: ignore[no-untyped-def]
    """Sum of the threads' values, or the least of them, by tree reduction; every thread gets it."""
    t, width = cuda.threadIdx.x, cuda.blockDim.x // 2
    cuda.syncthreads()
    scratch[t] = value
    cuda.syncthreads()
    while width > 0:
        if t < width:
            other = scratch[t + width]
            scratch[t] = min(scratch[t], other) if least else scratch[t] + other
        cuda.syncthreads()
        width //= 2
    return scratch[0]


@cuda.jit
def _cell_sums(v, left, right, exponents, n, mean, sums):  # type: ignore[no-untyped-def]
    """Counts, means (2, cells) and sums of ``da^p db^q`` (orders, cells), as `CentralSums.of_columns` computes them.

    Thread block i handles the rows ``left[i]`` and ``right[i]`` of `v`, shape (variables, paths), over the paths where
    both are finite.  Means are taken about the first of them, so that a constant comes out exact.
    """
    scratch = cuda.shared.array(MOST_THREADS, np.float64)
    kept = cuda.local.array(MOST_ORDERS, np.float64)
    powers = cuda.local.array((2, MOST_POWERS), np.float64)
    cell, t, paths = cuda.blockIdx.x, cuda.threadIdx.x, v.shape[1]
    a, b = v[left[cell]], v[right[cell]]
    first = float(paths)
    for p in range(t, paths, cuda.blockDim.x):
        if math.isfinite(a[p]) and math.isfinite(b[p]):
            first = float(p)
            break
    origin = int(_reduce(first, scratch, True))
    if origin == paths:
        if t == 0:
            n[cell], mean[0, cell], mean[1, cell] = 0.0, 0.0, 0.0
            for o in range(exponents.shape[0]):
                sums[o, cell] = 0.0
        return
    count, total_a, total_b = 0.0, 0.0, 0.0
    for p in range(t, paths, cuda.blockDim.x):
        if math.isfinite(a[p]) and math.isfinite(b[p]):
            count += 1.0
            total_a += a[p] - a[origin]
            total_b += b[p] - b[origin]
    count = _reduce(count, scratch, False)
    mean_a = a[origin] + _reduce(total_a, scratch, False) / count
    mean_b = b[origin] + _reduce(total_b, scratch, False) / count
    for o in range(exponents.shape[0]):
        kept[o] = 0.0
    powers[0, 0], powers[1, 0] = 1.0, 1.0
    for p in range(t, paths, cuda.blockDim.x):
        if math.isfinite(a[p]) and math.isfinite(b[p]):
            for j in range(1, MOST_POWERS):
                powers[0, j] = powers[0, j - 1] * (a[p] - mean_a)
                powers[1, j] = powers[1, j - 1] * (b[p] - mean_b)
            for o in range(exponents.shape[0]):
                kept[o] += powers[0, exponents[o, 0]] * powers[1, exponents[o, 1]]
    for o in range(exponents.shape[0]):
        whole = _reduce(kept[o], scratch, False)
        if t == 0:
            sums[o, cell] = whole
    if t == 0:
        n[cell], mean[0, cell], mean[1, cell] = count, mean_a, mean_b


@cuda.jit
def _tally(rows, itineraries, counts):  # type: ignore[no-untyped-def]
    """Counts of each code per impact, and of the paths that have followed each itinerary so far.

    Thread block (k, j) counts, at impact k, the code number j; or, for j beyond the codes, an itinerary.
    """
    scratch = cuda.shared.array(MOST_THREADS, np.float64)
    k, j, t = cuda.blockIdx.x, cuda.blockIdx.y, cuda.threadIdx.x
    count = 0.0
    for p in range(t, rows.shape[2], cuda.blockDim.x):
        same = True
        if j < len(CODES):
            same = rows[k, 6, p] == CODES[j]
        else:
            for i in range(k + 1):
                same = same and rows[i, 6, p] == itineraries[j - len(CODES), i]
        if same:
            count += 1.0
    count = _reduce(count, scratch, False)
    if t == 0:
        counts[j, k] = count


def launch(kernel: Any, grid: int | tuple[int, int], threads: int, *arguments: Any) -> None:
    """Run a CUDA kernel, without numba's warning about a grid too small to fill the GPU."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "(?s).*Grid size")
        kernel[grid, threads](*arguments)


def _sums(v: Any, variables: int, pairs: Sequence[tuple[int, int]], orders: Orders, threads: int) -> CentralSums:
    """Sums over pairs of variables within each group; `v` is on the GPU, of shape (groups, variables, paths)."""
    groups, _, paths = v.shape
    base = variables * np.arange(groups)[:, None]
    left, right = ((base + np.array(side)).ravel() for side in zip(*pairs, strict=True))
    cells, shape = left.size, (groups, len(pairs))
    n, mean = cuda.device_array(cells, np.float64), cuda.device_array((2, cells), np.float64)
    sums = cuda.device_array((len(orders), cells), np.float64)
    listed = [cuda.to_device(array) for array in (left, right, np.array(orders))]
    launch(_cell_sums, cells, threads, v.reshape(groups * variables, paths), *listed, n, mean, sums)
    found, means, powers = (array.copy_to_host() for array in (n, mean, sums))
    return CentralSums(orders, found.reshape(shape), means.reshape(2, *shape), powers.reshape(len(orders), *shape))


def reduce(plan: Plan, rows: Any, fixed: Any, counts: Ints, threads: int) -> BlockResult:
    """The result of a launch, reduced on the GPU.

    Shapes: `rows` (impacts, COLUMNS, paths); `fixed` (times, 4, paths); `counts` (3,).
    """
    sums = {"section": _sums(rows, COLUMNS, [(i, i) for i in range(len(SECTION))], SINGLE, threads)}
    sums["section_pairs"] = _sums(rows, COLUMNS, SECTION_PAIRS, COVARIANCE, threads)
    if plan.fixed_steps.size:
        sums["fixed"] = _sums(fixed, 4, CROSS, PAIR, threads)
    itineraries = np.array(list(plan.itineraries.values()), dtype=float).reshape(-1, plan.impacts)
    counted = cuda.device_array((len(CODES) + len(itineraries), plan.impacts), np.float64)
    launch(_tally, counted.shape[::-1], threads, rows, cuda.to_device(itineraries), counted)
    found = counted.copy_to_host()
    followed = dict(zip(plan.itineraries, found[len(CODES) :], strict=True))
    steps, sticking, unfinished = (int(counts[i]) for i in (STEPS, STICKING, UNFINISHED))
    return BlockResult(sums, found[: len(CODES)].T.copy(), followed, steps, sticking, unfinished)


def resident_threads() -> int:
    """Threads that the GPU holds at a time."""
    device = cuda.get_current_device()
    return int(device.MULTIPROCESSOR_COUNT * device.MAX_THREADS_PER_MULTIPROCESSOR)


def launch_size(plan: Plan) -> int:
    """Paths of a launch: `ROUNDS` per resident thread, or as many as fit a quarter of the GPU's free memory."""
    if SIMULATOR:
        return min(SIMULATED, plan.paths)
    free, _ = cuda.current_context().get_memory_info()
    bytes_per_path = 8 * (plan.impacts * COLUMNS + 4 * plan.fixed_steps.size)
    room = max(int(free / 4 / bytes_per_path) // THREADS * THREADS, THREADS)
    return min(ROUNDS * resident_threads(), room, plan.paths)


def follower(plan: Plan) -> Callable[[int, int], tuple[Any, Any, Ints]]:
    """Compile the kernel of a plan, and copy to the GPU what all launches share.

    Returns: A function that follows paths, of the number of the first one and of how many: it gives impacts and states
    at fixed times (on the GPU), and counts of the work.
    """
    scene, (job, _, _) = plan.scene, begin_block(plan, 0, 1)
    noise = "none" if scene.sigma == 0.0 else "two-point" if plan.two_point else "gaussian"
    sides = ((scene.start.x1, scene.gap1), (scene.start.x2, scene.gap2))
    gaps = np.repeat([[scene.gap1], [scene.gap2]], 2, axis=0)
    start = tuple(start_state(scene, gaps)[:, 0].tolist())
    flanks = tuple(int(np.sign(x)) * (abs(x) == gap) for x, gap in sides)
    kernel = path_kernel(job.scheme, noise, job.backlash.random, job.backlash.redrawn)
    fixed_steps, threads = cuda.to_device(plan.fixed_steps), SIMULATED // 2 if SIMULATOR else THREADS

    def follow(first: int, paths: int) -> tuple[Any, Any, Ints]:
        rows = cuda.device_array((plan.impacts, COLUMNS, paths), np.float64)
        fixed = cuda.device_array((plan.fixed_steps.size, 4, paths), np.float64)
        counts = cuda.to_device(np.zeros(3, np.int64))
        launch(kernel, -(-paths // threads), threads, job, first, start, flanks, rows, fixed_steps, fixed, counts)
        return rows, fixed, counts.copy_to_host()

    return follow


def launches(plan: Plan, size: int) -> Iterator[tuple[BlockResult, Floats | None]]:
    """Results of the launches of a plan, in order, as `rattle.montecarlo.kernel.block.run` gives them for blocks.

    Shapes: `rows` (paths, impacts, COLUMNS), or None.
    """
    follow = follower(plan)
    for first in range(0, plan.paths, size):
        rows, fixed, counts = follow(first, min(size, plan.paths - first))
        kept = np.ascontiguousarray(rows.copy_to_host().transpose(2, 0, 1)) if plan.keep else None
        if kept is not None and plan.scene.stages == 1:
            kept[:, :, 4:6] = np.nan
        yield reduce(plan, rows, fixed, counts, 2 if SIMULATOR else MOST_THREADS), kept
