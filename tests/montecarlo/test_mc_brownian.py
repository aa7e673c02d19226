"""Brownian motion by increment and area: split and joined, exactly in distribution, against a finely stepped path."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mc_checks import agrees

from rattle.montecarlo.noise.brownian import Noise, join, split
from rattle.scene.compiled import jit

NORMAL = st.floats(-8.0, 8.0)


def standard(noise, h):
    """Increment and area in units of their sds over a time h."""
    return np.array([noise.increment / math.sqrt(h), noise.area * math.sqrt(12.0 / h)])


@settings(max_examples=400, deadline=None, derandomize=True)
@given(
    st.floats(1e-9, 1.0 - 1e-9), st.floats(-12.0, 3.0), NORMAL, NORMAL, NORMAL, NORMAL,
)  # fmt: skip
def test_joined_undoes_split(share, exponent, w, a, z1, z2):
    """To rounding of the parts' own size; nothing is ever NaN."""
    h = 10.0**exponent
    whole = Noise(w * math.sqrt(h), a * math.sqrt(h / 12.0))
    parts = split(whole, h, share, z1, z2)
    assert np.isfinite(parts).all()
    again = join(*parts, share)
    assert np.abs(standard(again, h) - [w, a]).max() < 1e-13


def rotation(share, h=2.0):
    """Matrix from (w, a, z1, z2) to both parts in standard units, read off `split` at unit vectors."""
    columns = []
    for e in np.eye(4):
        first, second = split(Noise(e[0] * math.sqrt(h), e[1] * math.sqrt(h / 12.0)), h, share, e[2], e[3])
        columns.append(np.concatenate([standard(first, share * h), standard(second, (1.0 - share) * h)]))
    return np.array(columns).T


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.floats(1e-9, 1.0 - 1e-9))
def test_split_is_a_rotation_of_four_standard_normals(share):
    """So the parts' coefficients are independent standard normals again, exactly.

    The second increment is a difference: its rounding is that of the whole, over the root of the rest.
    """
    r = rotation(share)
    assert np.abs(r @ r.T - np.eye(4)).max() < 1e-14 / math.sqrt(1.0 - share) + 1e-14
    wide = r * [1.0, 1.0, 1.05, 1.0]  # negative control: a split that spreads too much
    assert np.abs(wide @ wide.T - np.eye(4)).max() > 1e-10


@jit
def parts_of(draws, h, share):
    """(W1, A1, W2, A2) of the split of each row of four standard normals."""
    out = np.empty_like(draws)
    for i in range(len(draws)):
        w, a, z1, z2 = draws[i]
        first, second = split(Noise(w * math.sqrt(h), a * math.sqrt(h / 12.0)), h, share, z1, z2)
        out[i] = first.increment, first.area, second.increment, second.area
    return out


# --- against a path laid out in fine steps

FINE, H = 240, 0.3


def laid_out(paths, seed=1):
    """Increments of Brownian paths over FINE equal steps of a time H."""
    return np.random.default_rng(seed).standard_normal((paths, FINE)) * math.sqrt(H / FINE)


def noise_of(increments):
    """Increment and area of a path linear in each fine step, by summation: the weight s / h - 1/2 at mid-steps."""
    n = increments.shape[1]
    weight = (np.arange(n) + 0.5) / n - 0.5
    return increments.sum(axis=1), increments @ weight


@pytest.mark.parametrize("cut", [1, 60, 120, 239])
def test_joined_parts_of_a_path_are_the_whole_to_rounding(cut):
    fine = laid_out(20)
    whole = np.array(noise_of(fine))
    first, second = np.array(noise_of(fine[:, :cut])), np.array(noise_of(fine[:, cut:]))
    again = np.array([join(Noise(*a), Noise(*b), cut / FINE) for a, b in zip(first.T, second.T, strict=True)]).T
    assert np.abs(again - whole).max() < 1e-15 * FINE
    wrong = np.array([join(Noise(*b), Noise(*a), cut / FINE) for a, b in zip(first.T, second.T, strict=True)]).T
    assert np.abs(wrong - whole).max() > 1e-3  # negative control: the parts the other way round


@pytest.mark.parametrize("cut", [24, 120, 200])
def test_split_given_the_whole_has_the_distribution_of_a_path_given_the_whole(cut):
    """Regression of the parts on increment and area of the whole, and what is left: both as a path laid out has it."""
    fine, share = laid_out(20_000), cut / FINE
    path = np.array([*noise_of(fine[:, :cut]), *noise_of(fine[:, cut:])]).T
    draws = np.random.default_rng(2).standard_normal((len(fine), 4))
    w, a = noise_of(fine)
    draws[:, 0], draws[:, 1] = w / math.sqrt(H), a * math.sqrt(12.0 / H)
    cutting = parts_of(draws, H, share)

    def moments(parts):
        """Products of the parts with each other and with the whole, one row a path."""
        known = np.column_stack([draws[:, :2], parts / np.sqrt(H)])
        return np.column_stack([known[:, i] * known[:, j] for i in range(6) for j in range(2, i + 1)])

    difference = moments(path) - moments(cutting)
    se = difference.std(axis=0) / math.sqrt(len(fine))
    assert agrees(difference.mean(axis=0), 0.0, se, slack=2.0 / FINE**2)  # a path linear in fine steps lacks this much
    other = moments(parts_of(draws, H, min(share + 0.05, 0.95)))  # negative control: cut elsewhere
    assert not agrees((moments(path) - other).mean(axis=0), 0.0, se, slack=2.0 / FINE**2)
