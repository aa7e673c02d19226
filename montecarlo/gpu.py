"""Ensembles on a card: ``simulate(..., device="cuda")``.

Only this module and those it imports know of CUDA, and nothing imports it before a card is asked for.

``python -m montecarlo.gpu`` measures path-steps per second on the card at hand.  IT HAS NOT YET BEEN RUN ON A CARD: so
far the kernels have been compiled for one and run on numba's simulator of one.
"""

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from montecarlo.accumulate import COVARIANCE, PAIR, SINGLE, CentralSums, Orders
from montecarlo.backlash import backlash_of
from montecarlo.block import CODES, CROSS, PAIRS, SECTION_OF, BlockResult, Plan, start_state
from montecarlo.kernel import COLUMNS, Job
from montecarlo.noise import key_of
from montecarlo.schemes import SCHEMES
from scene.errors import InputError
from scene.moments import SECTION

__all__ = ["check_card", "launch_size", "launches", "measure"]

Floats = NDArray[np.float64]

THREADS = 128
"""Threads of a block of paths."""

ROUNDS = 8
"""Paths per thread that the card can hold at a time: fewer launches, and few idle threads at the end of each."""

SIMULATED = 8
"""Paths of a launch on the simulator, on half as many threads."""


def check_card() -> None:
    """Refuse to go on where there is no card to run on.

    Raises
    ------
    InputError
        Names what is missing: the package, the compiler's libraries, the driver, or the card.
    """
    if find_spec("numba_cuda") is None:
        raise InputError("device", "cuda", "needs the package numba-cuda; run: pip install 'rattle[gpu]'")
    from numba import cuda

    if cuda.is_available():
        return
    try:
        cards = len(cuda.gpus)
    except cuda.CudaSupportError as error:
        reason = " ".join(str(error).split())
        raise InputError("device", "cuda", f"needs an NVIDIA driver and a card; {reason}") from None
    if cards == 0:
        raise InputError("device", "cuda", "needs a card; the driver finds none")
    raise InputError("device", "cuda", "needs CUDA's compiler libraries; run: pip install 'rattle[gpu]'")


def _simulated() -> bool:
    from numba import config

    return bool(config.ENABLE_CUDASIM)


def _resident() -> int:
    """Threads that the card holds at a time."""
    from numba import cuda

    device = cuda.get_current_device()
    return int(device.MULTIPROCESSOR_COUNT * device.MAX_THREADS_PER_MULTI_PROCESSOR)


def launch_size(plan: Plan) -> int:
    """Paths of a launch: a few per thread of the card, as far as a quarter of its free memory holds their impacts."""
    if _simulated():
        return min(SIMULATED, plan.paths)
    from numba import cuda

    free, _ = cuda.current_context().get_memory_info()
    bytes_per_path = 8 * (plan.impacts * COLUMNS + 4 * plan.clock_steps.size)
    room = max(int(free / 4 / bytes_per_path) // THREADS * THREADS, THREADS)
    return min(ROUNDS * _resident(), room, plan.paths)


class _Card(NamedTuple):
    """What stays on the card from launch to launch."""

    plan: Plan
    job: Job
    start: tuple[float, ...]
    flanks: tuple[int, ...]
    follow: Callable[..., Any]
    clock_steps: Any
    itineraries: Any


def _prepared(plan: Plan) -> _Card:
    from numba import cuda

    from montecarlo.gpu_paths import path_kernel

    scene, scheme, backlash = plan.scene, SCHEMES[plan.scheme].code, backlash_of(plan.scene)
    job = Job(scene.constants, backlash, key_of(plan.seed), scene.start.tau, plan.dt, scheme, plan.most_steps)
    sides = ((scene.start.x1, scene.gap1), (scene.start.x2, scene.gap2))
    gaps = np.repeat([[scene.gap1], [scene.gap2]], 2, axis=0)
    listed = np.array(list(plan.itineraries.values()), dtype=float).reshape(-1, plan.impacts)
    return _Card(
        plan,
        job,
        tuple(start_state(scene, gaps)[:, 0].tolist()),
        tuple(int(np.sign(x)) if abs(x) == gap else 0 for x, gap in sides),
        path_kernel(scheme, scene.sigma > 0.0, backlash.random, backlash.redrawn),
        cuda.to_device(plan.clock_steps),
        cuda.to_device(listed),
    )


def _followed(card: _Card, first: int, paths: int) -> tuple[Any, Any, NDArray[np.int64]]:
    """Follow paths from number `first` on: impacts and clock states on the card, and the counts of the work."""
    from numba import cuda

    plan = card.plan
    threads = SIMULATED // 2 if _simulated() else THREADS
    rows = cuda.device_array((plan.impacts, COLUMNS, paths), np.float64)
    clock = cuda.device_array((plan.clock_steps.size, 4, paths), np.float64)
    counts = cuda.to_device(np.zeros(3, np.int64))
    card.follow[-(-paths // threads), threads](  # type: ignore[index]
        card.job, first, card.start, card.flanks, rows, card.clock_steps, clock, counts
    )
    return rows, clock, counts.copy_to_host()


def _sums(
    v: Any, groups: int, variables: int, pairs: Sequence[tuple[int, int]], orders: Orders
) -> CentralSums:
    """Sums over pairs of variables, on the card; `v` has shape (groups, variables, paths)."""
    from numba import cuda

    from montecarlo.gpu_sums import THREADS as MOST
    from montecarlo.gpu_sums import cell_sums

    base = variables * np.arange(groups)[:, None]
    left, right = ((base + np.array(side)).ravel() for side in zip(*pairs, strict=True))
    cells = left.size
    n, mean = cuda.device_array(cells, np.float64), cuda.device_array((2, cells), np.float64)
    sums = cuda.device_array((len(orders), cells), np.float64)
    cell_sums[cells, 2 if _simulated() else MOST](
        v.reshape(groups * variables, v.shape[2]), cuda.to_device(left), cuda.to_device(right),
        cuda.to_device(np.array(orders)), n, mean, sums,
    )  # fmt: skip
    shape = (groups, len(pairs))
    return CentralSums(
        orders, n.copy_to_host().reshape(shape), mean.copy_to_host().reshape(2, *shape),
        sums.copy_to_host().reshape(len(orders), *shape),
    )  # fmt: skip


def _reduced(card: _Card, rows: Any, clock: Any, counts: NDArray[np.int64]) -> BlockResult:
    from numba import cuda

    from montecarlo.gpu_paths import HELD, STEPS, UNFINISHED
    from montecarlo.gpu_sums import THREADS as MOST
    from montecarlo.gpu_sums import tally

    plan = card.plan
    own, pairs = [(i, i) for i in range(len(SECTION))], [(SECTION_OF[i], SECTION_OF[j]) for i, j in PAIRS]
    sums = {
        "section": _sums(rows, plan.impacts, COLUMNS, own, SINGLE),
        "section_pairs": _sums(rows, plan.impacts, COLUMNS, pairs, COVARIANCE),
    }
    if plan.clock_steps.size:
        sums["clock"] = _sums(clock, plan.clock_steps.size, 4, CROSS, PAIR)
    codes = cuda.device_array((plan.impacts, len(CODES)), np.float64)
    agreeing = cuda.device_array(card.itineraries.shape, np.float64)
    tally[(plan.impacts, len(CODES) + len(plan.itineraries)), 2 if _simulated() else MOST](
        rows, card.itineraries, codes, agreeing
    )
    return BlockResult(
        sums, codes.copy_to_host(), dict(zip(plan.itineraries, agreeing.copy_to_host(), strict=True)),
        int(counts[STEPS]), int(counts[HELD]), int(counts[UNFINISHED]),
    )  # fmt: skip


def launches(plan: Plan) -> Iterator[tuple[BlockResult, Floats | None]]:
    """Results of all launches in order, and the impacts (paths, impacts, COLUMNS) of each if the plan keeps them."""
    card, size = _prepared(plan), launch_size(plan)
    for first in range(0, plan.paths, size):
        rows, clock, counts = _followed(card, first, min(size, plan.paths - first))
        kept = np.ascontiguousarray(rows.copy_to_host().transpose(2, 0, 1)) if plan.keep else None
        yield _reduced(card, rows, clock, counts), kept
