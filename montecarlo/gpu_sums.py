"""Sums over paths on a card, so that only sums cross the bus: a block of threads for each cell.

Every sum is taken in an order that the number of threads and of paths alone decides: a run is repeatable bit for bit.
"""

import math

import numpy as np
from numba import cuda

from montecarlo.block import CODES

__all__ = ["THREADS", "cell_sums", "tally"]

THREADS = 256  # of a block, at most; a power of two
MOST_ORDERS, MOST_POWERS = 16, 9


@cuda.jit(device=True)
def _total(value, scratch):  # type: ignore[no-untyped-def]
    """Sum of the threads' values, by halves; every thread gets it."""
    t, width = cuda.threadIdx.x, cuda.blockDim.x // 2
    cuda.syncthreads()
    scratch[t] = value
    cuda.syncthreads()
    while width > 0:
        if t < width:
            scratch[t] += scratch[t + width]
        cuda.syncthreads()
        width //= 2
    return scratch[0]


@cuda.jit(device=True)
def _least(value, scratch):  # type: ignore[no-untyped-def]
    """Least of the threads' values."""
    t, width = cuda.threadIdx.x, cuda.blockDim.x // 2
    cuda.syncthreads()
    scratch[t] = value
    cuda.syncthreads()
    while width > 0:
        if t < width:
            scratch[t] = min(scratch[t], scratch[t + width])
        cuda.syncthreads()
        width //= 2
    return scratch[0]


@cuda.jit
def cell_sums(v, left, right, exponents, n, mean, sums):  # type: ignore[no-untyped-def]
    """Counts, means (2, cells) and sums of ``da^p db^q`` (orders, cells), as `montecarlo.accumulate` takes of a block.

    Block i of threads is about the rows ``left[i]`` and ``right[i]`` of `v`, shape (variables, paths), over the paths
    where both are finite; means are taken about the first of them, so that what does not vary comes out exact.
    """
    scratch = cuda.shared.array(THREADS, np.float64)
    kept = cuda.local.array(MOST_ORDERS, np.float64)
    powers = cuda.local.array((2, MOST_POWERS), np.float64)
    cell, t, paths = cuda.blockIdx.x, cuda.threadIdx.x, v.shape[1]
    a, b = v[left[cell]], v[right[cell]]
    first = float(paths)
    for p in range(t, paths, cuda.blockDim.x):
        if math.isfinite(a[p]) and math.isfinite(b[p]):
            first = float(p)
            break
    origin = int(_least(first, scratch))
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
    count = _total(count, scratch)
    mean_a = a[origin] + _total(total_a, scratch) / count
    mean_b = b[origin] + _total(total_b, scratch) / count
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
        whole = _total(kept[o], scratch)
        if t == 0:
            sums[o, cell] = whole
    if t == 0:
        n[cell], mean[0, cell], mean[1, cell] = count, mean_a, mean_b


@cuda.jit
def tally(rows, itineraries, codes, agreeing):  # type: ignore[no-untyped-def]
    """Counts of each code per impact, and of the paths that have followed each itinerary so far.

    Block (k, j) of threads counts for impact k the code number j, or after the codes the itinerary.
    """
    scratch = cuda.shared.array(THREADS, np.float64)
    k, j, t = cuda.blockIdx.x, cuda.blockIdx.y, cuda.threadIdx.x
    count = 0.0
    for p in range(t, rows.shape[2], cuda.blockDim.x):
        if j < len(CODES):
            if rows[k, 6, p] == CODES[j]:
                count += 1.0
        else:
            same = True
            for i in range(k + 1):
                same = same and rows[i, 6, p] == itineraries[j - len(CODES), i]
            if same:
                count += 1.0
    count = _total(count, scratch)
    if t == 0:
        if j < len(CODES):
            codes[k, j] = count
        else:
            agreeing[j - len(CODES), k] = count
