"""The accuracy that a long run reached, and that which it was asked for."""

from __future__ import annotations

import math
from typing import NamedTuple

from rattle.montecarlo.long_run.estimates import StationaryEstimate
from rattle.scene.text import duration_text


class LongReach(NamedTuple):
    """The accuracy that a long run reached, compared with the accuracy asked for."""

    asked: float  # largest half width of the 95 % intervals over their value
    worst: str  # the quantity whose interval is widest
    width: float  # half width of its interval over its value
    more_seconds: float  # estimated time that is missing; 0 where the accuracy was reached

    @property
    def reached(self) -> bool:
        """Whether all intervals that were asked for are within the accuracy."""
        return self.width <= self.asked

    @property
    def sentence(self) -> str:
        """What was reached, as text."""
        found = f"the widest interval is ± {self.width:.2g} of its value ({self.worst})"
        if self.reached:
            return f"Accuracy {self.asked:g} reached: {found}."
        more = f"{duration_text(self.more_seconds)} of processor time more"
        return f"Accuracy {self.asked:g} NOT reached within the budget: {found}; about {more} would do."


def widest(found: dict[str, StationaryEstimate]) -> tuple[float, str]:
    """Find the widest interval."""
    widths = {
        name: 0.0 if e.se == 0.0 else 0.5 * (e.high - e.low) / abs(e.value) if e.value != 0.0 else math.inf
        for name, e in found.items()
    }
    worst = max(widths, key=lambda name: (not math.isfinite(widths[name]), widths[name]))
    return (widths[worst] if math.isfinite(widths[worst]) else math.inf), worst
