"""Elementary functions and quadrature have the bits of the C library, or the digits of numpy's."""

import math

import numpy as np
import pytest

from rattle.scene.elementary import exponentials

SPECIAL = [0.0, -0.0, 1.0, -1.0, 709.0, -745.0, -746.0, 1e-300, math.inf, -math.inf, math.nan]
WIDE = np.random.default_rng(1).normal(0.0, 200.0, size=20_000).clip(-740.0, 700.0)


@pytest.mark.parametrize("given", [0.5, SPECIAL, [], WIDE, WIDE.reshape(100, 200).T], ids=np.shape)
def test_exponentials_are_those_of_the_c_library_to_the_last_bit(given):
    found = exponentials(given)
    assert found.shape == np.shape(given)
    np.testing.assert_array_equal(found.ravel(), [math.exp(x) for x in np.ravel(given)])
