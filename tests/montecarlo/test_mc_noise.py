"""Random numbers: Philox 4x32-10 and its normals against independent references; two-point
increments."""

import math
from itertools import product

import numpy as np
import pytest
from limits import limit
from mc_checks import for_python, largest_z
from scenes import dat21

from rattle import Sampling, simulate
from rattle.montecarlo.noise import philox as module
from rattle.montecarlo.noise.philox import Key

U = np.uint64
words = for_python(module.words)
pair = for_python(module._pair)
FULL = 0xFFFFFFFF


# kat_vectors of Random123: counter, key, output
KNOWN = [
    ((FULL,) * 4, (FULL,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]


@pytest.mark.parametrize(("counter", "key", "output"), KNOWN)
def test_known_answers(counter, key, output):
    """The counter holds the path, the index and the purpose."""
    c0, c1, c2, c3 = counter
    address = U(c0 | c1 << 32), U(c2 | (c3 & 0xFFFFFF) << 32), U(c3 >> 24)
    assert tuple(words(Key(*map(U, key)), *address)) == output


EXTREME = [0, 1, 0xFF, 0x100, 0xFFFF, 0xFFFFFF, 0x1000000, 0x7FFFFF00, 0x7FFFFFFF]
EXTREME += [0x80000000, 0xFFFFFF00, FULL - 1, FULL]
"""Words whose bits carry over, end a range, or lie on either side of a border between the parts of
a word."""

POLYNOMIAL_ERROR = 5e-10
"""What the polynomials leave of the exact functions, over one or the normal's size."""


def box_muller(high, low):
    """Two normals from 64 bits by the C library: 40 bits for the radius, 23 for the angle, one for
    the half plane."""
    bits = high | (low & 0xFF) << 32
    radius = math.sqrt(-2.0 * math.log((bits + 0.5) / 2**40))
    angle = 0.5 * math.pi * (((low >> 8 & 0x7FFFFF) + 0.5) / 2**22 - 1.0)
    return radius * math.cos(angle) * (-1.0 if low >> 31 else 1.0), radius * math.sin(angle)


def test_normals_of_extreme_and_common_words_are_those_of_the_c_library():
    """Errors over one or the normal's size; one of 1e-9 is seen."""
    # where the exponent of the uniform number changes
    powers = [(2**k + d, 12345) for k in range(1, 32) for d in (-1, 0)]
    common = np.random.default_rng(2).integers(0, 2**32, (3000, 2)).tolist()
    both = [*product(EXTREME, EXTREME), *powers, *common]
    truth = np.array([box_muller(high, low) for high, low in both])
    found = np.array([pair(U(high), U(low)) for high, low in both])
    size = np.maximum(1.0, np.abs(truth))
    assert np.abs((found - truth) / size).max() < POLYNOMIAL_ERROR
    assert np.abs(((1.0 + 1e-9) * found - truth) / size).max() > POLYNOMIAL_ERROR


def test_section_moments_are_those_of_gaussian_increments():
    """Three percent more are noticed."""
    given = {"paths": 30_000, "impacts": 4, "dt": 2e-3, "scheme": "euler-maruyama-located"}
    two_point = Sampling(increments="two-point")
    two = simulate(dat21(1.0), sampling=two_point, rng=1, **given).section
    normal = simulate(dat21(1.0), rng=2, **given).section
    names = ["tau", "y1", "y2", "sd_tau", "sd_y1", "sd_y2"]
    assert largest_z(two, normal, names) < limit(24) < largest_z(1.03 * two, normal, names)
