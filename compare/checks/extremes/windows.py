"""Window means of the Edgeworth series and second moments: far tails, narrow windows, correlations close to 1."""

from collections.abc import Iterator

import numpy as np

from rattle.closure import edgeworth
from rattle.compare.checks.extremes import truth
from rattle.compare.checks.extremes.extreme import extreme, farthest, spread
from rattle.scene import moments

ORDER = 6


def _series(seed: int) -> np.ndarray:
    a = np.zeros((ORDER + 1, ORDER + 1))
    rng = np.random.default_rng(seed)
    for i in range(ORDER + 1):
        a[i, : ORDER + 1 - i] = rng.normal(size=ORDER + 1 - i) * 0.3 ** (i + 1)
    a[0, 0] = 1.0
    return a


@extreme(
    "window means (Eqs. 20, 21)",
    "sigma, gap",
    "1e-12 to 30 sds wide, up to 50 sds away",
    "integration by parts in 400 digits",
    unit="the sum of its terms",
)
def edgeworth_windows() -> Iterator[float]:
    """Window means of Eqs. 20 and 21."""
    for n, middle in enumerate([0.0, 1e-9, 0.3, -2.0, 8.0, -20.0, 35.0]):
        for width in spread(1e-12, 30.0, 8):
            a, sd = _series(n), 10.0 ** (n - 3)
            low, high = middle - 0.5 * width, middle + 0.5 * width
            exact, size = _by_parts(a, low * sd / sd, high * sd / sd)
            found = edgeworth.window_means(a, sd, 2.0 * sd, low * sd, high * sd)
            condition = 1.0 + abs(middle) * (abs(middle) + width)  # of the density, since the edges are rounded
            condition += abs(middle) / width  # of the width, since both edges are rounded
            sds = np.array([sd, 2.0 * sd])
            yield farthest(found, sds * exact, sds * size * condition)


@truth.in_digits
def _by_parts(a: np.ndarray, low: float, high: float) -> tuple[list[float], list[float]]:
    integral, size = truth.normal_integrals(low, high, ORDER + 1)
    hermite = edgeworth.HERMITE
    values, sizes = [0.0, 0.0], [0.0, 0.0]
    for i in range(ORDER + 1):
        for n in range(i + 1):
            values[0] += a[i, 0] * hermite[i, n] * integral[n + 1]
            sizes[0] += abs(a[i, 0] * hermite[i, n]) * size[n + 1]
            if i < ORDER:
                values[1] += a[i, 1] * hermite[i, n] * integral[n]
                sizes[1] += abs(a[i, 1] * hermite[i, n]) * size[n]
    return [float(v) for v in values], [float(v) for v in sizes]


@extreme(
    "correlation, eigenvalue, realizability",
    "sigma, gap",
    "1 - |rho| 1e-12 to 1, both signs; units 1e-16 to 1e8",
    "eigenvalues in 400 digits",
    unit="1, and the smaller variance",
)
def correlations() -> Iterator[float]:
    """Correlations close to 1, smallest eigenvalues and realizability, in any units."""
    for unit in spread(1e-16, 1e8, 7):
        none = np.array([[0.0, 1e-3 * unit], [1e-3 * unit, 1.0]])  # no variance, yet a covariance
        yield np.inf if moments.realizability(none).realizable else 0.0
        for distance in spread(1e-12, 1.0, 7):
            for beyond in (False, True):
                rho = 1.0 + distance if beyond else 1.0 - distance
                covariance = np.array([[unit * unit, rho * unit], [rho * unit, 1.0]])
                judged = moments.realizability(covariance)
                least = _least(covariance)
                yield farthest(judged.rho, 1.0 if beyond and distance < moments.ROUNDING else rho, 1.0)
                yield farthest(judged.smallest_eigenvalue, least, min(unit, 1.0) ** 2)
                if distance > moments.ROUNDING and judged.realizable == beyond:
                    yield np.inf
                if distance < moments.ROUNDING and not judged.realizable:
                    yield np.inf


@truth.in_digits
def _least(covariance: np.ndarray) -> float:
    import mpmath as mp

    a, b, d = mp.mpf(covariance[0, 0]), mp.mpf(covariance[0, 1]), mp.mpf(covariance[1, 1])
    return float((a + d) / 2 - mp.sqrt(((a - d) / 2) ** 2 + b * b))


ROWS = (edgeworth_windows, correlations)
