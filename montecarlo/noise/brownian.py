"""Brownian motion on an interval as its increment and space-time Lévy area: exact splitting and
joining.

On a time h the increment W and the area ``A = int (s / h - 1/2) dB`` are independent with variances
h and h / 12: the first two coefficients of the noise in shifted Legendre polynomials.  (A is minus
the space-time Lévy area of Foster, Lyons and Oberhauser.)  Given both, those of two subintervals
are Gaussian: a rotation of four standard normals.

References
----------
Foster, Lyons and Oberhauser, "An optimal polynomial approximation of Brownian motion" (2020).
"""

import math
from typing import NamedTuple

from rattle.scene.compiled import lean

ROOT12_INVERSE = 1.0 / math.sqrt(12.0)


class Noise(NamedTuple):
    """Brownian motion on a time h."""

    increment: float  # of variance h
    # ``int (s / h - 1/2) dB``, of variance h / 12: minus the space-time Lévy area.  The
    # Euler-Maruyama schemes do not use it and leave it zero
    area: float


@lean
def split(whole: Noise, h: float, share: float, z1: float, z2: float) -> tuple[Noise, Noise]:
    """Noise of the first part of an interval and of the second, conditional on that of the whole.

    `h`, `share`: Length of the interval, and the share of it before the cut, in (0, 1).
    """
    rest = 1.0 - share
    inside = 1.0 - 3.0 * share * rest
    spread = math.sqrt(h * share * rest / inside)
    first = share * (whole.increment - 6.0 * rest * whole.area) + spread * inside * z1
    common = whole.area + 0.5 * spread * z1
    apart = spread * ROOT12_INVERSE * z2
    return (
        Noise(first, share * share * common + rest * apart),
        Noise(whole.increment - first, rest * rest * common - share * apart),
    )


@lean
def join(first: Noise, second: Noise, share: float) -> Noise:
    """Noise of an interval from that of its two parts; the inverse of `split`."""
    rest = 1.0 - share
    return Noise(
        first.increment + second.increment,
        share * first.area
        + rest * second.area
        + 0.5 * (share * second.increment - rest * first.increment),
    )
