"""The result that every closure returns: means and covariances just before each impact, and between impacts."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Trace:
    """One closure followed through its impacts; index 0 of every array is the start."""

    tau: Floats  # mean impact times in local time (`Scene.phase`); NaN beyond `found`; (impacts + 1,)
    mesh: Ints  # mesh, side: mesh and flank of each impact; 0 beyond `found`; (impacts + 1,)
    side: Ints
    mean: Floats  # mean state just before the impact, in the order ``x1, y1, x2, y2``; (impacts + 1, 4)
    # predicted standard deviations of ``tau, flight, x1, y1, x2, y2``; NaN where the closure predicts none, or where
    # its variance is negative; (impacts + 1, 6)
    sd: Floats
    # skewness of the same; NaN where the closure predicts none, or where the cube of the sd underflows; (impacts + 1,
    # 6)
    skew: Floats
    # covariance of the perturbation just before the impact; NaN where the closure has no such moment; (impacts + 1,
    # 4, 4)
    covariance: Floats
    # raw moments of each stage's perturbation just before the impact; (impacts + 1, 2, order + 1, order + 1)
    raw: Floats
    # ``at(time) -> (mean, covariance)`` at a fixed local time between impacts
    at: Callable[[float], tuple[Floats, Floats]]
    found: int  # number of impacts that could be evaluated
    stopped: str  # why it ended early, or an empty string
    # components of the mixture at each impact, over ``tau, flight, x1, y1, x2, y2``; None if the closure is a single
    # Gaussian
    parts: dict[int, tuple[Floats, Floats, Floats]] | None = None
    # last local time at which `at` can be evaluated; the mean time of the last impact by default
    until: float | None = None
    # agreement, discarded: predicted share of paths that have followed the orbit's itinerary so far, and the
    # probability discarded so far; of the branching closure only; (impacts + 1,)
    agreement: Floats | None = None
    discarded: Floats | None = None
    # the same closure's bounds of its own errors of mean and sd of ``tau, flight, x1, y1, x2, y2``, in sds; NaN where
    # none is made; (impacts + 1, 2, 6)
    error: Floats | None = None
    # the same closure's mean share of the squared impact speed that the noise of one flight makes; (impacts + 1,)
    slow: Floats | None = None
    # the same, as a mean over the variance of each section quantity: what slow impacts carry of it; (impacts + 1, 6)
    carried: Floats | None = None
    # what splitting its components further would be worth, by its own measure; (impacts + 1,)
    residual: Floats | None = None
    work: int = 0  # how many flights of components the same closure computed

    @property
    def span(self) -> tuple[float, float]:
        """First and last local time at which `at` can be evaluated."""
        return float(self.tau[0]), float(self.tau[self.found]) if self.until is None else self.until
