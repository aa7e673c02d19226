"""What every closure hands over: means and covariances just before each impact, and between them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Trace"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Trace:
    """One closure followed through its impacts; index 0 of every array is the start.

    Attributes
    ----------
    tau : ndarray, shape (impacts + 1,)
        Mean impact times, counted from the start's phase (`Scene.phase`); NaN beyond `found`.
    mesh, side : ndarray of int, shape (impacts + 1,)
        Where the closure has its impacts.
    mean : ndarray, shape (impacts + 1, 4)
        ``E[X_s]`` just before the impact, in the order ``x1, y1, x2, y2``.
    sd : ndarray, shape (impacts + 1, 6)
        What the closure calls the standard deviations of ``tau, flight, x1, y1, x2, y2``; NaN where it
        predicts none, or where its variance is negative.
    skew : ndarray, shape (impacts + 1, 6)
        Skewness of the same; NaN where the closure predicts none, or where the cube of the sd is no float.
    covariance : ndarray, shape (impacts + 1, 4, 4)
        Of the perturbation just before the impact; NaN where the closure has no such moment.
    raw : ndarray, shape (impacts + 1, 2, order + 1, order + 1)
        Raw moments of each stage's perturbation just before the impact.
    parts : dict of int to (weights, means, variances), optional
        The mixture behind each impact, over ``tau, flight, x1, y1, x2, y2``; None where one Gaussian is all there is.
    agreement, lost : ndarray, shape (impacts + 1,), optional
        Share of paths that the closure expects on the orbit's itinerary so far, and the weight it has lost.
    at : callable
        ``at(time) -> (mean, covariance)`` between impacts, the time counted likewise.
    found : int
        Impacts that could be evaluated.
    stopped : str
        Why it ended early, or an empty string.
    until : float, optional
        Last time of which `at` can tell; the mean time of the last impact by default.
    """

    tau: Floats
    mesh: Ints
    side: Ints
    mean: Floats
    sd: Floats
    skew: Floats
    covariance: Floats
    raw: Floats
    at: Callable[[float], tuple[Floats, Floats]]
    found: int
    stopped: str
    parts: dict[int, tuple[Floats, Floats, Floats]] | None = None
    until: float | None = None
    agreement: Floats | None = None
    lost: Floats | None = None

    @property
    def span(self) -> tuple[float, float]:
        """The times between which `at` can tell."""
        return float(self.tau[0]), float(self.tau[self.found]) if self.until is None else self.until
