"""Random numbers: Philox 4x32-10 and its normals against independent references, their laws, and no
counter twice."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mc_checks import agrees, dat21, for_python, key_of, limit, step_normals
from mc_checks import stepped as simulate
from scipy import stats

from rattle import Sampling
from rattle.montecarlo.noise import philox as module
from rattle.montecarlo.noise.philox import Key

U = np.uint64
words = for_python(module.words)
pair = for_python(module._pair)
FULL = 0xFFFFFFFF


# kat_vectors of Random123: counter, key, output
KNOWN = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((FULL,) * 4, (FULL,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]


def philox(counter, key, rounds=10):
    """Philox 4x32 in Python integers, from the paper of Salmon et al. alone."""
    c0, c1, c2, c3 = counter
    k0, k1 = key
    for _ in range(rounds):
        p0 = 0xD2511F53 * c0
        p1 = 0xCD9E8D57 * c2
        c0 = (p1 >> 32) ^ c1 ^ k0
        c1 = p1 & FULL
        c2 = (p0 >> 32) ^ c3 ^ k1
        c3 = p0 & FULL
        k0 = (k0 + 0x9E3779B9) & FULL
        k1 = (k1 + 0xBB67AE85) & FULL
    return c0, c1, c2, c3


def counter_of(path, index, purpose):
    """Counter words of a (path, index, purpose)."""
    return path & FULL, path >> 32, index & FULL, index >> 32 | purpose << 24


def address_of(counter):
    """The (path, index, purpose) that has these counter words."""
    c0, c1, c2, c3 = counter
    return U(c0 | c1 << 32), U(c2 | (c3 & 0xFFFFFF) << 32), U(c3 >> 24)


def found(counter, key):
    return tuple(int(w) for w in words(Key(U(key[0]), U(key[1])), *address_of(counter)))


@pytest.mark.parametrize(("counter", "key", "output"), KNOWN)
def test_known_answers(counter, key, output):
    assert found(counter, key) == output
    assert philox(counter, key) == output


@settings(max_examples=300, deadline=None, derandomize=True)
@given(
    st.integers(0, 2**64 - 1),
    st.integers(0, 2**56 - 1),
    st.integers(0, 255),
    st.tuples(st.integers(0, FULL), st.integers(0, FULL)),
)
def test_words_are_those_of_philox_in_python_integers(path, index, purpose, key):
    counter = counter_of(path, index, purpose)
    assert found(counter, key) == philox(counter, key)


EXTREME = [0, 1, 0xFF, 0x100, 0xFFFF, 0xFFFFFF, 0x1000000, 0x7FFFFF00, 0x7FFFFFFF]
EXTREME += [0x80000000, 0xFFFFFF00, FULL - 1, FULL]
"""Words whose bits carry over, end a range, or lie on either side of a border between the parts of
a word."""

CLOSE = 5e-10
"""What the polynomials leave of the exact functions, over one or the normal's size."""


def box_muller(high, low):
    """Two normals from 64 bits by the C library: 40 bits for the radius, 23 for the angle, one for
    the half plane."""
    bits = high | (low & 0xFF) << 32
    u = (bits + 0.5) / 2**40
    radius = math.sqrt(
        -2.0 * (math.log1p(-((2**40 - bits) - 0.5) / 2**40) if u > 0.5 else math.log(u))
    )
    angle = 0.5 * math.pi * (((low >> 8 & 0x7FFFFF) + 0.5) / 2**22 - 1.0)
    return radius * math.cos(angle) * (-1.0 if low >> 31 else 1.0), radius * math.sin(angle)


def furthest_pair(highs, lows, fault=1.0):
    """Largest difference of a pair from the reference, over one or the normal's size."""
    worst = 0.0
    for high, low in zip(highs, lows, strict=True):
        for a, b in zip(pair(U(high), U(low)), box_muller(high, low), strict=True):
            worst = max(worst, abs(fault * a - b) / max(1.0, abs(b)))
    return worst


def test_normals_of_extreme_and_common_words_are_those_of_the_c_library():
    highs, lows = np.array([(h, w) for h in EXTREME for w in EXTREME]).T.tolist()
    # where the exponent of the uniform number changes
    powers = [2**k + d for k in range(1, 32) for d in (-1, 0)]
    common = np.random.default_rng(2).integers(0, 2**32, (2, 3000)).tolist()
    highs = highs + powers + common[0]
    lows = lows + [12345] * len(powers) + common[1]
    assert furthest_pair(highs, lows) < CLOSE
    assert furthest_pair(highs, lows, fault=1.0 + 1e-9) > CLOSE


@pytest.fixture(scope="module")
def z():
    key = key_of(np.random.SeedSequence(7))
    return np.array([step_normals(key, path, 800).reshape(200, 4) for path in range(1000)])


def moment_scores(z, powers=range(1, 9)):
    """z-scores of the raw moments of standard normals, per component."""
    scores = []
    for p in powers:
        truth = stats.norm.moment(p)
        second = stats.norm.moment(2 * p)
        scores.append(
            ((z**p).mean(axis=(0, 1)) - truth) / np.sqrt((second - truth**2) / z[..., 0].size)
        )
    return np.concatenate(scores)


def test_moments_to_the_eighth_are_those_of_a_standard_normal(z):
    scores = moment_scores(z)
    assert np.abs(scores).max() < limit(scores.size)
    # negative control: tails that are too long from three sds on
    wrong = moment_scores(np.where(np.abs(z) > 3.0, 1.3 * z - 0.9 * np.sign(z), z))
    assert np.abs(wrong).max() > limit(scores.size)


@pytest.mark.parametrize("scheme", ["euler-maruyama", "euler-maruyama-located"])
def test_section_moments_are_those_of_gaussian_increments(scheme):
    settings = {"paths": 40_000, "impacts": 4, "dt": 2e-3, "scheme": scheme, "workers": 2}
    two = simulate(dat21(1.0), sampling=Sampling(increments="two-point"), rng=1, **settings).section
    normal = simulate(dat21(1.0), rng=2, **settings).section
    for name in ("tau", "y1", "y2", "sd_tau", "sd_y1", "sd_y2"):
        error = np.hypot(two["se_" + name], normal["se_" + name])
        assert agrees(two[name], normal[name], error)
        assert not agrees(1.03 * two[name], normal[name], error)
