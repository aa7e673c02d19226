"""Speed of the present GPU in path-steps per second: ``python -m rattle.montecarlo.cuda.bench``.

IT HAS NOT YET BEEN RUN ON A GPU: so far the kernels have been compiled for one, and run on numba's simulator of one.

From the counts in `COSTS` an H200 (132 multiprocessors at 1.98 GHz, 128 instructions and 64 float64 ones per clock) can
start at most 2.3e11 path-steps of ``euler-maruyama`` per second, 6.6e11 with two-point increments.  An ESTIMATE, with
half to 0.7 of these instructions started, a tenth of the steps of a warp stopped by an impact, and threads that wait
for the slowest path of their warp (0.94 of them at work at sigma = 0.1, 0.64 at sigma = 1.2): 0.6e11 to 1.3e11, and
1.5e11 to 3e11 with two-point increments.
"""

import math
import time
from typing import NamedTuple

import pandas as pd

from rattle.montecarlo.cuda.launch import ROUNDS, follower, launch_size, resident_threads
from rattle.montecarlo.kernel.block import Plan
from rattle.montecarlo.settings import Sampling, check_gpu, plan_of
from rattle.scene import DAT21, InputError, Scene

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
    follow, paths = follower(plan), launch_size(plan)
    follow(0, paths)
    best = 0.0
    for _ in range(repeats):
        begin = time.perf_counter()
        *_, counts = follow(0, paths)  # fetching the counts waits for the paths
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
        sampling = Sampling(increments=increments, device="cuda")
        rate = speed(plan_of(scene, ROUNDS * resident_threads(), impacts, dt, scheme, sampling=sampling))
        shares = cost.float64_instructions * rate / (clocks * lanes), cost.instructions * rate / (clocks * LANES)
        rows.append((scheme, increments, rate, cost.flops * rate, cost.random_words * rate, *shares))
    columns = ["scheme", "increments", "path_steps_per_s", "flops_per_s", "words_per_s", "of_float64", "of_issue"]
    return pd.DataFrame(rows, columns=columns).set_index(columns[:2])


if __name__ == "__main__":
    try:
        print(measure().to_string(float_format="{:.3g}".format))
    except InputError as error:
        raise SystemExit(str(error)) from None
