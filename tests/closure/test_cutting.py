"""Splitting a Gaussian: total moments are kept, and the plane is where the next impact changes."""

import numpy as np
import pytest
from scipy import stats

from rattle.closure.branching.advance import _cut, buffers
from rattle.closure.branching.propagate import half


def whole():
    root = np.linalg.cholesky(np.cov(np.random.default_rng(5).standard_normal((5, 12))))
    return np.array([0.3, 1.0, -2.0, 0.5, 0.1]), root


def pieces(depth):
    """What `_cut` makes of a Gaussian across an oblique direction; `depth` 0 is the split in three."""
    centre, root = whole()
    n = np.array([0.6, 0.0, 0.8, 0.0, 0.0])
    b = buffers(4)
    b.start.weight[0], b.start.mean[0], b.start.covariance[0] = 0.7, centre, root @ root.T
    b.axis[0], b.depth[0], b.image.section.label[0], b.beyond[0] = root @ n, depth, 1, -2
    count = _cut(b, 0, 1)
    return count, b, n


@pytest.mark.parametrize("depth", [0.0, 0.3, 2.5])
def test_pieces_keep_weight_mean_and_covariance(depth):
    centre, root = whole()
    count, b, _ = pieces(depth)
    assert count == (3 if depth == 0.0 else 2)
    w, mean = b.start.weight[:count] / 0.7, b.start.mean[:count]
    off = mean - centre
    second = np.einsum("i,ijk->jk", w, b.start.covariance[:count]) + np.einsum("i,ij,ik->jk", w, off, off)
    assert w.sum() == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(w @ mean, centre, atol=1e-12)
    np.testing.assert_allclose(second, root @ root.T, atol=1e-12)


@pytest.mark.parametrize("depth", [0.3, 2.5])
def test_halves_have_the_moments_of_a_cut_gaussian(depth):
    centre, root = whole()
    _, b, n = pieces(depth)
    for i, truth in enumerate((stats.truncnorm(-np.inf, depth), stats.truncnorm(depth, np.inf))):
        share, mean, variance = half(depth, i == 0)
        assert share == pytest.approx(stats.norm.cdf(depth) if i == 0 else stats.norm.sf(depth))
        assert mean == pytest.approx(truth.mean(), rel=1e-9)
        assert variance == pytest.approx(truth.var(), rel=1e-9)
        assert b.start.weight[i] == pytest.approx(0.7 * share)
        assert np.linalg.solve(root, b.start.mean[i] - centre) @ n == pytest.approx(mean, rel=1e-9)
        whitened = np.linalg.inv(root) @ b.start.covariance[i] @ np.linalg.inv(root).T
        assert n @ whitened @ n == pytest.approx(variance, rel=1e-9)
