import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rattle.scene.moments import central_from_raw, correlation, gaussian_raw_moments, realizability


def quadrature(vx, cxy, vy, order):
    """E[x^n y^p] by Gauss-Hermite, exact for these degrees."""
    z, w = np.polynomial.hermite_e.hermegauss(order + 2)
    w = w / w.sum()
    u, v = np.meshgrid(z, z, indexing="ij")
    weight = np.outer(w, w)
    x = np.sqrt(vx) * u
    slope = cxy / np.sqrt(vx) if vx > 0.0 else 0.0
    y = slope * u + np.sqrt(max(vy - slope**2, 0.0)) * v
    return np.array(
        [[(weight * x**n * y**p).sum() for p in range(order + 1)] for n in range(order + 1)]
    )


@pytest.mark.parametrize(
    "covariance", [(1.0, 0.5, 2.0), (4.0, -1.9, 1.0), (0.3, 0.0, 0.7), (1.0, 1.0, 1.0)]
)
@pytest.mark.parametrize("order", [2, 3, 4, 6])
def test_gaussian_moments_are_their_integrals(covariance, order):
    raw = gaussian_raw_moments(*covariance, order)
    exact = quadrature(*covariance, order)
    for n in range(order + 1):
        for p in range(order + 1 - n):
            assert raw[n, p] == pytest.approx(exact[n, p], rel=1e-12, abs=1e-12)
            assert (n + p) % 2 == 0 or raw[n, p] == 0.0


@given(st.lists(st.floats(-3, 3), min_size=1, max_size=6), st.floats(-2, 2))
@settings(deadline=None, max_examples=50, derandomize=True)
def test_central_moments_are_those_about_the_mean(values, shift):
    x = np.array(values) + shift
    raw = np.array([np.mean(x**p) for p in range(5)])
    exact = [np.mean((x - x.mean()) ** p) for p in range(5)]
    assert central_from_raw(raw) == pytest.approx(
        exact, rel=0, abs=1e-15 * 5.0**4 * 20
    )  # |x| <= 5, 20 roundings


@pytest.mark.parametrize(
    ("covariance", "reason"),
    [
        ([[-1.0, 0.0], [0.0, 1.0]], "variance of x = -1 < 0"),
        ([[1.0, 0.0], [0.0, -0.25]], "variance of y = -0.25 < 0"),
        ([[-1.0, 0.0], [0.0, -2.0]], "variance of x = -1 < 0, variance of y = -2 < 0"),
        ([[1.0, 1.2], [1.2, 1.0]], "|rho| = 1.2 > 1"),
        ([[1.0, -1.2], [-1.2, 1.0]], "|rho| = 1.2 > 1"),
        ([[1e-20, 2e-20], [2e-20, 1e-20]], "|rho| = 2 > 1"),
        ([[0.0, 0.1], [0.1, 1.0]], "smallest eigenvalue"),
        ([[float("nan"), 0.0], [0.0, 1.0]], "not finite"),
        ([[1.0, float("inf")], [float("inf"), 1.0]], "not finite"),
    ],
)
def test_unrealizable_moments_are_named(covariance, reason):
    judged = realizability(np.array(covariance))
    assert not judged.realizable
    assert reason in judged.reason


@pytest.mark.parametrize(
    ("vx", "cxy", "vy"),
    [(0, 0, 0), (1, 1, 1), (1, 0, 0), (4, 1, 1), (1e-30, 0, 1), (1, 1 + 1e-12, 1)],
)
def test_moments_of_a_distribution_are_realizable(vx, cxy, vy):
    judged = realizability(np.array([[vx, cxy], [cxy, vy]], dtype=float))
    assert judged.realizable
    assert judged.reason == ""


def test_correlation_does_not_underflow():
    assert correlation(np.array([[1e-200, 5e-201], [5e-201, 1e-200]])) == pytest.approx(0.5)
