from decimal import Decimal, getcontext
from itertools import product

import numpy as np
import pytest
from oracle import two_stages
from scipy.integrate import quad_vec
from scipy.linalg import expm

from rattle.scene import Scene
from rattle.scene.damping import decay, phi1, phi2
from rattle.scene.flight import flow, jacobian, noise_covariance, noise_rate

BETAS = (0.0, 1e-12, 1e-6, 0.08, 1.0, 50.0)
PAIRS = list(product(BETAS, BETAS))
STATE = (0.31, -1.2, -0.17, 0.9)


def constants(beta1, beta2, **changes):
    values = {
        "alpha": 1.5,
        "epsilon": 0.9,
        "gamma1": 0.06,
        "gamma2": 0.03,
        "mu": 0.6,
        "sigma": 0.7,
    } | changes
    return Scene(beta1=beta1, beta2=beta2, **values).constants


@pytest.mark.parametrize(("beta1", "beta2"), PAIRS)
def test_flow_solves_the_equations_of_motion(beta1, beta2):
    c = constants(beta1, beta2)
    # the solver's own error at rtol 1e-12 over this flight stays below 1e-11
    exact = two_stages(c).fly(0.7, STATE, 2.5)
    assert flow(c, 0.7, *STATE, 2.5) == pytest.approx(exact, rel=0, abs=3e-11)


def test_the_misprinted_damping_of_stage_2_is_distinguished():
    c = constants(0.08, 0.13)
    misprinted = two_stages(c)
    misprinted.damping[1, 1] = c.beta1  # -beta_1 y_2, as Eqs. 3 and 5 have it
    wrong = misprinted.fly(0.7, STATE, 2.5)
    assert abs(np.array(flow(c, 0.7, *STATE, 2.5)) - wrong).max() > 1e-3


def test_stage_1_flies_alike_with_and_without_stage_2():
    one = constants(0.08, 0.13, stages=1)
    two = constants(0.08, 0.13)
    assert flow(one, 0.7, *STATE, 2.5)[:2] == flow(two, 0.7, *STATE, 2.5)[:2]


@pytest.mark.parametrize("beta", [1e-300, 1e-12, 1e-6, 0.08, 0.249, 0.251, 1.0, 50.0])
@pytest.mark.parametrize("t", [1e-9, 0.5, 2.0, 30.0])
def test_phi_functions_are_accurate_to_rounding(beta, t):
    getcontext().prec = 700  # enough digits for the cancellation at beta = 1e-300
    b = Decimal(beta)
    d = Decimal(t)
    travel = (1 - (-b * d).exp()) / b
    assert phi1(beta, t) == pytest.approx(float(travel), rel=1e-15)
    assert phi2(beta, t) == pytest.approx(
        float((d - travel) / b), rel=3e-15
    )  # the sum of its terms at z = 0.5
    assert decay(beta, t) == pytest.approx(float((-b * d).exp()), rel=1e-15 * (1 + beta * t))


@pytest.mark.parametrize(("beta1", "beta2"), PAIRS)
def test_jacobian_is_the_exponential_of_the_drift(beta1, beta2):
    c = constants(beta1, beta2)
    exact = expm(1.7 * two_stages(c).drift_matrix())
    assert jacobian(c, 1.7) == pytest.approx(exact, rel=0, abs=1e-13)


def test_noise_rate_is_eq_5():
    c = constants(0.08, 0.13)
    assert noise_rate(c, 0.7) == pytest.approx(two_stages(c).modulation(0.7), rel=1e-15)


def integral(c, tau, t):
    """sigma^2 int exp(A (t - s)) m m' exp(A' (t - s)) ds, by adaptive quadrature."""
    box = two_stages(c)
    a = box.drift_matrix()

    def integrand(lag):
        g = expm(a * lag) @ box.noise_direction(tau + t - lag)
        return c.sigma**2 * np.outer(g, g)

    fast = 1.0 / max(c.beta1, c.beta2, 1.0)
    return quad_vec(
        integrand, 0.0, t, epsabs=1e-14, epsrel=1e-12, points=[fast, 5 * fast, 20 * fast]
    )[0]


NOISY = [
    (0.0, 0.0),
    (0.0, 0.08),
    (1e-12, 1e-6),
    (0.08, 0.08),
    (0.08, 1.0),
    (1.0, 50.0),
    (50.0, 50.0),
    (50.0, 0.08),
]


@pytest.mark.parametrize(("beta1", "beta2"), NOISY)
def test_noise_covariance_is_its_integral(beta1, beta2):
    c = constants(beta1, beta2)
    exact = integral(c, 0.7, 4.5)
    assert noise_covariance(c, 0.7, 4.5) == pytest.approx(exact, rel=0, abs=1e-12 * exact.max())


def test_noise_covariance_without_modulation_is_distinguished():
    c = constants(0.08, 0.13)
    a = two_stages(c).drift_matrix()
    flat, _ = quad_vec(
        lambda r: c.sigma**2 * np.outer(*[expm(a * r) @ [0.0, 1.0, 0.0, 1.0]] * 2), 0.0, 2.0
    )
    assert abs(noise_covariance(c, 0.7, 2.0) - flat).max() > 0.1 * flat.max()


def test_a_single_stage_collects_no_noise_in_stage_2():
    one, two = (noise_covariance(constants(0.08, 0.13, stages=s), 0.7, 3.0) for s in (1, 2))
    assert not one[2:].any()
    assert one[:2, :2] == pytest.approx(two[:2, :2], rel=1e-15)
