"""Where the parts of a mixture are cut before their flight, the worst first, until none is bad or the room is used.

A part that reaches over a boundary between two events lands in two halves.  What is cut, before that, is

- a tail beyond a boundary, off by its plane: cutting a Gaussian in three first would lose it, and rare events with it;
- a part over which the section map bends, in three across that direction.
"""

import math
from typing import NamedTuple

import numpy as np

from rattle.closure.branching.mixture import Mixture, empty
from rattle.closure.branching.propagate import Image, propagate
from rattle.closure.branching.split import THIRD_CENTRE, THIRD_WEIGHT, THIRD_WIDTH, cut_plane, event, half, root
from rattle.closure.flanks import PLAIN
from rattle.closure.orbit import Floats, Ints
from rattle.closure.small_matrices import beyond, block, congruence, norm, put_row, put_scaled
from rattle.scene.compiled import jit, spliced
from rattle.scene.flight import jacobian, noise_covariance
from rattle.scene.scene import Constants

__all__ = ["Buffers", "buffers", "fly"]

NEGLIGIBLE = 1e-6  # weight that may lie beyond a boundary without being looked for
LIGHT = 1e-4  # weight of a part from which boundaries are looked for
TAIL = 2.0  # sds to a boundary from which what lies beyond is a tail
WORTH = 1e-6  # error below which nothing is cut
BRANCH = 0.03  # error of a boundary through the centre of a part, as a share of its weight
FLAT = 1e-4  # second-order variance, as a share of the first-order one, that is not worth a cut
DAMPED = 15.0  # of a flight, as damping times time
POWER = 0.35  # error of a part over its weight, as a power of that share


class Buffers(NamedTuple):
    """Parts at the start of a flight, noise included; part i lands at places 2 i and, where it is halved, 2 i + 1."""

    start: Mixture
    image: Image
    ignored: Ints  # bit mask of events that were cut off
    error: Floats  # by weight
    axis: Floats  # one sd across the cut
    depth: Floats  # of the plane that cuts a tail off, in sds; 0 for a cut in three
    beyond: Ints  # the event there


def buffers(size: int, d: int = PLAIN) -> Buffers:
    """Room for `size` parts over d quantities."""
    image = Image(empty(2 * size, d), np.zeros((2 * size, 2)))
    return Buffers(
        empty(size, d), image, np.zeros(size, np.int64), np.zeros(size), np.zeros((size, d)), np.zeros(size),
        np.zeros(size, np.int64),
    )  # fmt: skip


@jit
def _bend_error(weight: float, bend: float) -> float:
    return weight * bend**POWER if bend > FLAT else 0.0


@spliced
def _across(axes: Floats, n: Floats, narrow: float) -> Floats:
    """The axes, narrower by that factor along the unit vector n."""
    along, out = axes @ n, np.empty_like(axes)
    for i in range(out.shape[0]):
        for j in range(n.size):
            out[i, j] = axes[i, j] + (narrow - 1.0) * (along[i] * n[j])
    return out


@spliced
def _examine(c: Constants, b: Buffers, i: int, before: Floats) -> None:
    """Land part `i`, whole or in its halves beside a plane, and find across which direction it would be cut.

    Its error is what that cut is worth.
    """
    w, centre = b.start.weight[i], b.start.mean[i]
    b.image.section.weight[2 * i], b.image.section.weight[2 * i + 1] = w, 0.0
    b.error[i], b.depth[i] = 0.0, 0.0
    rank, full = root(b.start.covariance[i])
    axes = block(full, centre.size, 0, rank)
    code = event(c, centre, before)[1]
    n, depth, pieces = np.zeros(rank), 0.0, 1
    if w > LIGHT and rank > 0 and code != 0:
        reach = math.sqrt(2.0 * math.log(w / NEGLIGIBLE) - 2.0)
        other, q = cut_plane(c, centre, axes, code, b.ignored[i], reach, before)
        if other != code:
            length = norm(q)
            put_scaled(n, q, length)
            depth = 1.0 / length
            if length * TAIL < 1.0:
                b.error[i], b.depth[i], b.beyond[i] = w, depth, other
                put_row(b.axis[i], axes @ n)
            else:
                pieces = 2
    worst = 0.0
    for k in range(pieces):
        share, rate, variance = half(depth, k == 0) if pieces == 2 else (1.0, 0.0, 1.0)
        narrow = math.sqrt(variance)
        b.image.section.weight[2 * i + k] = w * share
        at, across = (beyond(centre, rate, axes @ n), _across(axes, n, narrow)) if pieces == 2 else (centre, axes)
        bend, u = propagate(c, at, across, b.image, 2 * i + k, before)
        if b.depth[i] > 0.0:
            return
        error = _bend_error(w * share, bend)
        b.error[i] += error
        if pieces == 1 or error > worst:
            worst = error
            if pieces == 2:
                slant = (1.0 / narrow - 1.0) * (u @ n)
                for m in range(rank):
                    u[m] += slant * n[m]  # across the same planes, in sds of the whole
                put_scaled(u, u, norm(u))
            put_row(b.axis[i], axes @ u)
    if pieces == 2:
        crossing = BRANCH * w * math.exp(-0.5 * depth * depth)
        if crossing > b.error[i]:
            put_row(b.axis[i], axes @ n)
        b.error[i] += crossing


@jit
def _cut(b: Buffers, i: int, count: int) -> int:
    """Replace part `i` by two or three across its axis, the further ones from `count` on; returns the new count."""
    parts, v = b.start, b.axis[i].copy()
    w, centre, sigma = parts.weight[i], parts.mean[i].copy(), parts.covariance[i].copy()
    pieces = 2 if b.depth[i] > 0.0 else 3
    code = b.image.section.label[2 * i]
    for k in range(pieces):
        at = i if k == 0 else count + k - 1
        if pieces == 2:
            share, place, variance = half(b.depth[i], k == 0)
        else:
            share = THIRD_WEIGHT if k > 0 else 1.0 - 2.0 * THIRD_WEIGHT
            place, variance = (0.0 if k == 0 else (2 * k - 3) * THIRD_CENTRE), THIRD_WIDTH**2
        parts.weight[at] = w * share
        for m in range(v.size):
            parts.mean[at, m] = centre[m] + place * v[m]
            for n in range(v.size):
                parts.covariance[at, m, n] = sigma[m, n] - (1.0 - variance) * (v[m] * v[n])
        parts.label[at], b.ignored[at] = parts.label[i], b.ignored[i]
    if pieces == 2:
        b.ignored[count] |= 1 << (code + 2)
        b.ignored[i] |= 1 << (b.beyond[i] + 2)
    return count + pieces - 1


@jit
def fly(c: Constants, live: int, b: Buffers) -> tuple[int, float]:
    """Fly the first `live` parts to their next event; returns how many they were cut into, and the weight given up.

    The noise of a flight is put at its start: the displacement ``exp(-A t) n`` leads to the same state at its end.
    A flight that is damped by more than ``exp(-DAMPED)`` leaves no digits of it: such a part is given up.
    """
    before = np.empty(4)
    gone = 0.0
    for i in range(live):
        t, code = event(c, b.start.mean[i], before)
        if code != 0 and t * max(c.beta1, c.beta2) > DAMPED:
            gone += b.start.weight[i]
            b.start.weight[i] = 0.0
        elif code != 0:
            back = jacobian(c, -t)
            noise = congruence(back, noise_covariance(c, b.start.mean[i, 0], t))
            for m in range(4):
                for n in range(4):
                    b.start.covariance[i, 1 + m, 1 + n] += noise[m, n]
        b.ignored[i] = 0
    count, last, seen = live, 0, 0  # seen: parts examined already, but for the last one that was cut
    while True:
        for k in range(seen, count + (1 if seen > 0 else 0)):
            _examine(c, b, last if k == count else k, before)
        seen = count
        if count + 2 > b.error.size:
            break
        last = int(np.argmax(b.error[:count]))
        if b.error[last] < WORTH:
            break
        count = _cut(b, last, count)
    return count, gone
