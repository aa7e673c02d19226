"""Compile all kernels for compute capability 9.0, where no GPU needs to be; print each one's target.

What the simulator runs is Python: only the compiler sees whether a kernel's types fit.
"""

import re
from types import SimpleNamespace

import numba
import numba.cuda.dispatcher
import numpy as np
from mc_checks import dat21
from numba import cuda, types

from rattle.montecarlo.cuda import launch as gpu_sums
from rattle.montecarlo.cuda.paths import path_kernel
from rattle.montecarlo.kernel.kernel import EXACT, LOCATED, PLAIN, Job
from rattle.montecarlo.noise.backlash import backlash_of
from rattle.montecarlo.noise.philox import key_of

CAPABILITY = (9, 0)
FLOATS = [types.Array(types.float64, n, "C") for n in range(4)]
INTS = [types.Array(types.int64, n, "C") for n in range(3)]


def main() -> None:
    # functions that a kernel calls are compiled for the present GPU, whatever the kernel is compiled for
    numba.cuda.dispatcher.get_current_device = lambda: SimpleNamespace(compute_capability=CAPABILITY)
    scene = dat21(0.1)
    job = Job(scene.constants, backlash_of(scene), key_of(np.random.SeedSequence(1)), 0.0, 0.01, 0, False, 1000)
    follow = types.void(
        numba.typeof(job), types.int64, types.UniTuple(types.float64, 4), types.UniTuple(types.int64, 2), FLOATS[3],
        INTS[1], FLOATS[3], INTS[1],
    )  # fmt: skip
    kernels = [
        (path_kernel(scheme, noise, random, random), follow)
        for scheme, noise, random in (
            (PLAIN, "gaussian", False), (PLAIN, "two-point", True), (LOCATED, "none", True), (EXACT, "gaussian", True),
        )
    ]  # fmt: skip
    kernels.append((gpu_sums._cell_sums, types.void(FLOATS[2], INTS[1], INTS[1], INTS[2], FLOATS[1], *FLOATS[2:3] * 2)))
    kernels.append((gpu_sums._tally, types.void(FLOATS[3], *FLOATS[2:3] * 2)))
    for kernel, signature in kernels:
        ptx, _ = cuda.compile_ptx(kernel.py_func, signature, cc=CAPABILITY)
        print(re.search(r"\.target (\w+)", ptx)[1])


if __name__ == "__main__":
    main()
