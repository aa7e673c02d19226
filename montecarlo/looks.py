"""When a growing sample is looked at, and what every look may get wrong: the one engine of all that
adds paths, or periods, until something is decided.

Sizes that are fixed beforehand are those of `Looks`, a size that follows from what was seen that of
`grow`.  The probability of a wrong statement is shared by all looks and all rows (Bonferroni).
Therefore looks may be left out depending on earlier ones, and the first decision on a row is final.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from rattle.montecarlo.kernel.blocks import Budget, clock
from rattle.montecarlo.statistics.intervals import CONFIDENCE, TOO_FEW
from rattle.scene import duration_text, positive

USUAL_LOOKS = 2
"""Looks after which a run to an accuracy ends as a rule."""

LEAST_GROWTH = 1.1  # factor for a sample that was expected to suffice, and did not

LEAST_COST = 1e-12  # core-seconds, of what costs nothing

BUDGET_ENDED = "the budget ended"
"""Why something stays undecided, besides too few paths (`TOO_FEW`)."""


def share_of_look(look: int) -> float:
    """Probability of a wrong statement that a look may spend where the number of looks is open;
    over all looks they add up to 1 - `CONFIDENCE`."""
    return (1.0 - CONFIDENCE) / (look * (look + 1.0))


def begin_budget(seconds: float | None) -> Budget:
    """The budget that a user gives in seconds, from now on; without an end where none is given."""
    return Budget(math.inf if seconds is None else float(positive("budget", seconds)))


class CountedWork:
    """What is left of a budget for work that is counted beforehand, so that no clock decides how
    much is computed.

    `budget`: core-seconds of all. `left`: those that are left to plan. `reduced`: what is smaller
    than asked for, in words.
    """

    def __init__(self, budget: float, share: float) -> None:
        self.budget = budget
        self.left = share * budget
        self.reduced: list[str] = []

    def fit(self, what: str, wanted: int, fewest: int, cost: float, room: float) -> int:
        """As many as fit some room at a cost of each, the fewest in any case, which are charged."""
        affordable = int(min(max(room, 0.0) / max(cost, LEAST_COST), wanted))
        number = max(min(wanted, fewest), affordable)
        self.left -= number * cost
        if number < wanted:
            self.reduced.append(f"{number:,} of {wanted:,} {what}")
        return number

    def describe(self) -> str:
        """What the budget has cut, as a sentence; empty if nothing."""
        if not self.reduced or math.isinf(self.budget):
            return ""
        seconds = duration_text(self.budget)
        cut = ", ".join(self.reduced)
        return (
            f"Within the budget of {seconds} of processor time: {cut}. A larger one (`--budget`,"
            " `budget=`) gives more."
        )


@dataclass
class Looks:
    """Sizes, fixed beforehand, at which a sample is looked at, as long as another look may decide.

    Whoever iterates leaves the loop once all is decided; after its last pass something is undecided
    because of `why`.
    """

    sizes: Sequence[int]
    # size below which a sample says only roughly how many would decide, and does not end the looks
    rough: int = 0
    # whether the last size is looked at although more are expected to be needed, and sizes that are
    # expected to be too small are left out
    use_all: bool = False
    budget: Budget | None = None  # time after which there is no further look
    # of what is left of the budget, which a look may be expected to take from the look before it
    share: float = 1.0
    why: str = TOO_FEW

    def __iter__(self) -> Iterator[int]:
        self._later = list(self.sizes)
        pace = 0.0  # processor time of a unit of size
        while self._later:
            if self.budget is not None:
                allowed = self.share * self.budget.remaining
                if allowed <= 0.0 or pace * self._later[0] > allowed:
                    self.why = BUDGET_ENDED
                    return
            self._size = self._later.pop(0)
            began = clock()
            yield self._size
            pace = (clock() - began) / max(self._size, 1)

    def expect(self, needed: float) -> None:
        """Choose the next look by the size that is expected to decide; NaN where no size does."""
        last = self.sizes[-1]
        if self.use_all:
            self._later = [size for size in self._later if size >= min(needed, last)]
        elif not needed <= last and self._size >= self.rough:
            self._later.clear()

    def repeat(self, least: int) -> None:
        """Look at another sample of this size, or of the first one that is not below `least`."""
        self._later = [size for size in (self._size, *self._later) if size >= least]


def ladder(first: int, most: int, factor: int = 2) -> tuple[int, ...]:
    """Sizes from the first on, as many times the one before as `factor` says, up to the largest."""
    sizes = [first]
    while sizes[-1] < most:
        sizes.append(min(factor * sizes[-1], most))
    return tuple(sizes)


def grow(size: int, needed: float, spare: float, grain: int = 1) -> int:
    """The size of the next look at a sample that is too small: as many times what is expected to
    suffice as `spare` says, in whole grains."""
    return math.ceil(max(spare * needed, LEAST_GROWTH * size) / grain) * grain


def order_ends_first(values: Sequence[float]) -> list[float]:
    """Values such that what a budget leaves out is spread evenly: both ends, then the middle of the
    widest gap."""
    order = [0, len(values) - 1]
    while len(order) < len(values):
        gaps = [(b - a, a + b) for a, b in pairwise(sorted(order))]
        order.append(max(gaps)[1] // 2)
    return [values[k] for k in order[: len(values)]]
