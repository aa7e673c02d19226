"""Brownian motion by increment and area: split and joined, exactly in distribution, against a
finely stepped path."""

import math

import numpy as np
import pytest

from rattle.montecarlo.noise.brownian import Noise, join, split

H = 2.0


def of_normals(normals, h):
    """Increment and area over a time h from standard normals."""
    w, a = normals
    return Noise(w * math.sqrt(h), a * math.sqrt(h / 12.0))


def to_normals(noise, h):
    return [noise.increment / math.sqrt(h), noise.area * math.sqrt(12.0 / h)]


@pytest.mark.parametrize("share", [1e-9, 0.003, 0.3, 0.5, 0.9, 1.0 - 1e-9])
def test_split_is_a_rotation_of_four_standard_normals(share):
    """So the parts' coefficients are independent standard normals again, exactly; `join` undoes it.

    The second increment is a difference: its rounding is that of the whole, over the root of the
    rest.
    """
    columns = []
    for e in np.eye(4):
        first, second = split(of_normals(e[:2], H), H, share, e[2], e[3])
        joined = to_normals(join(first, second, share), H)
        assert np.abs(joined - e[:2]).max() < 1e-13
        columns.append(to_normals(first, share * H) + to_normals(second, (1.0 - share) * H))
    off = np.array(columns) @ np.transpose(columns) - np.eye(4)
    assert np.abs(off).max() < 1e-14 / math.sqrt(1.0 - share) + 1e-14
