"""The closure beyond one itinerary: a Gaussian mixture whose parts go on along their own impacts.

A part is a weight and a Gaussian of the section state after an impact, as in the saltation reading.  The noise of the
next flight is put at its start (the displacement ``exp(-A t) n`` leads to the same state at the flight's end), so that
the next event is a function of a point in five dimensions.  Where points of a part that carry more than a negligible
weight meet another mesh or side, or miss, the Gaussian is cut by the plane between the two events into two parts with
the moments of its halves.  Where the section map bends too much over a part, the part is cut in three along that
direction.  Parts of least weight are merged with others of the same itinerary; what is dropped is reported.
"""

import math
from typing import NamedTuple

import numpy as np

from closure.orbit import Floats, Ints, follow
from closure.section_map import derivatives
from closure.trace import Trace
from scene.compiled import jit
from scene.errors import InputError
from scene.flight import jacobian, noise_covariance
from scene.impact import contact_matrix, next_impact
from scene.scene import Constants, Scene

__all__ = ["check", "trace"]

MOST_PARTS = 1000
UNCUT = 1e-3  # weight below which a part is not cut any more
LIGHTEST = 1e-7  # weight below which a part that finds no other of its itinerary is dropped
NEGLIGIBLE = 1e-5  # weight that may lie beyond a boundary without being looked for
BEND = 0.15  # share of an output's sd by which its map may bend over one sd of a part
LONGEST = 100.0  # flight after which a part counts as lost
# The Gaussian in three, as close to it as three of equal width come: centres and width in units of its sd.
THIRD_WEIGHT, THIRD_CENTRE, THIRD_WIDTH = 0.2252246249, 1.0575154615, 0.6715662887


@jit
def _event(c: Constants, e: Floats, before: Floats) -> tuple[float, int]:
    """Flight time and ``mesh * side`` of the next impact from ``e = (tau, x1, y1, x2, y2)``; 0 if there is none."""
    t, mesh, side, x1, y1, x2, y2 = next_impact(c, e[0], e[1], e[2], e[3], e[4], LONGEST)
    before[0], before[1], before[2], before[3] = x1, y1, x2, y2
    return t, (mesh * side if mesh > 0 else 0)


@jit
def _normal(z: float) -> float:
    return math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)


@jit
def _roots(sigma: Floats) -> tuple[int, Floats]:
    """Square root of a covariance by its principal axes: ``rank`` columns, the rest zero."""
    values, vectors = np.linalg.eigh(sigma)
    root = np.zeros((5, 5))
    rank = 0
    for i in range(4, -1, -1):
        if values[i] > 1e-14 * values[4] and values[i] > 0.0:
            root[:, rank] = math.sqrt(values[i]) * vectors[:, i]
            rank += 1
    return rank, root


@jit
def _boundary(
    c: Constants, centre: Floats, axes: Floats, u: Floats, code: int, ignored: int, far: float, before: Floats
) -> tuple[float, int]:
    """Distance (in sds, up to `far`) along a unit vector at which the event changes from `code`, and to which."""
    direction = axes @ u
    found = _event(c, centre + far * direction, before)[1]
    if found == code:
        return np.inf, code
    low, high = 0.0, far
    for _ in range(12):
        middle = 0.5 * (low + high)
        met = _event(c, centre + middle * direction, before)[1]
        if met == code:
            low = middle
        else:
            high, found = middle, met
    if ignored & (1 << (found + 2)):
        return np.inf, code
    return max(high, 1e-3), found


@jit
def _cut_plane(
    c: Constants, centre: Floats, axes: Floats, code: int, ignored: int, reach: float, before: Floats
) -> tuple[int, Floats]:
    """The nearest other event, and the plane ``q z = 1`` that parts it from `code`, z along the principal axes.

    The nearest point of the boundary is sought as in the first-order reliability method (Hasofer and Lind 1974):
    from the best axis, along the normal of the plane through the boundary's points nearby.  Events in the bit
    mask `ignored` are not looked for.  Returns `code` itself where none is within `reach`.
    """
    rank = axes.shape[1]
    far = 1.6 * reach  # a slanted plane within reach cuts one of the axes there
    nearest, other = np.inf, code
    u, trial = np.zeros(rank), np.zeros(rank)
    for ray in range(2 * rank):
        trial[:] = 0.0
        trial[ray // 2] = 1.0 if ray % 2 == 0 else -1.0
        distance, found = _boundary(c, centre, axes, trial, code, ignored, far, before)
        if distance < nearest:
            nearest, other = distance, found
            u[:] = trial
    if other == code:
        return code, u
    for _ in range(2):
        q = np.zeros(rank)
        for i in range(rank):
            trial[:] = u
            trial[i] += 0.5
            length = math.sqrt((trial * trial).sum())
            distance, found = _boundary(c, centre, axes, trial / length, code, ignored, far, before)
            q[i] = 2.0 * ((length / distance if found == other else 0.0) - 1.0 / nearest)
        length = math.sqrt((q * q).sum())
        if length == 0.0:
            break
        trial[:] = q / length
        distance, found = _boundary(c, centre, axes, trial, code, ignored, far, before)
        if not (found == other and distance < nearest):
            break
        nearest = distance
        u[:] = trial
    if nearest > reach:
        return code, u
    return other, u / nearest


@jit
def _half(centre: Floats, axes: Floats, q: Floats, inner: bool) -> tuple[float, Floats, Floats]:
    """Weight, mean and covariance of the part of a Gaussian on one side of the plane ``q z = 1``."""
    length = math.sqrt((q * q).sum())
    depth, n = 1.0 / length, q / length
    beyond = 0.5 * math.erfc(depth / math.sqrt(2.0))
    weight = 1.0 - beyond if inner else beyond
    rate = _normal(depth) / weight * (-1.0 if inner else 1.0)
    shrink = depth * rate - rate * rate  # of the variance across the plane
    axis = axes @ n
    full = axes @ axes.T
    return weight, centre + rate * axis, full + shrink * np.outer(axis, axis)


class Mixture(NamedTuple):
    """Parts of the distribution: weight, mean, covariance and itinerary of each; the first `count` are live."""

    weight: Floats
    mean: Floats
    covariance: Floats
    itinerary: Ints


@jit
def _step(c: Constants, live: int, now: Mixture, after: Mixture, section: Mixture, flight: Floats) -> tuple[int, float]:
    """One impact of every part.

    Parameters
    ----------
    live : int
        Parts in `now`.
    after, section : Mixture
        Output: the parts after the impact and just before it, in one order.
    flight : ndarray, shape (parts, 2)
        Output: mean and variance of each part's flight time.

    Returns
    -------
    count : int
        Parts that came out.
    lost : float
        Weight that met no impact, or for which there was no room.
    """
    room = after.weight.size
    depth = 4 * 64
    weights, means, covariances = np.empty(depth), np.empty((depth, 5)), np.empty((depth, 5, 5))
    ignored = np.zeros(depth, np.int64)
    before, before_other, count, lost = np.empty(4), np.empty(4), 0, 0.0
    for part in range(live):
        t, code = _event(c, now.mean[part], before)
        if code == 0:
            lost += now.weight[part]
            continue
        # the flight's noise, as a displacement of its start that leads to the same state at its end
        back = jacobian(c, -t)
        top = 1
        weights[0], means[0], ignored[0] = now.weight[part], now.mean[part], 0
        covariances[0] = now.covariance[part]
        covariances[0, 1:, 1:] += back @ noise_covariance(c, now.mean[part, 0], t) @ back.T
        while top > 0:
            top -= 1
            w, centre, sigma, mask = weights[top], means[top].copy(), covariances[top].copy(), ignored[top]
            t, code = _event(c, centre, before)
            if code == 0 or count == room:
                lost += w
                continue
            rank, root = _roots(sigma)
            may_cut = w > UNCUT and top + 3 < depth
            if may_cut and rank > 0:
                axes = np.ascontiguousarray(root[:, :rank])
                other, q = _cut_plane(
                    c, centre, axes, code, mask, math.sqrt(2.0 * math.log(w / NEGLIGIBLE) - 2.0), before_other
                )
                if other != code:
                    for inner in (True, False):
                        share, means[top], covariances[top] = _half(centre, axes, q, inner)
                        weights[top] = w * share
                        ignored[top] = mask | (1 << ((other if inner else code) + 2))
                        top += 1
                    continue
            mesh, side = abs(code), 1 if code > 0 else -1
            first, second = derivatives(c, mesh, side, centre[0], centre[1:], t, before, 5)
            linear = np.ascontiguousarray(first[:, :5])
            spread = linear @ sigma @ linear.T
            worst, axis = 0.0, 0
            for i in range(rank):
                v = np.ascontiguousarray(root[:, i])
                bend = 0.0
                for j in range(5):
                    if spread[j, j] > 1e-24:
                        curve = 0.5 * (v @ np.ascontiguousarray(second[j, :5, :5]) @ v)
                        bend = max(bend, float(abs(curve) / math.sqrt(spread[j, j])))
                if bend > worst:
                    worst, axis = bend, i
                if bend > BEND and not may_cut:  # too light to be cut: what its map cannot carry is left out
                    root[:, i] *= BEND / bend
            if worst > BEND and may_cut:
                v = root[:, axis]
                thin = sigma - (1.0 - THIRD_WIDTH**2) * np.outer(v, v)
                for k in (-1, 0, 1):
                    weights[top] = w * (THIRD_WEIGHT if k != 0 else 1.0 - 2.0 * THIRD_WEIGHT)
                    means[top], covariances[top], ignored[top] = centre + k * THIRD_CENTRE * v, thin, mask
                    top += 1
                continue
            if worst > BEND:
                sigma = root @ root.T
                spread = linear @ sigma @ linear.T
            section.weight[count] = after.weight[count] = w
            section.mean[count, 0], section.mean[count, 1:] = centre[0] + t, before
            flight[count, 0] = t
            for j in range(5):
                shift = 0.5 * (second[j, :5, :5] * sigma).sum()
                if shift * shift < spread[j, j]:
                    section.mean[count, j] += shift
                    if j == 0:
                        flight[count, 0] += shift
            section.covariance[count] = spread
            own = first[0, :5].copy()
            own[0] -= 1.0
            flight[count, 1] = own @ sigma @ own
            section.itinerary[count] = after.itinerary[count] = now.itinerary[part] * 5 + (
                code + 2 if code < 0 else code + 1
            )
            hit = np.eye(5)
            hit[1:, 1:] = contact_matrix(c, mesh)
            after.mean[count] = hit @ section.mean[count]
            after.covariance[count] = hit @ spread @ hit.T
            count += 1
    return count, lost


@jit
def _merge(parts: Mixture, count: int, most: int, kept_apart: int) -> tuple[int, float]:
    """Merge the lightest parts into others until `most` are left; returns how many, and the weight lost.

    A part goes to one of its own itinerary, or else to one that has just struck the same flank; the itinerary
    `kept_apart` takes no strangers, so that its probability stays right.
    """
    lost = 0.0
    order = np.argsort(parts.weight[:count])
    alive = np.ones(count, np.bool_)
    left = count
    for at in range(count):
        i = order[at]
        light = parts.weight[i] < LIGHTEST
        if left <= most and not light:
            break
        partner = -1
        for later in range(at + 1, count):
            j = order[later]
            if parts.itinerary[j] == parts.itinerary[i]:
                partner = j
                break
            same_flank = parts.itinerary[j] % 5 == parts.itinerary[i] % 5
            if partner < 0 and same_flank and parts.itinerary[j] != kept_apart:
                partner = j
        alive[i] = False
        left -= 1
        if partner < 0:
            lost += parts.weight[i]
            continue
        w, v = parts.weight[i], parts.weight[partner]
        gap = parts.mean[i] - parts.mean[partner]
        share = w / (w + v)
        parts.covariance[partner] = (
            share * parts.covariance[i] + (1.0 - share) * parts.covariance[partner]
            + share * (1.0 - share) * np.outer(gap, gap)
        )  # fmt: skip
        parts.mean[partner] += share * gap
        parts.weight[partner] = w + v
    kept = 0
    for i in range(count):
        if alive[i]:
            parts.weight[kept], parts.mean[kept] = parts.weight[i], parts.mean[i]
            parts.covariance[kept], parts.itinerary[kept] = parts.covariance[i], parts.itinerary[i]
            kept += 1
    return kept, lost


def _empty(size: int) -> Mixture:
    return Mixture(np.zeros(size), np.zeros((size, 5)), np.zeros((size, 5, 5)), np.zeros(size, np.int64))


def _moments(w: Floats, mean: Floats, variance: Floats) -> tuple[Floats, Floats, Floats]:
    """Mean, sd and skewness of mixtures; arrays over (parts, quantities)."""
    share = (w / w.sum())[:, None]
    centre = (share * mean).sum(axis=0)
    off = mean - centre
    second = (share * (off**2 + variance)).sum(axis=0)
    third = (share * (off**3 + 3.0 * off * variance)).sum(axis=0)
    sd = np.sqrt(np.maximum(second, 0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        return centre, sd, np.where(sd > 0.0, third / sd**3, np.nan)


def check(scene: Scene) -> None:
    """Refuse a random tolerance, which this reading does not carry.

    Raises
    ------
    InputError
    """
    if scene.tolerance is not None and scene.tolerance.law != "fixed":
        raise InputError("tolerance.law", scene.tolerance.law, "the branching reading takes only 'fixed'; leave it out")


def trace(scene: Scene, impacts: int, order: int) -> Trace:
    """Follow the mixture through `impacts` impacts; it carries no moments of a perturbation, whatever `order`."""
    c, orbit = scene.constants, follow(scene, impacts)
    room = 8 * MOST_PARTS
    now, after, section, flight = _empty(room), _empty(room), _empty(room), np.zeros((room, 2))
    now.weight[0] = 1.0
    now.mean[0] = orbit.tau[0], *orbit.after[0]
    live, lost, expected = 1, 0.0, 0
    tau, mean = np.full(impacts + 1, np.nan), np.full((impacts + 1, 4), np.nan)
    sd, skew = np.full((impacts + 1, 6), np.nan), np.full((impacts + 1, 6), np.nan)
    covariance = np.full((impacts + 1, 4, 4), np.nan)
    mesh, side = np.zeros(impacts + 1, np.int64), np.zeros(impacts + 1, np.int64)
    agreement, lost_at = np.full(impacts + 1, np.nan), np.full(impacts + 1, np.nan)
    tau[0], mean[0], mesh[0], side[0] = orbit.tau[0], orbit.before[0], orbit.mesh[0], orbit.side[0]
    agreement[0], lost_at[0] = 1.0, 0.0
    found = impacts
    parts: dict[int, tuple[Floats, Floats, Floats]] = {}
    for k in range(1, impacts + 1):
        count, gone = _step(c, live, now, after, section, flight)
        lost += gone
        if count == 0 or lost > 0.5:
            found = k - 1
            break
        w, s = section.weight[:count], section.mean[:count]
        diagonal = np.diagonal(section.covariance[:count], axis1=1, axis2=2)
        values = np.column_stack([s[:, 0], flight[:count, 0], s[:, 1:]])
        variances = np.column_stack([diagonal[:, 0], flight[:count, 1], diagonal[:, 1:]])
        parts[k] = w / w.sum(), values, variances
        centre, sd[k], skew[k] = _moments(w, values, variances)
        tau[k], mean[k] = centre[0], centre[2:]
        digits = section.itinerary[:count] % 5
        code = max((-2, -1, 1, 2), key=lambda a: w[digits == (a + 2 if a < 0 else a + 1)].sum())
        mesh[k], side[k] = abs(code), np.sign(code)
        own = int(orbit.mesh[k] * orbit.side[k])
        expected = expected * 5 + (own + 2 if own < 0 else own + 1)
        agreement[k] = w[section.itinerary[:count] == expected].sum()
        live, gone = _merge(after, count, MOST_PARTS, expected)
        lost += gone
        lost_at[k] = lost
        now, after = after, now

    def at(time: float) -> tuple[Floats, Floats]:
        return np.full(4, np.nan), np.full((4, 4), np.nan)  # the parts are at different impacts at one time

    stopped = "" if found == impacts else f"more than half of the weight is lost after impact {found}"
    raw = np.full((impacts + 1, 2, order + 1, order + 1), np.nan)
    return Trace(
        tau,
        mesh,
        side,
        mean,
        sd,
        skew,
        covariance,
        raw,
        at,
        found,
        stopped,
        parts=parts,
        agreement=agreement,
        lost=lost_at,
    )
