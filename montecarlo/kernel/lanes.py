"""Paths side by side in lanes: their arrays, which of them are marked, and how a finished one leaves."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.noise.philox import Word
from rattle.montecarlo.schemes.exact_flight import PARTS
from rattle.scene.compiled import lean, spliced

__all__ = ["Lanes", "Room", "join_halves", "lanes_of", "list_marked", "of_level", "retire"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


class Lanes(NamedTuple):
    """Paths side by side: arrays over (levels, ..., lanes), or for one level over (..., lanes).

    ``before`` is the state at the start of the step, ``w`` and ``area`` its noise in standard units, ``last`` the time
    of the last impact, ``impacts`` how many a path has had.
    """

    state: Floats
    before: Floats
    walls: Floats
    w: Floats
    area: Floats
    last: Floats
    impacts: Ints


class Room(NamedTuple):
    """Scratch of a block: numbers of the paths in the lanes, random bits and normals, perturbations, marked lanes, and
    parts of a step.

    A draw of four normals serves four steps, or two that use the area; the fifth row of ``z`` stays zero.
    """

    path: NDArray[Word]
    bits: NDArray[Word]
    z: Floats
    xi: Floats
    marks: Bools
    groups: Ints
    hits: Ints
    ahead: Floats


def lanes_of(levels: int, first: int, start: Floats, walls: Floats, tau: float) -> tuple[Lanes, Room]:
    """Lanes and scratch of a block; allocated here, for compiled code that allocates takes long to compile.

    Parameters
    ----------
    levels, first : int
        Step sizes side by side; number of the first path.
    start : ndarray, shape (4, paths)
        State after the start.
    walls : ndarray, shape (4, paths)
        Distance of the flanks +1, -1, +2, -2 from the middle.
    tau : float
        Time of the start.
    """
    paths = start.shape[1]
    lanes = (paths + 7) // 8 * 8  # whole vectors: what the last lanes compute when no path is in them is not looked at
    state, wall = np.zeros((levels, 4, lanes)), np.ones((levels, 4, lanes))
    state[:, :, :paths], wall[:, :, :paths] = start, walls
    every = Lanes(
        state, state.copy(), wall, np.zeros((levels, lanes)), np.zeros((levels, lanes)), np.full((levels, lanes), tau),
        np.zeros((levels, lanes), np.int64),
    )  # fmt: skip
    room = Room(
        np.arange(first, first + lanes, dtype=np.uint64), np.zeros(lanes, np.uint64), np.zeros((5, lanes)),
        np.zeros((5, lanes)), np.zeros(lanes, np.bool_), np.empty(lanes // 8 + 1, np.int64),
        np.empty(lanes + 1, np.int64), np.empty((PARTS, 3)),
    )  # fmt: skip
    return every, room


@spliced
def of_level(every: Lanes, level: int, w: Floats, area: Floats) -> Lanes:
    """The lanes of one level, with this noise."""
    return Lanes(
        every.state[level], every.before[level], every.walls[level], w, area, every.last[level], every.impacts[level]
    )  # fmt: skip


@lean
def list_marked(marks: Bools, lanes: int, groups: Ints, out: Ints) -> int:
    """Indices of the marked lanes into `out`, first by groups of eight, for marks are rare.

    There is no branch on a mark, which no processor could foresee: an index is written anyway, and kept if it counts.
    """
    words = marks.view(np.int64)
    some = 0
    for g in range((lanes + 7) // 8):
        groups[some] = g
        some += words[g] != 0
    found = 0
    for i in range(some):
        for p in range(8 * groups[i], 8 * groups[i] + 8):
            out[found] = p
            found += marks[p] & (p < lanes)
    return found


@lean
def join_halves(fine_w: Floats, fine_area: Floats, w: Floats, area: Floats, second: bool, live: int) -> None:
    """Noise of a coarse step from its halves', in standard units (`rattle.montecarlo.noise.brownian.joined` at share
    1/2).
    """
    root2, root3 = math.sqrt(2.0), math.sqrt(3.0)
    for p in range(live):
        w1, w2 = w[p], fine_w[p]
        if second:
            w[p] = (w1 + w2) / root2
            area[p] = (root3 * (w2 - w1) + area[p] + fine_area[p]) / (2.0 * root2)
        else:
            w[p], area[p] = w2, fine_area[p]


@lean
def retire(every: Lanes, path: NDArray[Word], bits: NDArray[Word], xi: Floats, impacts: int, live: int) -> int:
    """Give the lane of a finished path to the last one; returns how many are left."""
    p = 0
    while p < live:
        fewest = every.impacts[0, p]
        for level in range(1, len(every.impacts)):
            fewest = min(fewest, every.impacts[level, p])
        if fewest < impacts:
            p += 1
            continue
        live -= 1
        path[p], path[live] = path[live], path[p]
        bits[p] = bits[live]
        for i in range(5):
            xi[i, p] = xi[i, live]
        for level in range(len(every.impacts)):
            for i in range(4):
                every.state[level, i, p] = every.state[level, i, live]
                every.walls[level, i, p] = every.walls[level, i, live]
            every.last[level, p] = every.last[level, live]
            every.impacts[level, p] = every.impacts[level, live]
    return live
