"""Splitting a Gaussian: total moments are kept, and the plane is where the next impact changes."""

import math

import numpy as np
import pytest
from scipy import stats

from rattle.closure.branching.advance import _cut, buffers
from rattle.closure.branching.propagate import cut_plane, event, half
from rattle.scene import DAT21, Scene


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


def test_halves_do_not_search_for_each_other_again():
    _, b, _ = pieces(2.5)
    assert b.ignored[0] == 1 << (-2 + 2)
    assert b.ignored[1] == 1 << (1 + 2)


def test_three_pieces_are_close_to_the_whole():
    """The distribution across the split, compared with the normal one."""
    _, b, n = pieces(0.0)
    centre, root = whole()
    z = np.linspace(-4.0, 4.0, 801)
    total = np.zeros_like(z)
    for i in range(3):
        at = np.linalg.solve(root, b.start.mean[i] - centre) @ n
        inverse = np.linalg.inv(root)
        width = math.sqrt(n @ inverse @ b.start.covariance[i] @ inverse.T @ n)
        total += b.start.weight[i] / 0.7 * stats.norm.cdf(z, at, width)
    assert np.abs(total - stats.norm.cdf(z)).max() < 0.006


def test_cut_plane_finds_an_oblique_boundary():
    """Two walls met at about one time: the plane between the events, against the events of many points."""
    c = Scene.from_gears(DAT21, sigma=0.0).constants
    centre = np.array([0.0, 0.0, 1.0, 0.02, 1.0])
    axes = np.ascontiguousarray(0.02 * np.eye(5)[:, 1:])
    before = np.empty(4)
    code = event(c, centre, before)[1]
    other, q = cut_plane(c, centre, axes, code, 0, 4.0, before)
    assert {abs(code), abs(other)} == {1, 2}
    rng = np.random.default_rng(1)
    z = rng.standard_normal((3000, 4))
    beyond = np.array([event(c, centre + axes @ point, before)[1] == other for point in z])
    predicted = z @ q > 1.0
    assert (beyond == predicted).mean() > 0.98
    assert beyond.mean() == pytest.approx(0.5 * math.erfc(1.0 / np.linalg.norm(q) / math.sqrt(2.0)), abs=0.03)
