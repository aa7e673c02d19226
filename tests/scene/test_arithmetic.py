"""Arithmetic that no processor changes: the fused multiply-add, exponentials, and small
eigenvalues."""

import math
from fractions import Fraction

import numpy as np
import pytest

from rattle.closure.exponentials import exponentials
from rattle.scene.compiled import fma, jit, widest_vectors

LARGEST_DOUBLE = 1.7976931348623157e308
LEAST_DOUBLE = 5e-324
LEAST_NORMAL = 2.2250738585072014e-308


@jit
def fused(a, b, c):
    return fma(a, b, c)


@jit
def fused_arrays(a, b, c, out):
    widest_vectors()
    for i in range(a.size):
        out[i] = fma(a[i], b[i], c[i])


def operands(count=3000):
    """Numbers of very different sizes, many of which all but cancel."""
    rng = np.random.default_rng(1)
    a, b, c = rng.normal(size=(3, count)) * 10.0 ** rng.uniform(-8.0, 8.0, (3, count))
    near = rng.random(count) < 0.5
    return a, b, np.where(near, -a * b * (1.0 + rng.integers(-2, 3, count) * 2.0**-53), c)


def exact(a, b, c):
    return float(Fraction(a) * Fraction(b) + Fraction(c))


def test_it_rounds_once():
    a, b, c = operands()
    expected = np.array([exact(*abc) for abc in zip(a, b, c, strict=True)])
    assert [fma(*abc) for abc in zip(a, b, c, strict=True)] == expected.tolist()
    found = np.empty(a.size)
    fused_arrays(a, b, c, found)
    assert np.array_equal(found, expected)
    assert (a * b + c != expected).mean() > 0.2  # negative control: two roundings are seen


@pytest.mark.parametrize(
    ("a", "b", "c"),
    [
        (LARGEST_DOUBLE, 2.0, -LARGEST_DOUBLE),
        (LARGEST_DOUBLE, 1.5, 0.0),
        (1e160, 1e160, -1e300),
        (1e-200, 1e-200, 1.0),
        (1e-170, 1e-150, LEAST_DOUBLE),
        (LEAST_NORMAL, 0.5, LEAST_DOUBLE),
        (LEAST_DOUBLE, 0.5, 0.0),
        (LEAST_DOUBLE, 0.75, LEAST_DOUBLE),
        (1e-300, 1e300, -1.0),
        (0.0, 3.0, -2.0),
        (1.0 + 2.0**-52, 1.0 - 2.0**-53, -1.0),
        (1e308, 1e-308, -1.0),
    ],
)
def test_at_the_ends_of_the_range(a, b, c):
    assert fma(a, b, c) == fused(a, b, c)
    if math.isfinite(a * b + c):
        assert fused(a, b, c) == exact(a, b, c)


SPECIAL = [0.0, -0.0, 1.0, -1.0, 709.0, -745.0, -746.0, 1e-300, math.inf, -math.inf, math.nan]
WIDE = np.random.default_rng(1).normal(0.0, 200.0, size=20_000).clip(-740.0, 700.0)


@pytest.mark.parametrize("given", [0.5, SPECIAL, [], WIDE, WIDE.reshape(100, 200).T], ids=np.shape)
def test_exponentials_are_those_of_the_c_library_to_the_last_bit(given):
    found = exponentials(given)
    assert found.shape == np.shape(given)
    np.testing.assert_array_equal(found.ravel(), [math.exp(x) for x in np.ravel(given)])
