import math

import numpy as np
import pytest
from reference_moments import stage_moments_after_flight

from rattle.closure.published import after_flight, unmodulated_covariance
from rattle.scene import DAT21, Scene
from rattle.scene.flight import noise_covariance
from rattle.scene.moments import gaussian_raw_moments

TAU, T, SIGMA = 0.7, 1.9, 0.8
ORDERS = (2, 3, 4, 5, 6)


def lower(raw):
    """The entries that count: n + p <= order."""
    return np.fliplr(np.triu(np.fliplr(raw)))


def start_of(kind, order):
    rng = np.random.default_rng(order)
    match kind:
        case "point":
            return gaussian_raw_moments(0.0, 0.0, 0.0, order)
        case "Gaussian":
            return gaussian_raw_moments(0.3, -0.1, 0.5, order)
        case "sample":  # of five points: realizable, skew, with means
            x, y = rng.normal(size=(2, 5))
            return np.array([[np.mean(x**n * y**p) for p in range(order + 1)] for n in range(order + 1)])
        case "unrealizable":  # negative variances and all
            raw = rng.normal(size=(order + 1, order + 1))
            raw[0, 0], raw[2, 0], raw[0, 2] = 1.0, -0.4, -0.7
            return raw
    raise ValueError(kind)


KINDS = ("point", "Gaussian", "sample", "unrealizable")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("order", ORDERS)
def test_modulated_moments_of_stage_1_solve_eq_16(kind, order):
    c = Scene.from_gears(DAT21, sigma=SIGMA).constants
    start = start_of(kind, order)
    # Eq. 16 with its own names: (sigma_0 sin(tau + alpha_0))^2
    shift = math.atan2(c.beta1, -1.0)
    exact = stage_moments_after_flight(
        start, c.beta1, TAU, T, lambda s: SIGMA**2 * (1 + c.beta1**2) * math.sin(s + shift) ** 2
    )
    found = after_flight(start, c.beta1, T, noise_covariance(c, TAU, T)[:2, :2])
    assert lower(found) == pytest.approx(lower(exact), rel=1e-9, abs=1e-10)  # of the integrator, moments up to 1e3


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("beta", [0.0, 0.13, 3.0])
def test_unmodulated_moments_of_stage_2_solve_eq_14(kind, order, beta):
    start = start_of(kind, order)
    exact = stage_moments_after_flight(start, beta, TAU, T, lambda s: SIGMA**2)
    found = after_flight(start, beta, T, unmodulated_covariance(beta, SIGMA, T))
    assert lower(found) == pytest.approx(lower(exact), rel=1e-9, abs=1e-10)


def test_modulated_and_unmodulated_noise_are_distinguished():
    c = Scene.from_gears(DAT21, sigma=SIGMA).constants
    start = start_of("Gaussian", 4)
    wrong = after_flight(start, c.beta1, T, unmodulated_covariance(c.beta1, SIGMA, T))
    right = after_flight(start, c.beta1, T, noise_covariance(c, TAU, T)[:2, :2])
    assert abs(wrong - right).max() > 0.1


@pytest.mark.parametrize("beta", [0.0, 1e-9, 0.2, 2.0, 40.0])
@pytest.mark.parametrize("t", [1e-3, 1.0, 9.0])
def test_unmodulated_covariance_is_the_ornstein_uhlenbeck_one(beta, t):
    found = unmodulated_covariance(beta, SIGMA, t)
    exact = stage_moments_after_flight(gaussian_raw_moments(0, 0, 0, 2), beta, 0.0, t, lambda s: SIGMA**2)
    assert found == pytest.approx(
        np.array([[exact[2, 0], exact[1, 1]], [exact[1, 1], exact[0, 2]]]), rel=1e-9, abs=1e-13
    )
    if beta >= 0.2:
        assert found[1, 1] == pytest.approx(SIGMA**2 * -math.expm1(-2 * beta * t) / (2 * beta), rel=1e-12)


@pytest.mark.parametrize("order", ORDERS)
def test_a_gaussian_flies_into_the_gaussian_of_its_covariance(order):
    """Against quadrature: E over (xi, zeta) and the noise by Gauss-Hermite, exact at these degrees."""
    vx, cxy, vy, beta = 0.3, -0.1, 0.5, 0.13
    q = unmodulated_covariance(beta, SIGMA, T)
    z, w = np.polynomial.hermite_e.hermegauss(order // 2 + 1)
    grid = np.array(np.meshgrid(z, z, z, z, indexing="ij")).reshape(4, -1)
    weight = np.prod(np.meshgrid(*[w / w.sum()] * 4, indexing="ij"), axis=0).ravel()
    xi, zeta = np.linalg.cholesky([[vx, cxy], [cxy, vy]]) @ grid[:2]
    w1, w2 = np.linalg.cholesky(q) @ grid[2:]
    xi, zeta = xi + zeta * -math.expm1(-beta * T) / beta + w1, zeta * math.exp(-beta * T) + w2
    exact = np.array([[(weight * xi**n * zeta**p).sum() for p in range(order + 1)] for n in range(order + 1)])
    found = after_flight(gaussian_raw_moments(vx, cxy, vy, order), beta, T, q)
    assert lower(found) == pytest.approx(lower(exact), rel=1e-11, abs=1e-11)


@pytest.mark.parametrize("kind", KINDS)
def test_flights_of_moments_compose(kind):
    beta, start = 0.4, start_of(kind, 6)
    q = [unmodulated_covariance(beta, SIGMA, t) for t in (0.8, 1.1, 1.9)]
    twice = after_flight(after_flight(start, beta, 0.8, q[0]), beta, 1.1, q[1])
    assert lower(twice) == pytest.approx(lower(after_flight(start, beta, 1.9, q[2])), rel=1e-12, abs=1e-12)


def test_no_flight_no_change():
    start = start_of("sample", 6)
    assert lower(after_flight(start, 0.4, 0.0, np.zeros((2, 2)))) == pytest.approx(lower(start), rel=1e-15)
