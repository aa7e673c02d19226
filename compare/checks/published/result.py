"""Data types of a tested published result: measured numbers with true values, and negative controls."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from scipy.special import ndtri

FALSE_ALARM = 1e-3
"""Probability that at least one check in a whole run of a correct program fails."""


class Check(NamedTuple):
    """A number computed by the program, with its true value.

    Examples
    --------
    >>> check = Check("mean", 1.02, 1.0, se=0.01, slack=0.001)
    >>> round(check.z, 3), check.holds(2.0)
    (1.9, True)
    """

    quantity: str  # description of the number
    found: float  # found, truth: computed and true value
    truth: float
    se: float = 0.0  # standard error of `found`; 0 if nothing is random
    slack: float = 0.0  # bound of the systematic error: of a time step, of a truncation, of rounding

    @property
    def z(self) -> float:
        """Error beyond the slack, in standard errors; infinite for such an error if nothing is random."""
        beyond = abs(self.found - self.truth) - self.slack
        if beyond <= 0.0:
            return 0.0
        return beyond / self.se if self.se > 0.0 else math.inf

    def holds(self, allowed: float) -> bool:
        """Whether the error is admissible; false for NaN."""
        return self.z <= allowed and math.isfinite(self.found)


class NegativeControl(NamedTuple):
    """Checks with a deliberate error in the true value or in the scene: at least one of them must fail."""

    error: str  # description of the error
    checks: Sequence[Check]

    def rejected(self, allowed: float) -> bool:
        """Whether at least one check fails."""
        return not all(check.holds(allowed) for check in self.checks)


class Measured(NamedTuple):
    """The checks of one published result; `PublishedResult` adds the verdict."""

    # name, reference, statement: the result, its publication, and what is computed with which part of the program
    name: str
    reference: str
    statement: str
    checks: Sequence[Check]
    controls: Sequence[NegativeControl]


def limit(checks: int) -> float:
    """Compute the admissible error of each check in standard errors, for `FALSE_ALARM` over all (Bonferroni).

    Examples
    --------
    >>> round(limit(1), 2), round(limit(50), 2)
    (3.29, 4.26)
    """
    return float(-ndtri(0.5 * FALSE_ALARM / max(checks, 1)))


@dataclass(frozen=True)
class PublishedResult:
    """A published result with its verdict.

    Examples
    --------
    >>> checks = [Check("mean", 1.02, 1.0, 0.01)]
    >>> wrong = NegativeControl("5 % more", [Check("mean", 1.02, 1.05, 0.01)])
    >>> result = PublishedResult(Measured("a result", "", "", checks, [wrong]), 2.5, 0.1)
    >>> result.holds, result.rejects
    (True, True)
    """

    measured: Measured
    allowed: float  # largest admissible error of each check, in standard errors
    seconds: float  # wall time of the measurement

    @property
    def worst(self) -> Check:
        """The check with the largest error; one that fails, if any does."""
        return max(self.measured.checks, key=lambda check: (not check.holds(self.allowed), check.z))

    @property
    def obeyed(self) -> bool:
        """Whether all checks hold."""
        return all(check.holds(self.allowed) for check in self.measured.checks)

    @property
    def rejects(self) -> bool:
        """Whether every negative control is rejected."""
        return all(control.rejected(self.allowed) for control in self.measured.controls)

    @property
    def holds(self) -> bool:
        """Whether all checks hold and every negative control is rejected."""
        return self.obeyed and self.rejects

    def to_dict(self) -> dict[str, Any]:
        """Convert to plain data.

        Returns: ``quantity, found, truth, se, slack, z`` of the worst check, lists ``checks`` and ``controls``, and
        more.
        """
        m = self.measured
        return {
            "name": m.name,
            "reference": m.reference,
            "statement": m.statement,
            **_plain(self.worst),
            "allowed": self.allowed,
            "holds": self.holds,
            "checks": [_plain(check) for check in m.checks],
            "controls": [{"error": p.error, "rejected": p.rejected(self.allowed)} for p in m.controls],
            "seconds": self.seconds,
        }


def _plain(check: Check) -> dict[str, Any]:
    z = check.z
    return check._asdict() | {"z": z if math.isfinite(z) else None}
