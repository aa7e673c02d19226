"""Random numbers as a function of (seed, path, index, purpose): Philox 4x32-10 and the Box-Muller transform.

There is no generator state.  What a path draws depends on the seed and on its own number only: not on workers, blocks,
lanes or other paths, nor on whether it runs on a processor or on a GPU.

References
----------
Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3" (SC 2011).
Box and Muller, "A note on the generation of random normal deviates" (1958).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.scene.compiled import inlined, lean, spliced

__all__ = [
    "BRIDGE",
    "CONTACT",
    "LEVELS",
    "STEP",
    "Key",
    "Word",
    "bits_of",
    "fill_normals",
    "fill_signs",
    "fill_words",
    "key_of",
    "normals",
    "sign_of",
    "uniforms",
    "words",
]

LEVELS = 3  # dt, 2 dt and 4 dt share one Brownian path (Richardson extrapolation)

STEP, CONTACT, BRIDGE = 0, 1, 2
"""Purposes, that is, substreams: noise of the steps; half gaps; splits within a step (`BRIDGE` + level)."""

Word = np.uint64
LOW, HALF = Word(0xFFFFFFFF), Word(32)
FACTOR_0, FACTOR_1 = Word(0xD2511F53), Word(0xCD9E8D57)
WEYL_0, WEYL_1 = Word(0x9E3779B9), Word(0xBB67AE85)
INDEX_BITS = Word(24)  # the index has the lower 24 bits of the fourth counter word, the purpose the upper 8

RADIUS_BITS, ANGLE_BITS = Word(40), Word(24)  # split of the 64 random bits of a Box-Muller pair
LN2 = math.log(2.0)
TURN = 2.0 * math.pi


class Key(NamedTuple):
    """The Philox key of a run; every seed has its own.

    Attributes
    ----------
    low, high : Word
        Two 32-bit words.
    """

    low: Word
    high: Word


def key_of(seed: np.random.SeedSequence) -> Key:
    """Philox key of a seed.

    Parameters
    ----------
    seed : SeedSequence
        Of the run.

    Returns
    -------
    Key

    Examples
    --------
    >>> key_of(np.random.SeedSequence(7)) == key_of(np.random.SeedSequence(8))
    False
    """
    low, high = seed.generate_state(2, np.uint32)
    return Key(Word(low), Word(high))


@inlined
def words(key: Key, path: Word, index: Word, purpose: Word) -> tuple[Word, Word, Word, Word]:
    """Four random 32-bit words (each in a uint64): Philox 4x32-10 of the counter (path, index, purpose).

    Parameters
    ----------
    key : Key
        Of the run.
    path : Word
        Number of the path.
    index : Word
        Position in the substream, below 2^56.
    purpose : Word
        Substream, below 2^8.

    Returns
    -------
    a, b, c, d : Word
    """
    c0, c1, c2 = path, path >> HALF, index
    c3 = (index >> HALF) | (purpose << INDEX_BITS)
    k0, k1 = key.low, key.high
    for _ in range(10):
        p0, p1 = FACTOR_0 * (c0 & LOW), FACTOR_1 * (c2 & LOW)
        c0, c1, c2, c3 = (p1 >> HALF) ^ c1 ^ k0, p1, (p0 >> HALF) ^ c3 ^ k1, p0
        k0, k1 = k0 + WEYL_0, k1 + WEYL_1
    return c0 & LOW, c1 & LOW, c2 & LOW, c3 & LOW


@lean
def uniforms(key: Key, path: Word, index: Word, purpose: Word) -> tuple[float, float]:
    """Two independent uniform numbers in (0, 1), each with 53 bits.

    Parameters
    ----------
    key : Key
        Of the run.
    path : Word
        Number of the path.
    index : Word
        Position in the substream, below 2^56.
    purpose : Word
        Substream, below 2^8.

    Returns
    -------
    u1, u2 : float
    """
    a, b, c, d = words(key, path, index, purpose)
    shift = Word(11)
    return (
        (np.float64(((a << HALF) | b) >> shift) + 0.5) * 2.0**-53,
        (np.float64(((c << HALF) | d) >> shift) + 0.5) * 2.0**-53,
    )


@spliced
def _log(u: float) -> float:
    """Natural logarithm of a normal float in (0, 1], to rounding; vectorises, unlike that of the C library.

    As in FDLIBM's e_log.c: u = 2^k (1 + f) with 1 + f near 1, and log(1 + f) by a minimax polynomial in s = f / (2 +
    f).
    """
    shifted = np.float64(u).view(np.int64) - np.int64(0x3FE6A09E667F3BCD)  # 1 + f from 1 / sqrt(2) on
    k = shifted >> np.int64(52)
    f = np.int64(np.float64(u).view(np.int64) - (k << np.int64(52))).view(np.float64) - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    odd = z * (
        0.6666666666666735130 + w * (0.2857142874366239149 + w * (0.1818357216161805012 + w * 0.1479819860511658591))
    )
    even = w * (0.3999999999940941908 + w * (0.2222219843214978396 + w * 0.1531383769920937332))
    half = 0.5 * f * f
    return k * LN2 - ((half - s * (half + odd + even)) - f)


@spliced
def _circle(turn: float, quadrant: np.int64) -> tuple[float, float]:
    """Cosine and sine of ``2 pi (turn + quadrant / 4)``, ``|turn| <= 1/8``, to rounding; vectorises."""
    x = TURN * turn
    z = x * x
    sine = x + x * z * (
        -1.66666666666666324348e-1 + z * (8.33333333332248946124e-3 + z * (-1.98412698298579493134e-4
        + z * (2.75573137070700676789e-6 + z * (-2.50507602534068634195e-8 + z * 1.58969099521155010221e-10))))
    )  # fmt: skip
    cosine = 1.0 - 0.5 * z + z * z * (
        4.16666666666666019037e-2 + z * (-1.38888888888741095749e-3 + z * (2.48015872894767294178e-5
        + z * (-2.75573143513906633035e-7 + z * (2.08757232129817482790e-9 - z * 1.13596475577881948265e-11))))
    )  # fmt: skip
    odd = (quadrant & np.int64(1)) != 0
    a, b = (sine, cosine) if odd else (cosine, sine)
    a = -a if ((quadrant + np.int64(1)) & np.int64(2)) != 0 else a
    b = -b if (quadrant & np.int64(2)) != 0 else b
    return a, b


@inlined
def _pair(high: Word, low: Word) -> tuple[float, float]:
    """Two independent standard normals from 64 bits by Box-Muller: 40 bits for the radius, 24 for the angle.

    The radius is at most 7.5, which truncates a probability of 1e-12.  The 2^24 angles are equally spaced, so that low
    moments of the direction are exact.
    """
    bits = (high << HALF) | low
    u = (np.float64(np.int64(bits >> ANGLE_BITS)) + 0.5) * 2.0**-40
    angle = np.int64(bits & Word(0xFFFFFF))
    quadrant = (angle + np.int64(1 << 21)) >> np.int64(22)
    cosine, sine = _circle(np.float64(angle - (quadrant << np.int64(22))) * 2.0**-24, quadrant)
    radius = math.sqrt(-2.0 * _log(u))
    return radius * cosine, radius * sine


@inlined
def _four(key: Key, path: Word, index: Word, purpose: Word) -> tuple[float, float, float, float]:
    a, b, c, d = words(key, path, index, purpose)
    z0, z1 = _pair(a, b)
    z2, z3 = _pair(c, d)
    return z0, z1, z2, z3


@lean
def normals(key: Key, path: Word, index: Word, purpose: Word) -> tuple[float, float, float, float]:
    """Four independent standard normals.

    Parameters
    ----------
    key : Key
        Of the run.
    path : Word
        Number of the path.
    index : Word
        Position in the substream, below 2^56.
    purpose : Word
        Substream, below 2^8.

    Returns
    -------
    z0, z1, z2, z3 : float

    Examples
    --------
    >>> key, u = key_of(np.random.SeedSequence(7)), np.uint64
    >>> normals(key, u(0), u(0), u(STEP)) == normals(key, u(0), u(0), u(STEP))
    True
    >>> normals(key, u(0), u(0), u(STEP)) == normals(key, u(1), u(0), u(STEP))
    False
    """
    return _four(key, path, index, purpose)


@lean
def fill_normals(key: Key, paths: NDArray[np.uint64], index: Word, lanes: int, z: NDArray[np.float64]) -> None:
    """Four standard normals of every lane for one index of the substream `STEP`; vectorises.

    Parameters
    ----------
    key : Key
        Of the run.
    paths : ndarray of Word, shape (lanes or more,)
        Number of the path in each lane.
    index : Word
        Position in the substream.
    lanes : int
        Number of lanes.
    z : ndarray, shape (4, lanes or more)
        Output.
    """
    z0, z1, z2, z3 = z[0], z[1], z[2], z[3]
    for p in range(lanes):
        z0[p], z1[p], z2[p], z3[p] = _four(key, paths[p], index, Word(STEP))


@inlined
def bits_of(key: Key, path: Word, index: Word) -> Word:
    """Sixty-four random bits for one index of the substream `STEP`.

    Parameters
    ----------
    key : Key
        Of the run.
    path : Word
        Number of the path.
    index : Word
        Position in the substream, below 2^56.

    Returns
    -------
    Word
    """
    a, b, _, _ = words(key, path, index, Word(STEP))
    return (a << HALF) | b


@inlined
def sign_of(bits: Word, place: int) -> float:
    """Two-point increment +1 or -1 from one bit; its first three moments are those of a standard normal.

    Parameters
    ----------
    bits : Word
        Random bits.
    place : int
        Which of the 64 bits.

    Returns
    -------
    float
    """
    return 1.0 - 2.0 * np.float64(np.int64((bits >> Word(place)) & Word(1)))


@lean
def fill_words(key: Key, paths: NDArray[Word], index: Word, lanes: int, out: NDArray[Word]) -> None:
    """Sixty-four random bits of every lane for one index of the substream `STEP`; vectorises.

    Parameters
    ----------
    key : Key
        Of the run.
    paths : ndarray of Word
        Number of the path in each lane.
    index : Word
        Position in the substream.
    lanes : int
        Number of lanes.
    out : ndarray of Word
        Output.
    """
    for p in range(lanes):
        out[p] = bits_of(key, paths[p], index)


@lean
def fill_signs(bits: NDArray[Word], place: int, lanes: int, z: NDArray[np.float64]) -> None:
    """Two-point increments of every lane; vectorises.

    Parameters
    ----------
    bits : ndarray of Word
        Random bits of each lane.
    place : int
        Which of the 64 bits.
    lanes : int
        Number of lanes.
    z : ndarray
        Output: +1 or -1.
    """
    for p in range(lanes):
        z[p] = sign_of(bits[p], place)
