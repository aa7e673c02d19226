import numpy as np
import pytest

from rattle.closure import Edgeworth
from rattle.closure.edgeworth import coefficients

ORDER = 6
WITHIN_ORDER = np.add.outer(range(ORDER + 1), range(ORDER + 1)) <= ORDER
"""The moments that belong to the series."""


def moments(x, y, weights):
    """Moments of points, or of a density on a grid."""
    x, y = (np.vander(values, ORDER + 1, increasing=True) for values in (x, y))
    return x.T @ weights @ y


def test_the_series_has_the_moments_it_was_made_of():
    """Of points with mean zero: skew, light-tailed and correlated; by the trapezium rule on +-11
    sd, which is exact to rounding for a Gaussian times powers."""
    x, y = np.random.default_rng(1).beta(2.0, 5.0, (2, 400))
    x = 4.0 * (x - x.mean())
    y = 0.5 * x + 3.0 * (y - y.mean())
    raw = moments(x, y, np.eye(400) / 400)
    series = Edgeworth(coefficients(raw, x.std(), y.std()), x.std(), y.std())
    z = np.linspace(-11, 11, 441)
    x = z * series.sd_x
    y = z * series.sd_y
    density = series.density(x[:, None] + 0.0 * y, y + 0.0 * x[:, None])
    found = moments(x, y, density * (x[1] - x[0]) * (y[1] - y[0]))
    assert found[WITHIN_ORDER] == pytest.approx(raw[WITHIN_ORDER], rel=0, abs=1e-12)
    joint = density.sum(axis=0) * (x[1] - x[0])
    # a sum of 441 terms
    assert series.velocity_density(y) == pytest.approx(joint, rel=0, abs=441 * 2.0**-53)
