"""Where the parts of a mixture are cut before their flight, the worst first, until none is bad or the room is used.

A part that reaches over a boundary between two events lands in two halves.  What is cut, before that, is

- a tail beyond a boundary, off by its plane: cutting a Gaussian in three first would lose it, and rare events with it;
- a part over which the section map bends, in three across that direction.
"""

import math
from typing import NamedTuple

import numpy as np

from closure.cutting import THIRD_CENTRE, THIRD_WEIGHT, THIRD_WIDTH, cut_plane, event, half, root
from closure.gaussian_flight import Landing, lead
from closure.mixture import Mixture, empty
from closure.orbit import Floats, Ints
from scene.compiled import jit
from scene.flight import jacobian, noise_covariance
from scene.scene import Constants

__all__ = ["Workbench", "fly", "workbench"]

NEGLIGIBLE = 1e-6  # weight that may lie beyond a boundary without being looked for
LIGHT = 1e-4  # weight of a part from which boundaries are looked for
TAIL = 2.0  # sds to a boundary from which what lies beyond is a tail
WORTH = 1e-6  # error below which nothing is cut
BRANCH = 0.03  # error of a boundary through the centre of a part, as a share of its weight
FLAT = 1e-4  # second-order variance, as a share of the first-order one, that is not worth a cut
POWER = 0.35  # error of a part over its weight, as a power of that share


class Workbench(NamedTuple):
    """Parts at the start of a flight, noise included; part i lands at places 2 i and, where it is halved, 2 i + 1."""

    start: Mixture
    landing: Landing
    ignored: Ints  # bit mask of events that were cut off
    error: Floats  # by weight
    axis: Floats  # one sd across the cut
    depth: Floats  # of the plane that cuts a tail off, in sds; 0 for a cut in three
    beyond: Ints  # the event there


def workbench(size: int) -> Workbench:
    """Room for `size` parts."""
    landing = Landing(empty(2 * size), np.zeros((2 * size, 2)))
    return Workbench(
        empty(size), landing, np.zeros(size, np.int64), np.zeros(size), np.zeros((size, 5)), np.zeros(size),
        np.zeros(size, np.int64),
    )  # fmt: skip


@jit
def _bend_error(weight: float, bend: float) -> float:
    return weight * bend**POWER if bend > FLAT else 0.0


@jit
def _land_in_halves(c: Constants, b: Workbench, i: int, axes: Floats, q: Floats, before: Floats) -> None:
    """Land part `i` in its halves beside the plane ``q z = 1``."""
    w, centre = b.start.weight[i], b.start.mean[i]
    length = math.sqrt((q * q).sum())
    depth, n = 1.0 / length, q / length
    worst = 0.0
    for k in range(2):
        share, rate, variance = half(depth, k == 0)
        narrow = math.sqrt(variance)
        b.landing.section.weight[2 * i + k] = w * share
        bend, u = lead(
            c, centre + rate * (axes @ n), axes + (narrow - 1.0) * np.outer(axes @ n, n), b.landing, 2 * i + k, before
        )
        error = _bend_error(w * share, bend)
        b.error[i] += error
        if error > worst:
            worst = error
            u += (1.0 / narrow - 1.0) * (u @ n) * n  # across the same planes, in sds of the whole
            b.axis[i] = axes @ (u / math.sqrt((u * u).sum()))
    crossing = BRANCH * w * math.exp(-0.5 * depth * depth)
    if crossing > b.error[i]:
        b.axis[i] = axes @ n
    b.error[i] += crossing


@jit
def _examine(c: Constants, b: Workbench, i: int, before: Floats) -> None:
    """Land part `i`, and find across which direction it would be cut and what that is worth."""
    w, centre = b.start.weight[i], b.start.mean[i]
    b.landing.section.weight[2 * i], b.landing.section.weight[2 * i + 1] = w, 0.0
    b.error[i], b.depth[i] = 0.0, 0.0
    rank, full = root(b.start.covariance[i])
    axes = np.ascontiguousarray(full[:, :rank])
    code = event(c, centre, before)[1]
    if w > LIGHT and rank > 0 and code != 0:
        reach = math.sqrt(2.0 * math.log(w / NEGLIGIBLE) - 2.0)
        other, q = cut_plane(c, centre, axes, code, b.ignored[i], reach, before)
        length = math.sqrt((q * q).sum())
        if other != code and length * TAIL < 1.0:
            b.error[i], b.depth[i], b.beyond[i] = w, 1.0 / length, other
            b.axis[i] = axes @ (q / length)
        elif other != code:
            _land_in_halves(c, b, i, axes, q, before)
            return
    bend, u = lead(c, centre, axes, b.landing, 2 * i, before)
    if b.depth[i] == 0.0:
        b.error[i] = _bend_error(w, bend)
        b.axis[i] = axes @ u


@jit
def _cut(b: Workbench, i: int, count: int) -> int:
    """Replace part `i` by two or three across its axis, the further ones from `count` on; returns the new count."""
    parts, v = b.start, b.axis[i].copy()
    w, centre, sigma = parts.weight[i], parts.mean[i].copy(), parts.covariance[i].copy()
    across = np.outer(v, v)
    pieces = 2 if b.depth[i] > 0.0 else 3
    code = b.landing.section.label[2 * i]
    for k in range(pieces):
        at = i if k == 0 else count + k - 1
        if pieces == 2:
            share, place, variance = half(b.depth[i], k == 0)
        else:
            share = THIRD_WEIGHT if k > 0 else 1.0 - 2.0 * THIRD_WEIGHT
            place, variance = (0.0 if k == 0 else (2 * k - 3) * THIRD_CENTRE), THIRD_WIDTH**2
        parts.weight[at], parts.mean[at] = w * share, centre + place * v
        parts.covariance[at] = sigma - (1.0 - variance) * across
        parts.label[at], b.ignored[at] = parts.label[i], b.ignored[i]
    if pieces == 2:
        b.ignored[count] |= 1 << (code + 2)
        b.ignored[i] |= 1 << (b.beyond[i] + 2)
    return count + pieces - 1


@jit
def fly(c: Constants, live: int, b: Workbench) -> int:
    """Fly the first `live` parts to their next event; returns how many parts they were cut into.

    The noise of a flight is put at its start: the displacement ``exp(-A t) n`` leads to the same state at its end.
    """
    before = np.empty(4)
    for i in range(live):
        t, code = event(c, b.start.mean[i], before)
        if code != 0:
            back = jacobian(c, -t)
            b.start.covariance[i, 1:, 1:] += back @ noise_covariance(c, b.start.mean[i, 0], t) @ back.T
        b.ignored[i] = 0
        _examine(c, b, i, before)
    count = live
    while count + 2 <= b.error.size:
        i = int(np.argmax(b.error[:count]))
        if b.error[i] < WORTH:
            break
        more = _cut(b, i, count)
        _examine(c, b, i, before)
        for k in range(count, more):
            _examine(c, b, k, before)
        count = more
    return count
