"""A check at extreme values: a computation, the range over which it is tried, its worst error and the bound."""

import math
from collections.abc import Callable, Iterable
from functools import wraps

import numpy as np
from numpy.typing import ArrayLike

from rattle.compare.checks.check import Check, Result

ROUNDING = 4e-15
"""A few roundings of a double: the default bound where a formula is compared with 400-digit arithmetic."""


def extreme(
    name: str, field: str, tried: str, truth: str, *, allowed: float = ROUNDING, unit: str = "its value"
) -> Callable[[Callable[[], Iterable[float]]], Callable[..., Result]]:
    """Decorate a function that yields errors, so that it returns the check of the worst of them.

    `field`, `tried`: The fields of the scene that are extreme, and their range. `truth`: The reference. `allowed`: The
    largest admissible error. `unit`: The size that errors are relative to, or "z" for standard errors.

    Examples
    --------
    >>> phi = extreme("phi", "beta", "0 to 1e3", "mpmath")(lambda: [2e-16, 0.0])
    >>> phi().holds, phi().worst.found
    (True, 2e-16)
    """

    def make(errors: Callable[[], Iterable[float]]) -> Callable[..., Result]:
        @wraps(errors)
        def check(seed: int = 0, workers: int = 1) -> Result:
            bound = {"se": 1.0} if unit == "z" else {"slack": allowed}
            worst = Check(field, worst_of(errors()), 0.0, **bound)
            return Result(name, truth, tried, [worst], allowed=allowed, unit=unit)

        return check

    return make


def farthest(found: ArrayLike, truth: ArrayLike, unit: ArrayLike = 1.0) -> float:
    """Compute the largest absolute error in given units.

    Examples
    --------
    >>> farthest([1.0, np.nan], [1.5, np.nan], 2.0), farthest(np.nan, 1.0)
    (0.25, inf)
    """
    a, b, u = (np.asarray(v, dtype=float) for v in (found, truth, unit))
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    with np.errstate(invalid="ignore", divide="ignore"):
        error = np.where(same, 0.0, np.abs(a - b) / u)
    return float(np.where(np.isnan(error), math.inf, error).max(initial=0.0))


def spread(low: float, high: float, count: int, *also: float) -> list[float]:
    """List logarithmically spaced values, preceded by others.

    Examples
    --------
    >>> spread(1e-2, 1e2, 3, 0.0)
    [0.0, 0.01, 1.0, 100.0]
    """
    return [*also, *(float(v) for v in np.geomspace(low, high, count))]


def worst_of(errors: Iterable[float]) -> float:
    """The largest error; infinite if one is NaN."""
    return max((math.inf if math.isnan(e) else e for e in errors), default=math.inf)
