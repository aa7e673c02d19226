"""Names of the quantities and moments that closures and simulation share, and when moments are
realizable."""

import math
from typing import NamedTuple, TypeVar

import numpy as np

from rattle.scene.compiled import internal, jit
from rattle.scene.elementary import powers
from rattle.scene.linear_algebra import eigen, product
from rattle.scene.types import Floats

Number = TypeVar("Number", float, Floats)

RHO_ROUNDING = 1e-9  # relative tolerance for rounding in |rho| <= 1 and in Cholesky pivots
# smallest variance, or power of an sd, that has all its digits and may be a divisor
SMALLEST_DIVISOR = 1e-290
# a variance below this times the square of its largest term is rounding
LOST_VARIANCE = 4.0 * 2.0**-52


class Realizability(NamedTuple):
    """Whether a 2 x 2 covariance of displacement and velocity can belong to a distribution."""

    realizable: bool  # the verdict
    reason: str  # what fails; empty if realizable
    variance_x: float  # variance_x, variance_y: diagonal of the covariance
    variance_y: float
    rho: float  # correlation; NaN if a variance is not positive
    smallest_eigenvalue: float  # of the covariance; NaN if it is not finite


def correlation(covariance: Floats) -> float:
    """Correlation ``rho`` of a 2 x 2 covariance; what is beyond 1 by rounding alone is 1.

    Shapes: `covariance` (2, 2).
    """
    if not (covariance[0, 0] > 0.0 and covariance[1, 1] > 0.0):
        return float("nan")
    rho = float(covariance[0, 1] / np.sqrt(covariance[0, 0]) / np.sqrt(covariance[1, 1]))
    return rho if abs(rho) > 1.0 + RHO_ROUNDING else max(-1.0, min(1.0, rho))


def realizability(covariance: Floats) -> Realizability:
    """Judge a 2 x 2 covariance by its variances, ``|rho| <= 1`` and its smallest eigenvalue.

    A point mass (all zero) is realizable.  What fails is named, never clipped.

    Shapes: `covariance` (2, 2).
    """
    vx = float(covariance[0, 0])
    vy = float(covariance[1, 1])
    rho = correlation(covariance)
    if not np.isfinite(covariance).all():
        return Realizability(False, "moments are not finite", vx, vy, rho, float("nan"))
    cross = float(covariance[0, 1])
    smallest = _smallest_eigenvalue(vx, cross, vy)
    reasons = [f"variance of {name} = {v:.3g} < 0" for name, v in (("x", vx), ("y", vy)) if v < 0.0]
    if abs(rho) > 1.0 + RHO_ROUNDING:
        reasons.append(f"|rho| = {abs(rho):.4g} > 1")
    if not reasons and cross != 0.0 and min(vx, vy) == 0.0:
        reasons.append(
            f"covariance = {cross:.3g} beside a variance of 0: smallest eigenvalue ="
            f" {smallest:.3g} < 0"
        )
    return Realizability(not reasons, ", ".join(reasons), vx, vy, rho, smallest)


def _smallest_eigenvalue(vx: float, cross: float, vy: float) -> float:
    """Of a 2 x 2 covariance, as the determinant over the larger eigenvalue: accurate where it is
    relatively small."""
    scale = max(abs(vx), abs(vy), abs(cross))
    if scale == 0.0:
        return 0.0
    a = vx / scale
    b = cross / scale
    d = vy / scale
    mean = 0.5 * (a + d)
    half = math.hypot(0.5 * (a - d), b)
    return scale * (mean - half if mean <= 0.0 else (a * d - b * b) / (mean + half))


def _is_clear(a: Floats, scale: Floats) -> bool:
    """Whether a covariance is positive definite beyond rounding: its variances against `scale`, its
    Cholesky pivots."""
    left = a.copy()
    for j, variance in enumerate(a.diagonal()):
        if variance == 0.0 and not a[j].any():
            continue
        least = max(LOST_VARIANCE * scale[j] * scale[j], SMALLEST_DIVISOR)
        if not (variance > least and left[j, j] > RHO_ROUNDING * variance):
            return False
        column = left[:, j] / math.sqrt(left[j, j])
        left -= np.outer(column, column)
    return True


def semidefinite(covariance: Floats, scale: Floats) -> Floats:
    """The positive semidefinite part of a covariance that was computed as a difference of larger
    ones.

    Variances below the rounding error of their terms become 0, and negative eigenvalues are
    removed.  A covariance that is clearly positive definite is returned as it is, symmetrised.

    Shapes: `covariance` (n, n); `scale` (n,); result (n, n).
    """
    covariance = 0.5 * (covariance + covariance.T)  # rounding is not symmetric
    if _is_clear(covariance, scale) or not np.isfinite(covariance).all():
        return covariance
    resolved = (
        np.diagonal(covariance) > np.maximum(LOST_VARIANCE * scale**2, SMALLEST_DIVISOR)
    ) & (scale > 0.0)
    size = np.where(resolved, scale, 1.0)
    values, vectors = eigen(
        np.where(resolved & resolved[:, None], covariance / size[:, None] / size, 0.0)
    )
    root = size[:, None] * vectors * np.sqrt(np.where(values > 0.0, values, 0.0))
    return np.where(resolved & resolved[:, None], product(root, root.T), 0.0)


@internal
def fill_gaussian_moments(vx: Number, cxy: Number, vy: Number, m: Floats) -> None:
    """`gaussian_raw_moments` into an array of zeros; of several pairs at once, one by one.

    Shapes: `vx`, `cxy`, `vy` (...); `m` (order + 1, order + 1, ...).
    """
    m[0, 0] = 1.0
    for p in range(2, len(m)):
        m[0, p] = (p - 1) * vy * m[0, p - 2]
    for n in range(1, len(m)):
        for p in range(len(m) - n):
            if n >= 2:
                m[n, p] += (n - 1) * vx * m[n - 2, p]
            if p >= 1:
                m[n, p] += p * cxy * m[n - 1, p - 1]


@jit
def gaussian_raw_moments(vx: float, cxy: float, vy: float, order: int) -> Floats:
    """``E[x^n y^p]`` of a centred Gaussian pair for ``n + p <= order``, by Isserlis' theorem as a
    recursion.

    Shapes: result (order + 1, order + 1).
    """
    m = np.zeros((order + 1, order + 1))
    fill_gaussian_moments(vx, cxy, vy, m)
    return m


def central_from_raw(raw: Floats) -> Floats:
    """Central moments from raw moments.

    Shapes: `raw` (orders, ...); result (orders, ...).
    """
    mean = raw[1]
    shift = powers(-raw[1], len(raw))
    terms = (
        [math.comb(p, k) * shift[p - k] * raw[k] for k in range(p + 1)] for p in range(len(raw))
    )
    return np.stack([sum(of_order, start=np.zeros_like(mean)) for of_order in terms])
