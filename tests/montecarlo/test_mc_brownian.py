"""Brownian motion by increment and area: split and joined, exactly in distribution, against a
finely stepped path."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rattle.montecarlo.noise.brownian import Noise, join, split

NORMAL = st.floats(-8.0, 8.0)


def standard(noise, h):
    """Increment and area in units of their sds over a time h."""
    return np.array([noise.increment / math.sqrt(h), noise.area * math.sqrt(12.0 / h)])


@settings(max_examples=400, deadline=None, derandomize=True)
@given(
    st.floats(1e-9, 1.0 - 1e-9),
    st.floats(-12.0, 3.0),
    NORMAL,
    NORMAL,
    NORMAL,
    NORMAL,
)
def test_joined_undoes_split(share, exponent, w, a, z1, z2):
    """To rounding of the parts' own size; nothing is ever NaN."""
    h = 10.0**exponent
    whole = Noise(w * math.sqrt(h), a * math.sqrt(h / 12.0))
    parts = split(whole, h, share, z1, z2)
    assert np.isfinite(parts).all()
    again = join(*parts, share)
    assert np.abs(standard(again, h) - [w, a]).max() < 1e-13


def rotation(share, h=2.0):
    """Matrix from (w, a, z1, z2) to both parts in standard units, read off `split` at unit
    vectors."""
    columns = []
    for e in np.eye(4):
        first, second = split(
            Noise(e[0] * math.sqrt(h), e[1] * math.sqrt(h / 12.0)), h, share, e[2], e[3]
        )
        columns.append(
            np.concatenate([standard(first, share * h), standard(second, (1.0 - share) * h)])
        )
    return np.array(columns).T


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.floats(1e-9, 1.0 - 1e-9))
def test_split_is_a_rotation_of_four_standard_normals(share):
    """So the parts' coefficients are independent standard normals again, exactly.

    The second increment is a difference: its rounding is that of the whole, over the root of the
    rest.
    """
    r = rotation(share)
    assert np.abs(r @ r.T - np.eye(4)).max() < 1e-14 / math.sqrt(1.0 - share) + 1e-14
    wide = r * [1.0, 1.0, 1.05, 1.0]  # negative control: a split that spreads too much
    assert np.abs(wide @ wide.T - np.eye(4)).max() > 1e-10
