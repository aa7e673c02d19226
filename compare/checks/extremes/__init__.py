"""Checks at extreme parameter values against independent references: limits, published results, and
exact scaling relations."""

import math
from collections.abc import Callable, Iterable

from rattle.compare.checks.check import Check, Found, Subject
from rattle.compare.checks.extremes import runs
from rattle.compare.report.texts import read_texts


def extreme(
    errors: Callable[[], Iterable[float]], quantity: str, allowed: float, **texts: str
) -> Subject:
    """Make the check that the worst of some errors is admissible; NaN is the worst."""

    def compute(seed: int, workers: int) -> Found:
        sizes = (math.inf if math.isnan(error) else error for error in errors())
        return [Check(quantity, max(sizes, default=math.inf), 0.0, slack=allowed)], {}

    return Subject(compute=compute, **texts)


EXTREMES = {
    name: extreme(getattr(runs, name), **texts)
    for name, texts in read_texts("checks.extremes").items()
}
"""Every check by the name of its function."""
