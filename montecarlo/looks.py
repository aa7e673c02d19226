"""When a growing sample is looked at, and what every look may get wrong: the one engine of all that
adds paths, or periods, until something is decided.

Sizes that are fixed beforehand are those of `Looks`, sizes that follow from what was seen those of
`Growth`.  The probability of a wrong statement is shared by all looks and all rows (Bonferroni).
Therefore looks may be left out depending on earlier ones, and the first decision on a row is final.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from scipy.special import ndtri

from rattle.montecarlo.kernel.blocks import Budget
from rattle.montecarlo.statistics.intervals import CONFIDENCE
from rattle.scene import positive

FAMILY_ERROR = 0.05
"""Probability that anything of all that is said together is wrong, unless another one is given."""

AGAIN = 0.25
"""Share of the probability of a wrong statement that a second look may add, which decides rows that
wait for a rare branch by other paths, a part of them near it."""

USUAL_LOOKS = 2
"""Looks after which a run to an accuracy ends as a rule."""

LEAST_GROWTH = 1.1
"""Least factor by which a sample grows that is too small: one that is expected to suffice as it is
was misjudged."""

BUDGET_ENDED = "the budget ended"
TOO_FEW = "too few paths to decide"
"""Why something stays undecided."""


def tail_of(checks: int, family_error: float = FAMILY_ERROR) -> float:
    """Probability on either side of each of some simultaneous intervals (Bonferroni)."""
    return 0.5 * family_error / max(checks, 1)


def widest(checks: int, family_error: float = FAMILY_ERROR) -> float:
    """Half width, in standard errors, of simultaneous two-sided normal confidence intervals
    (Bonferroni)."""
    return float(-ndtri(tail_of(checks, family_error)))


def share_of_look(look: int) -> float:
    """Probability of a wrong statement that a look may spend where the number of looks is open;
    over all looks they add up to 1 - `CONFIDENCE`."""
    return (1.0 - CONFIDENCE) / (look * (look + 1.0))


def begin_budget(seconds: float | None) -> Budget:
    """The budget that a user gives in seconds, from now on; without an end where none is given."""
    return Budget(math.inf if seconds is None else float(positive("budget", seconds)))


class Looks:
    """Sizes, fixed beforehand, at which a sample is looked at, as long as another look may decide.

    Whoever iterates leaves the loop once all is decided; after its last pass something is undecided
    because of `why`.

    `rough`: Size below which a sample says only roughly how many would decide, so that it does not
    end the looks. `use_all`: Whether the last size is looked at although more are expected to be
    needed, and sizes that are expected to be too small are left out. `budget`: Time after which
    there is no further look.
    """

    def __init__(
        self,
        sizes: Sequence[int],
        *,
        rough: int = 0,
        use_all: bool = False,
        budget: Budget | None = None,
    ) -> None:
        self.why = TOO_FEW
        self._later = list(sizes)
        self._size = 0
        self._last = sizes[-1]
        self._rough = rough
        self._use_all = use_all
        self._budget = budget

    def __iter__(self) -> Iterator[int]:
        while self._later:
            if self._budget is not None and self._budget.remaining < 0.0:
                self.why = BUDGET_ENDED
                return
            self._size = self._later.pop(0)
            yield self._size

    def expect(self, needed: float) -> None:
        """Choose the next look by the size that is expected to decide; NaN or infinite where no
        size does."""
        if self._use_all:
            enough = [size for size in self._later if size >= needed] or self._later[-1:]
            self._later = enough if needed < math.inf else []
        elif not needed <= self._last and self._size >= self._rough:
            self._later = []

    def repeat(self, least: int) -> None:
        """Look at another sample of this size, or of the first one that is not below `least`."""
        self._later = [size for size in (self._size, *self._later) if size >= least]


class Growth(NamedTuple):
    """How a sample grows whose size follows from what was seen of it."""

    spare: float  # ratio of what is sampled to what is expected to suffice
    most: float  # largest factor by which it grows at once: the spread of heavy tails shows late
    grain: int = 1  # its size is a multiple of that

    def round_up(self, size: float) -> int:
        """The next size that it can have."""
        return math.ceil(size / self.grain) * self.grain

    def want(self, size: int, needed: float) -> float:
        """The size that the next look should suffice with, from the one that is expected to."""
        return max(self.spare * needed, LEAST_GROWTH * size)

    def next_size(self, size: int, needed: float) -> int:
        """The size of the next look."""
        return self.round_up(min(self.want(size, needed), self.most * size))
