"""Formulas at extreme values compared with 400 digits: flights, their derivatives and noise, window
means, steps; each comparison sees an error of ten times its tolerance, and formulas whose
terms cancel.

Each function yields what is found, the truth, and the unit in which errors are counted."""

import math
from itertools import product

import digits
import mpmath as mp
import numpy as np
import pytest
from digits import in_digits

from rattle import Scene, Start, Wheel
from rattle.closure import edgeworth, saltation
from rattle.montecarlo.schemes import short_flight as short
from rattle.scene import damping, drive, flight, moments

ROUNDING = 4e-15  # a few roundings of a double


def spread(low, high, points, *more):
    """Logarithmically spaced values, preceded by others."""
    return [*more, *np.geomspace(low, high, points).tolist()]


BETAS = spread(1e-14, 1e3, 7, 0.0)
FLIGHT_TIMES = spread(1e-12, 1e6, 10)
SERIES_ORDER = 6  # of the Edgeworth series


def constants(betas=(0.08, 0.13), gammas=(0.06, 0.03), parents=(0, 1), ratios=(1.0, 1.0), **fields):
    """Of wheels with the same restitution and mass, unless the fields say otherwise."""
    plain = {"alpha": 1.5, "epsilon": 0.9, "sigma": 1.0} | fields
    wheels = [
        Wheel(beta=beta, gamma=gamma, mass=1.5**i, parent=parent, ratio=ratio)
        for i, (beta, gamma, parent, ratio) in enumerate(
            zip(betas, gammas, parents, ratios, strict=True)
        )
    ]
    start = Start(state=(0.0, 1.0) * len(wheels))
    return Scene(wheels=wheels, start=start, **plain).constants


TREE_SHAPE = {"parents": (0, 1, 1), "ratios": (1.2, 0.7, 1.1)}


def flights(seed, points=120):
    """Random scenes, each with a phase and a flight time; dampings are far apart, equal, or equal
    but for the last digits.  Every third is a tree."""
    rng = np.random.default_rng(seed)
    for number in range(points):
        beta = rng.choice(BETAS)
        other = rng.choice(BETAS)
        near = beta * (1.0 + 0.5 ** rng.integers(1, 53))
        betas = [beta, (other, beta, near)[rng.integers(3)]]
        if rng.random() >= 0.5:
            betas.reverse()
        alpha = rng.choice(spread(1e-8, 1e4, 4, 0.0))
        gammas = [*rng.choice(spread(1e-8, 1e6, 4, 0.0), 2)]
        tau = rng.choice([0.0, math.pi, 0.5 * math.pi, rng.uniform(-3.0, 3.0)])
        tree = {}
        if number % 3 == 2:
            betas.append(other)
            gammas.append(0.5)
            tree = TREE_SHAPE
        yield constants(betas, gammas, alpha=alpha, **tree), tau, rng.choice(FLIGHT_TIMES)


def phi_functions():
    for beta, t in product(BETAS, FLIGHT_TIMES):
        e, g = digits.phi_functions(beta, t)
        yield damping.phi1(beta, t), e, e
        yield damping.phi2(beta, t), g, g


def flight_state():
    rng = np.random.default_rng(1)
    for c, tau, t in flights(0):
        n = len(c.wheels)
        s = np.zeros(2 * n)
        s[1::2] = rng.choice([-1.0, 1.0], n) * rng.choice(spread(1e-12, 1e4, 5, 0.0), n)
        yield flight.flow(c, tau, s, t), *digits.flight(c, tau, s, t)


def flight_jacobian():
    """Every entry, with its own relative error."""
    for c, _, t in flights(2):
        exact = digits.jacobian(c, t)
        size = np.abs(exact) * (1.0 + c.wheels["beta"].max() * t)
        yield flight.jacobian(c, t), exact, size


def flight_noise():
    for c, tau, t in flights(3):
        unit = digits.noise(c, tau, t)
        for sigma in (1e-8, 1e4):
            exact = sigma * sigma * unit
            sd = np.sqrt(exact.diagonal())
            found = flight.noise_covariance(c._replace(sigma=sigma), tau, t)
            yield found, exact, np.outer(sd, sd)


def noise_phase_derivative():
    h = 1e-3
    for c, tau, t in flights(4, 40):
        ahead, behind, quarter = (
            digits.noise(c, tau + change, t) for change in (h, -h, 0.5 * math.pi)
        )
        # exact derivative of A + B cos 2 tau + C sin 2 tau
        exact = (ahead - behind) / math.sin(2.0 * h)
        sd = np.sqrt(np.maximum(ahead.diagonal(), quarter.diagonal()))
        yield saltation.noise_slope(c, tau, t), exact, np.outer(sd, sd)


def series(seed):
    """Random coefficients of an Edgeworth series."""
    i, j = np.indices((SERIES_ORDER + 1, SERIES_ORDER + 1))
    a = np.random.default_rng(seed).normal(size=i.shape) * 0.3 ** (i + 1) * (i + j <= SERIES_ORDER)
    a[0, 0] = 1.0
    return a


@in_digits
def exact_window_means(a, low, high):
    """Means of position and velocity over a window in sds, and the sums of their terms' sizes."""
    hermite = edgeworth.HERMITE[: SERIES_ORDER + 1, : SERIES_ORDER + 1]
    integrals = np.array(digits.window_integrals(low, high, SERIES_ORDER + 1))
    position = a[:, :1] * hermite * integrals[:, None, 1:]
    velocity = a[:, 1:2] * hermite * integrals[:, None, :-1]
    values, _ = np.sum([position, velocity], axis=(2, 3)).T
    _, sizes = np.sum(np.abs([position, velocity]), axis=(2, 3)).T
    return values.astype(float), sizes.astype(float)


def edgeworth_windows():
    """Window means of Eqs. 20 and 21."""
    for n, middle in enumerate([0.0, 1e-9, -2.0, 8.0, 35.0]):
        for width in spread(1e-12, 30.0, 6):
            a = series(n)
            sd = 10.0 ** (n - 3)
            low = (middle - 0.5 * width) * sd
            high = (middle + 0.5 * width) * sd
            exact, size = exact_window_means(a, low / sd, high / sd)
            # of the density, since the edges are rounded
            condition = 1.0 + abs(middle) * (abs(middle) + width)
            condition += abs(middle) / width  # of the width, since both edges are rounded
            sds = np.array([sd, 2.0 * sd])
            found = edgeworth.window_means(a, sd, 2.0 * sd, low, high)
            yield found, sds * exact, sds * size * condition


def correlations():
    """Correlations close to 1, smallest eigenvalues and realizability, in any units."""
    smallest = in_digits(lambda m: float(mp.eigsy(mp.matrix(m.tolist()), eigvals_only=True)[0]))
    for unit in spread(1e-16, 1e8, 7):
        none = np.array([[0.0, 1e-3 * unit], [1e-3 * unit, 1.0]])  # no variance, yet a covariance
        assert not moments.realizability(none).realizable
        for distance, sign in product(spread(1e-12, 1.0, 7), (1.0, -1.0)):
            exact = 1.0 + sign * distance
            covariance = np.array([[unit * unit, exact * unit], [exact * unit, 1.0]])
            found = moments.realizability(covariance)
            within = exact <= 1.0 or distance < moments.RHO_ROUNDING
            assert found.realizable == within
            yield found.rho, min(exact, 1.0) if within else exact, 1.0
            yield found.smallest_eigenvalue, smallest(covariance), min(unit, 1.0) ** 2


def step_phase():
    """Sine and cosine by the project's own operations."""
    for tau in (*spread(1e-9, 1e6, 200, 0.0), *(-0.25 * math.pi * k for k in range(1, 40))):
        with mp.workdps(40):
            exact = float(mp.sin(mp.mpf(tau))), float(mp.cos(mp.mpf(tau)))
        yield drive.sine_cosine(tau), exact, 1.0


def steps():
    """Scenes with steps, up to the longest admissible one."""
    for beta1 in spread(1e-9, 1e3, 5, 0.0):
        for beta2 in (0.0, beta1, beta1 * (1.0 + 1e-9), 2.0, 1e3):
            # largest admissible dt, and beta dt
            longest = min(0.1, 0.2 / max(beta1, beta2, 1e-300))
            for h in (1e-12, 1e-3 * longest, longest):
                yield constants((beta1, beta2)), h


def fly_step(c, tau, h, s):
    """The end of a part of a step without noise."""
    end = np.empty(s.size)
    series = np.zeros((3 + c.wheels.size, short.TERMS_AND_NOISE))
    short.short_flight(c, c.alpha, 1.0, short.phase_at(c.drive, tau), h, s, 0.0, 0.0, series, end)
    return end


def step_flight():
    """A part of a step without noise."""
    for c, h in steps():
        s = np.array([0.0, -0.4, 0.0, 0.5])
        yield fly_step(c, 2.2, h, s), *digits.flight(c, 2.2, s, h)


def step_noise():
    """Noise of a step from its Brownian increment, and from its space-time Lévy area."""
    for (c, h), (first, slope) in product(steps(), ((1.0, 0.0), (0.0, 1.0))):
        if h > 1e-12:
            beta1, beta2 = c.wheels["beta"]
            m = 1.0 + beta1
            apart = abs(beta1 - beta2) * (1.0 + h)
            found = short.pushed_by(c, 0.4, h, first, slope / 12.0)
            exact = digits.step_noise(c, 0.4, h, first, slope)
            yield found, exact, [m * h, m, apart * h, apart]


ALLOWED = {
    phi_functions: ROUNDING,
    flight_state: ROUNDING,
    flight_jacobian: ROUNDING,
    flight_noise: 1e-13,
    noise_phase_derivative: 1e-11,
    edgeworth_windows: ROUNDING,
    correlations: ROUNDING,
    step_phase: ROUNDING,
    step_flight: ROUNDING,
    step_noise: 1e-8,
}
"""The largest admissible error of each."""


def largest_error(rows, factor=1.0):
    """Largest error, in its unit, of all that is found times a factor."""
    errors = [
        np.max(np.abs(factor * np.asarray(found) - exact) / np.maximum(unit, 1e-300))
        for found, exact, unit in rows
    ]
    return np.max(errors)


@pytest.mark.parametrize("compared", ALLOWED)
def test_formula_at_extreme_values(compared):
    """Negative control: all that is found times one and ten times what is allowed."""
    rows = list(compared())
    allowed = ALLOWED[compared]
    assert largest_error(rows) <= allowed
    assert largest_error(rows, 1.0 + 10.0 * allowed) > allowed


def test_comparison_sees_cancellation(monkeypatch):
    def cancelling(beta, t):
        return (t - damping.phi1(beta, t)) / beta if beta else 0.5 * t * t

    monkeypatch.setattr(damping, "phi2", cancelling)
    assert largest_error(phi_functions()) > ROUNDING
