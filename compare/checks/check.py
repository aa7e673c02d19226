"""Numbers of the installed program with their true values, the verdict on them, and the run of many such checks."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from scipy.special import ndtri

from rattle.scene.validate import choice, count

FALSE_ALARM = 1e-3
"""Probability that at least one statistical check in a whole run of a correct program fails."""


class Check(NamedTuple):
    """A number computed by the program, with its true value.

    Examples
    --------
    >>> check = Check("mean", 1.02, 1.0, se=0.01, slack=0.001)
    >>> round(check.z, 3), check.holds(2.0)
    (1.9, True)
    """

    quantity: str  # description of the number; of extreme values, the fields of the scene that are extreme
    found: float  # computed value; of extreme values, the worst error
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


class Result(NamedTuple):
    """The checks of one subject, with their verdict.

    Examples
    --------
    >>> checks = [Check("mean", 1.02, 1.0, 0.01)]
    >>> result = Result("a result", "", "", checks, {"5 % more": [Check("mean", 1.02, 1.05, 0.01)]}, allowed=2.5)
    >>> result.checks_hold, result.rejects, result.holds
    (True, True, True)
    """

    name: str
    reference: str  # the publication, or what the numbers are compared with
    statement: str  # what is computed with which part of the program; of extreme values, their range
    checks: Sequence[Check]
    # negative controls: checks with a deliberate error, of which at least one must fail, by what the error is
    controls: Mapping[str, Sequence[Check]] = {}
    # largest admissible error of each check, in standard errors; NaN where it depends on the other checks of the run
    allowed: float = math.nan
    unit: str = ""  # of extreme values: the size that errors are relative to, or "z" for standard errors
    seconds: float = 0.0  # wall time

    @property
    def worst(self) -> Check:
        """The check with the largest error; one that fails, if any does."""
        return max(self.checks, key=lambda check: (not check.holds(self.allowed), check.z))

    @property
    def checks_hold(self) -> bool:
        """Whether all checks hold."""
        return all(check.holds(self.allowed) for check in self.checks)

    @property
    def rejections(self) -> dict[str, bool]:
        """Whether each negative control is rejected, by its error."""
        return {error: not all(c.holds(self.allowed) for c in checks) for error, checks in self.controls.items()}

    @property
    def rejects(self) -> bool:
        """Whether every negative control is rejected."""
        return all(self.rejections.values())

    @property
    def holds(self) -> bool:
        """Whether all checks hold and every negative control is rejected."""
        return self.checks_hold and self.rejects

    def to_dict(self) -> dict[str, Any]:
        """The worst check and the verdict as plain data, with lists of all ``checks`` and ``controls``."""
        return {
            "name": self.name,
            "reference": self.reference,
            "statement": self.statement,
            **_to_dict(self.worst),
            "allowed": self.allowed,
            "holds": self.holds,
            "checks": [_to_dict(check) for check in self.checks],
            "controls": [{"error": error, "rejected": rejected} for error, rejected in self.rejections.items()],
            "seconds": self.seconds,
        }


def _to_dict(check: Check) -> dict[str, Any]:
    return check._asdict() | {"z": check.z if math.isfinite(check.z) else None}


def limit(checks: int) -> float:
    """Compute the admissible error of each check in standard errors, for `FALSE_ALARM` over all (Bonferroni).

    Examples
    --------
    >>> round(limit(1), 2), round(limit(50), 2)
    (3.29, 4.26)
    """
    return float(-ndtri(0.5 * FALSE_ALARM / max(checks, 1)))


def run_checks(
    subjects: Mapping[str, Callable[[int, int], Result]], names: Sequence[str] = (), *, seed: int = 0, workers: int = 2
) -> list[Result]:
    """Check the subjects of these names, or all; those without a bound of their own share `limit` of their checks."""
    count("seed", seed, least=0)
    count("workers", workers)
    found = []
    for name in [choice("result", name, subjects) for name in dict.fromkeys(names)] or subjects:
        started = time.perf_counter()
        found.append(subjects[name](seed, workers)._replace(seconds=time.perf_counter() - started))
    allowed = limit(sum(check.se > 0.0 for result in found for check in result.checks))
    return [result._replace(allowed=allowed) if math.isnan(result.allowed) else result for result in found]
