from math import sqrt

import numpy as np
import pytest

from rattle.closure import Edgeworth
from rattle.closure.edgeworth import coefficients


def raw_moments(order):
    """Raw moments of points with mean zero: skew, light-tailed and correlated."""
    x, y = np.random.default_rng(1).beta(2.0, 5.0, (2, 400))
    x = 4.0 * (x - x.mean())
    y = 0.5 * x + 3.0 * (y - y.mean())
    raw = np.zeros((order + 1, order + 1))
    for n in range(order + 1):  # entries beyond the order do not belong to the series
        for p in range(order + 1 - n):
            raw[n, p] = (x**n * y**p).mean()
    return raw


def scaled(raw):
    """The series of a set of moments, with its own standard deviations."""
    sd_x = sqrt(raw[2, 0])
    sd_y = sqrt(raw[0, 2])
    return Edgeworth(coefficients(raw, sd_x, sd_y), sd_x, sd_y)


def grid_moments(series, order):
    """Moments of a density by the trapezium rule on +-11 sd, which is exact to rounding for a
    Gaussian times powers."""
    z = np.linspace(-11, 11, 441)
    x = z * series.sd_x
    y = z * series.sd_y
    p = series.density(*np.meshgrid(x, y, indexing="ij")) * (x[1] - x[0]) * (y[1] - y[0])
    powers = np.arange(order + 1)
    return (x[:, None] ** powers).T @ p @ (y[:, None] ** powers)


@pytest.mark.parametrize("order", [3, 6])
def test_the_series_has_the_moments_it_was_made_of(order):
    raw = raw_moments(order)
    assert abs(raw[1, 0]) + abs(raw[0, 1]) < 1e-14
    series = scaled(raw)
    found = grid_moments(series, order)
    for n in range(order + 1):
        for p in range(order + 1 - n):
            assert found[n, p] == pytest.approx(raw[n, p], rel=0, abs=1e-12)
    x = np.linspace(-11, 11, 441)[:, None] * series.sd_x
    zeta = np.linspace(-4, 4, 33)
    joint = series.density(x + 0.0 * zeta, zeta + 0.0 * x).sum(axis=0) * (x[1] - x[0])
    # a sum of 441 terms
    assert series.velocity_density(zeta) == pytest.approx(joint, rel=0, abs=441 * 2.0**-53)
