"""What a result that was put to the test is: numbers beside their truths, and negative controls that must not pass."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from scipy import stats

__all__ = ["FALSE_ALARM", "Check", "Measured", "NegativeControl", "PublishedResult", "limit"]

FALSE_ALARM = 1e-3
"""Chance that any check of a whole run of a correct program fails."""


class Check(NamedTuple):
    """A number of the program beside its truth.

    Attributes
    ----------
    quantity : str
        What it is.
    found, truth : float
    se : float
        Standard error of `found`; 0 where nothing is random.
    slack : float
        Bound of what the method leaves beside sampling: of a step, of a truncation, of rounding.

    Examples
    --------
    >>> check = Check("mean", 1.02, 1.0, se=0.01, slack=0.001)
    >>> round(check.z, 3), check.holds(2.0)
    (1.9, True)
    """

    quantity: str
    found: float
    truth: float
    se: float = 0.0
    slack: float = 0.0

    @property
    def z(self) -> float:
        """What lies beyond the slack, in standard errors; infinite where nothing is random."""
        beyond = abs(self.found - self.truth) - self.slack
        if beyond <= 0.0:
            return 0.0
        return beyond / self.se if self.se > 0.0 else math.inf

    def holds(self, allowed: float) -> bool:
        """Whether it is within so many standard errors; never if it is not a number."""
        return self.z <= allowed and math.isfinite(self.found)


class NegativeControl(NamedTuple):
    """Checks with an error in the truth or in the scene: at least one of them must fail.

    Attributes
    ----------
    error : str
        What was planted.
    checks : sequence of Check
    """

    error: str
    checks: Sequence[Check]

    def rejected(self, allowed: float) -> bool:
        """Whether the error was seen."""
        return not all(check.holds(allowed) for check in self.checks)


class Measured(NamedTuple):
    """What a result's function hands over; `Result` is this and the verdict.

    Attributes
    ----------
    name, reference, statement : str
        The result, who published it, and what is computed with which part of the program.
    checks : sequence of Check
    planted : sequence of NegativeControl
    """

    name: str
    reference: str
    statement: str
    checks: Sequence[Check]
    controls: Sequence[NegativeControl]


def limit(checks: int) -> float:
    """Standard errors allowed to each of so many checks, for `FALSE_ALARM` over all (Bonferroni).

    Examples
    --------
    >>> round(limit(1), 2), round(limit(50), 2)
    (3.29, 4.26)
    """
    return float(stats.norm.isf(0.5 * FALSE_ALARM / max(checks, 1)))


@dataclass(frozen=True)
class PublishedResult:
    """A result, and whether the program obeys it.

    Attributes
    ----------
    measured : Measured
    allowed : float
        Standard errors that each check may be off by.
    seconds : float
        Wall time it took.

    Examples
    --------
    >>> checks = [Check("mean", 1.02, 1.0, 0.01)]
    >>> wrong = NegativeControl("5 % more", [Check("mean", 1.02, 1.05, 0.01)])
    >>> result = Result(Measured("a result", "", "", checks, [wrong]), 2.5, 0.1)
    >>> result.holds, result.rejects
    (True, True)
    """

    measured: Measured
    allowed: float
    seconds: float

    @property
    def worst(self) -> Check:
        """The check that is nearest to failing."""
        return max(self.measured.checks, key=lambda check: (not check.holds(self.allowed), check.z))

    @property
    def obeyed(self) -> bool:
        """Whether all checks hold."""
        return all(check.holds(self.allowed) for check in self.measured.checks)

    @property
    def rejects(self) -> bool:
        """Whether every negative control is seen."""
        return all(controls.rejected(self.allowed) for controls in self.measured.controls)

    @property
    def holds(self) -> bool:
        """Whether all checks hold and every negative control is seen."""
        return self.obeyed and self.rejects

    def to_dict(self) -> dict[str, Any]:
        """Plain data; `found`, `truth`, `se`, `slack` and `z` are those of the worst check."""
        m = self.measured
        return {
            "name": m.name, "reference": m.reference, "statement": m.statement, **_plain(self.worst),
            "allowed": self.allowed, "holds": self.holds, "checks": [_plain(check) for check in m.checks],
            "controls": [{"error": p.error, "rejected": p.rejected(self.allowed)} for p in m.controls],
            "seconds": self.seconds,
        }  # fmt: skip


def _plain(check: Check) -> dict[str, Any]:
    z = check.z
    return check._asdict() | {"z": z if math.isfinite(z) else None}
