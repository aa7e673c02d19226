"""A Gaussian mixture over the section state, its moments, and its reduction to fewer components."""

from typing import NamedTuple

import numpy as np

from rattle.scene import Floats, Ints
from rattle.scene.compiled import internal, jit, little_code, splice
from rattle.scene.linear_algebra import eigen, largest


class Mixture(NamedTuple):
    """Components of a Gaussian mixture; components of different labels are never merged."""

    weight: Floats  # probabilities; (components,)
    mean: Floats  # of each component; (components, d)
    covariance: Floats  # of each component; (components, d, d)
    label: Ints  # what a component has gone through; (components,)
    # squared ratio of second-order to first-order sd, summed over the flights so far; (components,)
    bent: Floats
    doubt: Floats  # relative error of the weight; (components,)


def empty(size: int, d: int) -> Mixture:
    """A mixture of zeros, to be filled.

    `d`: Size of the section state ``(tau, x1, y1, ...)``: 1 + 2 wheels, or 1 + 4 wheels with the
    flanks.
    """
    weight, bent, doubt = np.zeros((3, size))
    return Mixture(
        weight, np.zeros((size, d)), np.zeros((size, d, d)), np.zeros(size, np.int64), bent, doubt
    )


@internal
def _spread(parts: Mixture, members: Ints, axis: Floats, centre: Floats) -> float:
    """Largest principal scatter (weight times variance) of the members' means.

    Their principal axis and mean are written to `axis` and `centre`.
    """
    d = centre.size
    weight = parts.weight
    mean = parts.mean
    total = 0.0
    for a in range(d):
        centre[a] = 0.0
    for i in members:
        total += weight[i]
        for a in range(d):
            centre[a] += weight[i] * mean[i, a]
    for a in range(d):
        centre[a] /= total
    between = np.zeros((d, d))
    for i in members:
        for a in range(d):
            for b in range(d):
                between[a, b] += weight[i] * (mean[i, a] - centre[a]) * (mean[i, b] - centre[b])
    values, vectors = eigen(between)
    for a in range(d):
        axis[a] = vectors[a, d - 1]
    return float(values[d - 1])


@splice
def _by_label(label: Ints, count: int) -> Ints:
    """Indices of the first components, by label; in their order within each."""
    lowest = highest = label[0] if count > 0 else 0
    for i in range(count):
        lowest = min(lowest, label[i])
        highest = max(highest, label[i])
    order = np.empty(count, np.int64)
    placed = 0
    for value in range(lowest, highest + 1):
        for i in range(count):
            if label[i] == value:
                order[placed] = i
                placed += 1
    return order


@splice
def _divide(means: Floats, members: Ints, axis: Floats, centre: Floats) -> int:
    """Put the members of a group that lie below its centre, along its axis, before the others;
    returns their number."""
    low = 0
    high = members.size - 1
    while low <= high:
        i = members[low]
        along = 0.0
        for a in range(centre.size):
            along += (means[i, a] - centre[a]) * axis[a]
        if along < 0.0:
            low += 1
        else:
            members[low] = members[high]
            members[high] = i
            high -= 1
    return low


@splice
def _merge(parts: Mixture, members: Ints, out: Mixture, g: int) -> None:
    """Replace components by one of their total weight, mean and covariance, component `g` of
    `out`."""
    mean = out.mean[g]
    spread = out.covariance[g]
    d = mean.size
    gap = np.empty(d)
    mean[:] = 0.0
    spread[:] = 0.0
    total = bent = doubt = 0.0
    out.label[g] = parts.label[members[0]]
    for i in members:
        w = parts.weight[i]
        total += w
        share = w / total
        for a in range(d):
            gap[a] = parts.mean[i, a] - mean[a]
        for a in range(d):
            for b in range(d):
                spread[a, b] += share * (
                    parts.covariance[i, a, b] - spread[a, b] + (1.0 - share) * gap[a] * gap[b]
                )
        for a in range(d):
            mean[a] += share * gap[a]
        bent += share * (parts.bent[i] - bent)
        doubt += share * (parts.doubt[i] - doubt)
    out.weight[g] = total
    out.bent[g] = bent
    out.doubt[g] = doubt


@jit
def reduce(parts: Mixture, count: int, most: int, out: Mixture) -> int:
    """Merge components of one label that lie close together; total weight, mean and covariance of
    each label are kept.

    Top down: the group with the largest scatter of its means is divided across its principal axis
    until there are as many groups as components allowed.  Each group then becomes one component.

    `most`: Largest number of components that may be left; at least the number of labels.
    """
    little_code()
    means = parts.mean
    label = parts.label
    d = means.shape[1]
    order = _by_label(label, count)
    first = np.zeros(most, np.int64)
    last = np.zeros(most, np.int64)
    gain = np.zeros(most)
    axes = np.zeros((most, d))
    centres = np.zeros((most, d))
    groups = 0
    for at in range(count):
        if at == 0 or label[order[at]] != label[order[at - 1]]:
            first[groups] = at
            groups += 1
        last[groups - 1] = at + 1
    for g in range(groups):
        gain[g] = _spread(parts, order[first[g] : last[g]], axes[g], centres[g])
    while groups < most:
        g = largest(gain, groups)
        if gain[g] <= 0.0:
            break
        below = _divide(means, order[first[g] : last[g]], axes[g], centres[g])
        low = first[g] + below
        if below == 0 or low == last[g]:
            gain[g] = 0.0
            continue
        first[groups] = low
        last[groups] = last[g]
        last[g] = low
        for h in (g, groups):
            gain[h] = 0.0
            if last[h] - first[h] > 1:
                gain[h] = _spread(parts, order[first[h] : last[h]], axes[h], centres[h])
        groups += 1
    for g in range(groups):
        _merge(parts, order[first[g] : last[g]], out, g)
    return groups


def moments(w: Floats, mean: Floats, variance: Floats) -> tuple[Floats, Floats, Floats]:
    """Mean, sd and skewness of the marginals of a mixture.

    Shapes: `w` (components,); `mean`, `variance` (components, quantities); result (quantities,).
    """
    share = (w / w.sum())[:, None]
    centre = mean[0] + (share * (mean - mean[0])).sum(axis=0)  # exact where nothing varies
    off = mean - centre
    second = (share * (off**2 + variance)).sum(axis=0)
    third = (share * (off * off * off + 3.0 * off * variance)).sum(axis=0)
    sd = np.sqrt(np.maximum(second, 0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        return centre, sd, np.where(sd > 0.0, third / (sd * sd * sd), np.nan)
