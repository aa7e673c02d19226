"""Brownian motion by increment and area: split and joined, exactly in distribution, against a
finely stepped path."""

import math

import numpy as np
import pytest

from rattle.montecarlo.noise.brownian import Noise, join, split


def standard(noise, h):
    """Increment and area in units of their sds over a time h."""
    return np.array([noise.increment / math.sqrt(h), noise.area * math.sqrt(12.0 / h)])


def rotation(share, h=2.0):
    """Matrix from (w, a, z1, z2) to both parts in standard units, read off `split` at unit
    vectors; `join` undoes it."""
    columns = []
    for e in np.eye(4):
        whole = Noise(e[0] * math.sqrt(h), e[1] * math.sqrt(h / 12.0))
        first, second = split(whole, h, share, e[2], e[3])
        assert np.abs(standard(join(first, second, share), h) - e[:2]).max() < 1e-13
        columns.append(
            np.concatenate([standard(first, share * h), standard(second, (1.0 - share) * h)])
        )
    return np.array(columns).T


@pytest.mark.parametrize("share", [1e-9, 0.003, 0.3, 0.5, 0.9, 1.0 - 1e-9])
def test_split_is_a_rotation_of_four_standard_normals(share):
    """So the parts' coefficients are independent standard normals again, exactly.

    The second increment is a difference: its rounding is that of the whole, over the root of the
    rest.
    """
    r = rotation(share)
    assert np.abs(r @ r.T - np.eye(4)).max() < 1e-14 / math.sqrt(1.0 - share) + 1e-14
