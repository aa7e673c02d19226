"""The result that every closure returns: means and covariances just before each impact, and between impacts."""

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
        Mean impact times in local time (`Scene.phase`); NaN beyond `found`.
    mesh, side : ndarray of int, shape (impacts + 1,)
        Mesh and flank of each impact; 0 beyond `found`.
    mean : ndarray, shape (impacts + 1, 4)
        Mean state just before the impact, in the order ``x1, y1, x2, y2``.
    sd : ndarray, shape (impacts + 1, 6)
        Predicted standard deviations of ``tau, flight, x1, y1, x2, y2``; NaN where the closure predicts none, or
        where its variance is negative.
    skew : ndarray, shape (impacts + 1, 6)
        Skewness of the same; NaN where the closure predicts none, or where the cube of the sd underflows.
    covariance : ndarray, shape (impacts + 1, 4, 4)
        Covariance of the perturbation just before the impact; NaN where the closure has no such moment.
    raw : ndarray, shape (impacts + 1, 2, order + 1, order + 1)
        Raw moments of each stage's perturbation just before the impact.
    parts : dict of int to (weights, means, variances), optional
        Components of the mixture at each impact, over ``tau, flight, x1, y1, x2, y2``; None if the closure is a single
        Gaussian.
    agreement, discarded : ndarray, shape (impacts + 1,), optional
        Predicted share of paths that have followed the orbit's itinerary so far, and the probability discarded so far;
        of the branching closure only.
    error : ndarray, shape (impacts + 1, 2, 6), optional
        The same closure's bounds of its own errors of mean and sd of ``tau, flight, x1, y1, x2, y2``, in sds; NaN where
        none is made.
    slow : ndarray, shape (impacts + 1,), optional
        The same closure's mean share of the squared impact speed that the noise of one flight makes.
    carried : ndarray, shape (impacts + 1, 6), optional
        The same, as a mean over the variance of each section quantity: what slow impacts carry of it.
    residual : ndarray, shape (impacts + 1,), optional
        What splitting its components further would be worth, by its own measure.
    work : int, optional
        How many flights of components the same closure computed.
    at : callable
        ``at(time) -> (mean, covariance)`` at a fixed local time between impacts.
    found : int
        Number of impacts that could be evaluated.
    stopped : str
        Why it ended early, or an empty string.
    until : float, optional
        Last local time at which `at` can be evaluated; the mean time of the last impact by default.
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
    discarded: Floats | None = None
    error: Floats | None = None
    slow: Floats | None = None
    carried: Floats | None = None
    residual: Floats | None = None
    work: int = 0

    @property
    def span(self) -> tuple[float, float]:
        """First and last local time at which `at` can be evaluated."""
        return float(self.tau[0]), float(self.tau[self.found]) if self.until is None else self.until
