"""Merging the components of a mixture: moments are kept, labels kept apart, close components merged."""

import numpy as np
import pytest

from rattle.closure.branching.mixture import empty, reduce


def cloud(count, seed=2):
    rng = np.random.default_rng(seed)
    parts = empty(count)
    parts.weight[:] = rng.exponential(size=count)
    parts.weight[:] /= parts.weight.sum()
    parts.mean[:] = rng.standard_normal((count, 5))
    root = 0.1 * rng.standard_normal((count, 5, 5))
    parts.covariance[:] = root @ root.transpose(0, 2, 1)
    parts.label[:] = rng.integers(1, 3, count)
    return parts


def total(parts, count):
    w, mean = parts.weight[:count], parts.mean[:count]
    centre = w @ mean
    off = mean - centre
    return w.sum(), centre, np.einsum("i,ijk->jk", w, parts.covariance[:count]) + np.einsum("i,ij,ik->jk", w, off, off)


@pytest.mark.parametrize("most", [2, 7, 50])
def test_merging_keeps_weight_mean_and_covariance_of_every_label(most):
    parts, out = cloud(200), empty(most)
    assert reduce(parts, 200, most, out) == most
    for a, b in zip(total(parts, 200), total(out, most), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)
    for label in (1, 2):
        assert out.weight[out.label == label].sum() == pytest.approx(parts.weight[parts.label == label].sum())


def test_components_of_one_place_are_merged():
    """Three clusters of one label become three components, each with the moments of its cluster."""
    parts, out = cloud(300), empty(3)
    parts.label[:] = 1
    cluster = np.arange(300) % 3
    parts.mean[:] = 0.01 * parts.mean + 10.0 * np.eye(5)[cluster]
    assert reduce(parts, 300, 3, out) == 3
    expected = sorted(parts.weight[cluster == h].sum() for h in range(3))
    np.testing.assert_allclose(np.sort(out.weight), expected)
    assert out.covariance.max() < 0.5
