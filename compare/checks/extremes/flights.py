"""Flights, their derivatives and their noise compared with 400-digit arithmetic, for extreme damping, drag and time."""

import math
from collections.abc import Iterator

import numpy as np

from rattle.closure import third_cumulants
from rattle.compare.checks.extremes import truth
from rattle.compare.checks.extremes.extreme import extreme, farthest, spread
from rattle.scene import damping, flight
from rattle.scene.constants import Constants

BETAS = spread(1e-14, 1e3, 7, 0.0)
TIMES = spread(1e-12, 1e6, 10)
POINTS = 120  # random grid points of each row


def constants(**fields: float) -> Constants:
    """Build the constants of a two-stage scene with moderate values."""
    plain = {"alpha": 1.5, "epsilon": 0.9, "beta1": 0.08, "beta2": 0.13, "gamma1": 0.06, "gamma2": 0.03, "mu": 0.6}
    return Constants(**({**plain, "wall1": 0.5, "wall2": 0.5, "sigma": 1.0, "stages": 2} | fields))  # type: ignore[arg-type]


def _pairs(rng: np.random.Generator) -> tuple[float, float]:
    """Two damping coefficients: far apart, equal, or equal but for the last digits."""
    beta = float(rng.choice(BETAS))
    other = (float(rng.choice(BETAS)), beta, beta * (1.0 + 2.0 ** -float(rng.integers(1, 53))))[rng.integers(3)]
    return (beta, other) if rng.random() < 0.5 else (other, beta)


def _draw(seed: int) -> list[tuple[Constants, float, float]]:
    """Random scenes, each with a phase and a flight time."""
    rng = np.random.default_rng(seed)
    out = []
    for _ in range(POINTS):
        beta1, beta2 = _pairs(rng)
        alpha = float(rng.choice(spread(1e-8, 1e4, 4, 0.0)))
        gamma1, gamma2 = (float(v) for v in rng.choice(spread(1e-8, 1e6, 4, 0.0), 2))
        c = constants(alpha=alpha, beta1=beta1, beta2=beta2, gamma1=gamma1, gamma2=gamma2)
        out.append(
            (c, float(rng.choice([0.0, math.pi, 0.5 * math.pi, rng.uniform(-3.0, 3.0)])), float(rng.choice(TIMES)))
        )
    return out


@extreme(
    "flight",
    "alpha, beta, gamma",
    "t 1e-12 to 1e6, beta 0 to 1e3, alpha 0 to 1e4, gamma 0 to 1e6",
    "MODEL 2 in 400 digits",
    unit="the sum of its terms",
)
def flight_state() -> Iterator[float]:
    """Displacements and velocities after a flight."""
    rng = np.random.default_rng(1)
    for c, tau, t in _draw(0):
        y1, y2 = (float(rng.choice([-1.0, 1.0]) * v) for v in rng.choice(spread(1e-12, 1e4, 5, 0.0), 2))
        values, sizes = truth.flight(c, tau, y1, y2, t)
        yield farthest(flight.displacement(c, tau, y1, y2, t), values, sizes)


@extreme("phi-functions of damping", "beta", "beta 0, 1e-14 to 1e3; t 1e-12 to 1e6", "MODEL 2 in 400 digits")
def phi_functions() -> Iterator[float]:
    """``t phi1(-beta t)`` and ``t^2 phi2(-beta t)``."""
    for beta in BETAS:
        for t in TIMES:
            values, _ = truth.flight(constants(alpha=0.0, beta1=beta, gamma1=1.0), 0.0, 0.0, 0.0, t)
            (_, e, _, _), *_ = truth.jacobian(constants(beta1=beta), t)
            yield farthest(damping.phi1(beta, t), e, e)
            yield farthest(damping.phi2(beta, t), values[0], values[0])


@extreme(
    "Jacobian of a flight",
    "beta1 = beta2",
    "beta 0 to 1e3, apart by 0, by 1e-16 of it and more",
    "MODEL 2 in 400 digits",
    unit="each entry, (1 + beta t)",
)
def flight_jacobian() -> Iterator[float]:
    """Every entry of the Jacobian of a flight, with its own relative error."""
    for c, _, t in _draw(2):
        exact = np.array(truth.jacobian(c, t))
        size = np.abs(exact) * (1.0 + max(c.beta1, c.beta2) * t)
        yield farthest(flight.jacobian(c, t), exact, np.maximum(size, 1e-300))


@extreme(
    "noise of a flight",
    "sigma, beta",
    "t 1e-12 to 1e6, beta 0 to 1e3, nearly equal too; sigma 1e-8 and 1e4",
    "sums of exponentials in 400 digits",
    allowed=1e-13,
    unit="sd times sd",
)
def flight_noise() -> Iterator[float]:
    """Covariance of the noise accumulated in a flight."""
    for c, tau, t in _draw(3):
        unit = np.array(truth.noise(c, tau, t))
        for sigma in (1e-8, 1e4):
            exact = sigma * sigma * unit
            sd = np.sqrt(exact.diagonal())
            found = flight.noise_covariance(c._replace(sigma=sigma), tau, t)
            yield farthest(found, exact, np.maximum(np.outer(sd, sd), 1e-300))


@extreme(
    "derivative of that noise by the phase",
    "sigma, beta",
    "as above",
    "the same reference at two phases",
    allowed=1e-11,
    unit="largest sd times sd",
)
def noise_phase_derivative() -> Iterator[float]:
    """Derivative of that covariance by the phase of the start."""
    for c, tau, t in _draw(4)[: POINTS // 3]:
        h = 1e-3
        ahead, behind = (np.array(truth.noise(c, tau + k * h, t)) for k in (1.0, -1.0))
        exact = (ahead - behind) / math.sin(2.0 * h)  # exact derivative of A + B cos 2 tau + C sin 2 tau
        most = np.sqrt(np.maximum(ahead.diagonal(), np.array(truth.noise(c, tau + 0.5 * math.pi, t)).diagonal()))
        found = third_cumulants.noise_slope(c, tau, t)
        yield farthest(found, exact, np.maximum(np.outer(most, most), 1e-300))


ROWS = (phi_functions, flight_state, flight_jacobian, flight_noise, noise_phase_derivative)
