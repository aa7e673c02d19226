"""A path within a step, as every scheme hands it over."""

from typing import NamedTuple

__all__ = ["MOST_IN_A_STEP", "Noise", "Progress", "Walls"]

MOST_IN_A_STEP = 64
"""Impacts of one path within one step; beyond, the mesh stays closed to the end of the step, which is counted."""


class Noise(NamedTuple):
    """Brownian motion over a time: its increment, and its area ``int (s / h - 1/2) dB``, of variance h / 12.

    The schemes of Euler and Maruyama know the increment alone and leave the area zero.
    """

    increment: float
    area: float


class Walls(NamedTuple):
    """Distances of a path's four flanks from the middle."""

    high1: float
    low1: float
    high2: float
    low2: float


class Progress(NamedTuple):
    """A path within a step: how far it has come, and what it meets there.

    ``code`` is ``mesh * side`` of an impact that is due at this very state, or 0.  ``left`` is the time to the end of
    the step, ``noise`` that of the time left.
    """

    code: int
    tau: float
    left: float
    noise: Noise
    x1: float
    y1: float
    x2: float
    y2: float
