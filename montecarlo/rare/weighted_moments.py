"""Means and standard deviations of weighted paths, unbiased, with standard errors."""

import numpy as np
from numpy.typing import NDArray

from rattle.scene.compiled import jit

Floats = NDArray[np.float64]

ORDERS = 8  # sums of w d^o for o = 0, 1, 2 and of w^2 d^o for o = 0 ... 4


@jit
def add(rows: Floats, weights: Floats, centre: Floats, sums: Floats) -> None:
    """Add paths of one part to its sums.

    Shapes: `rows` (paths, impacts, columns); `weights` (paths, impacts); `centre` (impacts, 6); `sums` (impacts,
    6, ORDERS).
    """
    for p in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            w = weights[p, k]
            for q in range(sums.shape[1]):
                d, s = rows[p, k, q] - centre[k, q], sums[k, q]
                first, square = w * d, w * w
                s[0] += w
                s[1] += first
                s[2] += first * d
                for o in range(5):
                    s[3 + o] += square
                    square *= d


def moments(parts: Floats, counts: Floats, centre: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Means and standard deviations with their standard errors.

    Each part has a fixed number of independent paths, so that variances are added within parts.  The estimates of the
    mean ``sum w d / n`` and of the variance ``sum w d^2 / n - m^2 + var(m)`` are unbiased.

    Shapes: `parts` (parts, impacts, 6, ORDERS); `counts` (parts,); `centre` (impacts, 6); result (impacts, 6).
    """
    n = counts[:, None, None]
    whole, total = parts.sum(axis=0) / counts.sum(), counts.sum()
    m = whole[..., 1]

    def error(sum_of_squares: Floats, sums: Floats) -> Floats:
        """Variance of the mean over all paths, from the sums of each part."""
        within = (sum_of_squares - sums**2 / n) * n / (n - 1.0)
        result: Floats = within.sum(axis=0) / total**2
        return result

    of_mean = error(parts[..., 5], parts[..., 1])
    variance = np.maximum(whole[..., 2] - m**2 + of_mean, 0.0)
    of_variance = error(
        parts[..., 7] - 4.0 * m * parts[..., 6] + 4.0 * m**2 * parts[..., 5], parts[..., 2] - 2.0 * m * parts[..., 1]
    )
    sd = np.sqrt(variance)
    with np.errstate(invalid="ignore", divide="ignore"):
        return centre + m, np.sqrt(of_mean), sd, np.sqrt(of_variance) / (2.0 * sd)
