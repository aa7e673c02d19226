"""Random numbers as a function of (seed, path, index, purpose): Philox 4x32-10 and the Box-Muller
transform.

There is no generator state.  What a path draws depends on the seed and on its own number only: not
on workers, blocks, lanes or other paths.

References
----------
Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3" (SC 2011).
Box and Muller, "A note on the generation of random normal deviates" (1958).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.scene import Floats
from rattle.scene.compiled import float_of, fma, inline, lean, widest_vectors, word_of

LEVELS = 3  # dt, 2 dt and 4 dt share one Brownian path (Richardson extrapolation)

STEP = 0
CONTACT = 1
BRIDGE = 2
MEMORY = 100
RESTITUTION = 101
WHEEL_STEP = 128
WHEEL_BRIDGE = 160
"""Purposes, that is, substreams: noise of the steps; half gaps; splits within a step (`BRIDGE` +
level); noise with a memory at the start; random restitution; noise of the steps of one wheel alone
(`WHEEL_STEP` + wheel), and its splits (`WHEEL_BRIDGE` + 32 level + wheel)."""

Word = np.uint64
LOW = Word(0xFFFFFFFF)
HALF_WORD = Word(32)
FACTOR_0 = Word(0xD2511F53)
FACTOR_1 = Word(0xCD9E8D57)
WEYL_0 = Word(0x9E3779B9)
WEYL_1 = Word(0xBB67AE85)
# the index has the lower 24 bits of the fourth counter word, the purpose the upper 8
INDEX_BITS = Word(24)

RADIUS = Word(2**40 - 1)
ANGLE = Word(0x7FFFFF00)
SIGN = Word(2**63)
"""The 64 bits of a Box-Muller pair: of the radius (32 of one word, 8 of the other), of the angle,
of its half plane."""
# bits of 2^52, below which integers n fit as 2^52 + n
TWO_52 = Word(0x4330000000000000)
ONE = Word(0x3FF0000000000000)
MANTISSA = Word(2**52 - 1)
EXPONENT = Word(52)
LN2 = math.log(2.0)

# Minimax polynomials: -2 log(1 - g / 2) / g on (0, 1]; sin(pi t / 2) / t and cos(pi t / 2) in t^2
# on (-1, 1)
LOG = (
    1.0000000005554142,
    0.24999986889612788,
    0.08333842431962475,
    0.03117336373752817,
    0.013086915089760913,
    0.002614853315029207,
    0.009264280490215637,
    -0.01097421865165355,
    0.01295638395297019,
    -0.007324599667854153,
    0.0021590883127490224,
)
_SINE = (
    1.5707963267616731,
    -0.645964095264455,
    0.0796926012598293,
    -0.0046816510162407295,
    0.0001602470287436184,
    -3.428790697558761e-06,
)
_COSINE = (
    0.9999999999992536,
    -1.233700550062837,
    0.2536695067256754,
    -0.020863473695902596,
    0.0009192400253751418,
    -2.5172218494009397e-05,
    4.492276816542459e-07,
)
# for t in units of 2^-30
SINE_SERIES = tuple(a * 2.0 ** (-30 * (2 * i + 1)) for i, a in enumerate(_SINE))
COSINE = tuple(a * 2.0 ** (-30 * 2 * i) for i, a in enumerate(_COSINE))


class Key(NamedTuple):
    """The Philox key of a run; every seed has its own."""

    low: Word  # low, high: two 32-bit words
    high: Word


def key_of(seed: np.random.SeedSequence) -> Key:
    """Philox key of a seed."""
    low, high = seed.generate_state(2, np.uint32)
    return Key(Word(low), Word(high))


@inline
def words(key: Key, path: Word, index: Word, purpose: Word) -> tuple[Word, Word, Word, Word]:
    """Four random 32-bit words (each in a uint64): Philox 4x32-10 of the counter (path, index,
    purpose)."""
    c0 = path
    c1 = path >> HALF_WORD
    c2 = index
    c3 = (index >> HALF_WORD) | (purpose << INDEX_BITS)
    k0 = key.low
    k1 = key.high
    for _ in range(10):
        p0 = FACTOR_0 * (c0 & LOW)
        p1 = FACTOR_1 * (c2 & LOW)
        c0 = (p1 >> HALF_WORD) ^ c1 ^ k0
        c1 = p1
        c2 = (p0 >> HALF_WORD) ^ c3 ^ k1
        c3 = p0
        k0 = k0 + WEYL_0
        k1 = k1 + WEYL_1
    return c0 & LOW, c1 & LOW, c2 & LOW, c3 & LOW


@lean
def uniforms(key: Key, path: Word, index: Word, purpose: Word) -> tuple[float, float]:
    """Two independent uniform numbers in (0, 1), each with 53 bits."""
    a, b, c, d = words(key, path, index, purpose)
    shift = Word(11)
    return (
        (np.float64(((a << HALF_WORD) | b) >> shift) + 0.5) * 2.0**-53,
        (np.float64(((c << HALF_WORD) | d) >> shift) + 0.5) * 2.0**-53,
    )


@inline
def _square_of_radius(bits: Word) -> float:
    """``-2 log u`` for ``u = (bits + 1/2) / 2^40``, to 8e-10 of it; vectorises, and has no
    division.

    With ``bits + 1/2 = 2^e (2 - g)``, g in (0, 1], it is ``2 log 2 (39 - e) - 2 log(1 - g / 2)``;
    the second term is g times a polynomial.
    """
    v = float_of(bits | TWO_52) - (2.0**52 - 0.5)
    seen = word_of(v)
    g = 2.0 - float_of((seen & MANTISSA) | ONE)
    k = (2.0**52 + 1062.0) - float_of((seen >> EXPONENT) | TWO_52)
    q = LOG[-1]
    for i in range(len(LOG) - 2, -1, -1):
        q = fma(g, q, LOG[i])
    return fma(k, 2.0 * LN2, g * q)


@inline
def _half_circle(angle: Word) -> tuple[float, float]:
    """Cosine and sine of ``pi / 2 t``, ``t = (a + 1/2) / 2^22 - 1`` where ``angle = 256 a``, a
    below 2^23; to 3e-11."""
    t = float_of(angle | TWO_52) - (2.0**52 + 2.0**30 - 128.0)  # in units of 2^-30
    z = t * t
    sine = SINE_SERIES[-1]
    cosine = COSINE[-1]
    for i in range(len(SINE_SERIES) - 2, -1, -1):
        sine = fma(z, sine, SINE_SERIES[i])
    for i in range(len(COSINE) - 2, -1, -1):
        cosine = fma(z, cosine, COSINE[i])
    return cosine, t * sine


@inline
def _pair(high: Word, low: Word) -> tuple[float, float]:
    """Two independent standard normals from 64 bits by Box-Muller: 40 bits for the radius, 24 for
    the angle.

    The radius is at most 7.5, which truncates a probability of 1e-12.  The 2^24 angles are equally
    spaced, so that low moments of the direction are exact: 2^23 of them on the right half of the
    circle, and a bit for the left half. Normals are within 5e-10 of those of the exact functions.
    """
    bits = (high | (low << HALF_WORD)) & RADIUS
    radius = math.sqrt(_square_of_radius(bits))
    cosine, sine = _half_circle(low & ANGLE)
    turned = float_of(word_of(cosine) ^ ((low << HALF_WORD) & SIGN))
    return radius * turned, radius * sine


@lean
def normals(key: Key, path: Word, index: Word, purpose: Word) -> tuple[float, float, float, float]:
    """Four independent standard normals."""
    a, b, c, d = words(key, path, index, purpose)
    z0, z1 = _pair(a, b)
    z2, z3 = _pair(c, d)
    return z0, z1, z2, z3


@inline
def _make_normal(first: Floats, second: Floats, lanes: int) -> None:
    """Turn two words of every lane into normals, in place."""
    for p in range(lanes):
        first[p], second[p] = _pair(word_of(first[p]), word_of(second[p]))


@lean
def fill_normals(
    key: Key, paths: NDArray[np.uint64], index: Word, purpose: Word, lanes: int, z: Floats
) -> None:
    """Four standard normals of every lane for one index of a substream; vectorises.

    In three loops, with the words where their normals will be: in one, a processor waits for the
    words of a vector before it can begin with the next.

    Shapes: `paths` (lanes or more,); `z` (4, lanes or more).
    """
    widest_vectors()
    z0 = z[0]
    z1 = z[1]
    z2 = z[2]
    z3 = z[3]
    for p in range(lanes):
        a, b, c, d = words(key, paths[p], index, purpose)
        z0[p], z1[p], z2[p], z3[p] = float_of(a), float_of(b), float_of(c), float_of(d)
    _make_normal(z0, z1, lanes)
    _make_normal(z2, z3, lanes)


@lean
def fill_words(key: Key, paths: NDArray[Word], index: Word, lanes: int, out: NDArray[Word]) -> None:
    """Sixty-four random bits of every lane for one index of the substream `STEP`; vectorises."""
    widest_vectors()
    for p in range(lanes):
        a, b, _, _ = words(key, paths[p], index, Word(STEP))
        out[p] = (a << HALF_WORD) | b


@lean
def fill_signs(bits: NDArray[Word], place: int, lanes: int, z: Floats) -> None:
    """Two-point increments of every lane, +1 or -1 from one bit; their first three moments are
    those of a standard normal.  Vectorises."""
    widest_vectors()
    for p in range(lanes):
        z[p] = float_of(((bits[p] << Word(63 - place)) & SIGN) | ONE)
