"""Numbers of the installed program with their true values, the verdict on them, and the run of many
such checks.

A subject computes checks, each a number with its truth and tolerance, and negative controls.  Both
published results and extreme values are subjects, and share one table and one JSON.
"""

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from rattle.compare.report.json_text import Facts
from rattle.compare.report.render import render_sentences
from rattle.compare.report.table import align_columns
from rattle.montecarlo.statistics.intervals import widest
from rattle.scene import Scene, choice, count
from rattle.scene.progress import ProgressBar

MOST_FALSE_ALARMS = 1e-3
"""Probability that at least one statistical check in a whole run of a correct program fails."""

HEAD = (
    "result",
    "check nearest to failing",
    "found",
    "truth",
    "se",
    "z",
    "controls",
    "s",
    "verdict",
)
ALIGNMENT = "<<>>>>>><"  # of these columns; numbers stand on the right


class Check(NamedTuple):
    """A number computed by the program, with its true value."""

    quantity: str
    found: float  # computed value; of extreme values, the worst error
    truth: float
    se: float = 0.0  # standard error of `found`; 0 if nothing is random
    # bound of the systematic error: of a time step, of a truncation, of rounding
    slack: float = 0.0

    @property
    def z(self) -> float:
        """Error beyond the slack, in standard errors; infinite for such an error if nothing is
        random."""
        beyond = abs(self.found - self.truth) - self.slack
        if beyond <= 0.0:
            return 0.0
        return beyond / self.se if self.se > 0.0 else math.inf

    def holds(self, allowed: float) -> bool:
        """Whether the error is admissible; false for NaN."""
        return self.z <= allowed and math.isfinite(self.found)

    def to_dict(self) -> Facts:
        """The check as plain data."""
        return self._asdict() | {"z": self.z}


def check_moment(row: Any, column: str, quantity: str, truth: float, slack: float = 0.0) -> Check:
    """Check a moment in a row of moments, whose standard error stands beside it."""
    return Check(quantity, row[column], truth, row[f"se_{column}"], slack)


Checks: TypeAlias = Iterable[Check]
Found: TypeAlias = tuple[Checks, Mapping[str, Checks]]
"""Checks of a subject, and its negative controls by what their error is: checks with a deliberate
error, of which at least one must fail."""


@dataclass(frozen=True)
class Subject:
    """What is checked."""

    name: str
    reference: str  # the publication, or what the numbers are compared with
    # what is computed with which part of the program; of extreme values, their range
    statement: str
    compute: Callable[[int, int], Found]  # with a seed and so many threads
    unit: str = ""  # of extreme values: the size that errors are relative to


class Result(NamedTuple):
    """The checks of a subject, with their verdict."""

    subject: Subject
    checks: Sequence[Check]
    controls: Mapping[str, Sequence[Check]]
    # largest admissible error of each check, in standard errors
    allowed: float
    seconds: float = 0.0  # wall time

    @property
    def worst(self) -> Check:
        """The check with the largest error; one that fails, if any does."""
        return max(self.checks, key=lambda check: (not check.holds(self.allowed), check.z))

    @property
    def rejections(self) -> dict[str, bool]:
        """Whether each negative control is rejected, by its error."""
        return {
            error: not all(c.holds(self.allowed) for c in checks)
            for error, checks in self.controls.items()
        }

    @property
    def holds(self) -> bool:
        """Whether all checks hold and every negative control is rejected."""
        return self.worst.holds(self.allowed) and all(self.rejections.values())

    def to_dict(self) -> Facts:
        """The subject, its worst check and the verdict as plain data, with all ``checks`` and
        ``controls``."""
        about = self.subject
        return {
            "name": about.name,
            "reference": about.reference,
            "statement": about.statement,
            **self.worst.to_dict(),
            "unit": about.unit,
            "allowed": self.allowed,
            "holds": self.holds,
            "checks": [check.to_dict() for check in self.checks],
            "controls": [{"error": e, "rejected": r} for e, r in self.rejections.items()],
            "seconds": self.seconds,
        }


def run_checks(
    subjects: Mapping[str, Subject],
    names: Sequence[str] = (),
    *,
    seed: int = 0,
    workers: int = 2,
) -> list[Result]:
    """Check the subjects of these names, or all; their statistical checks share
    `MOST_FALSE_ALARMS`."""
    count("seed", seed, least=0)
    count("workers", workers)
    results = []
    chosen = [choice("result", name, subjects) for name in dict.fromkeys(names)] or list(subjects)
    for name in (bar := ProgressBar(chosen, label="checks", unit="check", leave=False)):
        bar.set_postfix_str(name)
        started = time.perf_counter()
        checks, controls = subjects[name].compute(seed, workers)
        wrong = {error: list(control) for error, control in controls.items()}
        done = Result(subjects[name], list(checks), wrong, math.nan)
        results.append(done._replace(seconds=time.perf_counter() - started))
    statistical = sum(check.se > 0.0 for result in results for check in result.checks)
    allowed = widest(statistical, MOST_FALSE_ALARMS)
    return [result._replace(allowed=allowed) for result in results]


def bare(**fields: Any) -> Scene:
    """Build a single stage without drive, damping, drag and noise, but for these fields."""
    plain = {"alpha": 0.0, "epsilon": 0.5, "beta1": 0.0, "gamma1": 0.0, "stages": 1}
    return Scene(**(plain | fields))


def farthest(found: ArrayLike, truth: ArrayLike, unit: ArrayLike = 1.0) -> float:
    """Compute the largest absolute error in given units, of which none counts as smaller than
    1e-300."""
    a, b, u = (np.asarray(v, dtype=float) for v in (found, truth, unit))
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    with np.errstate(invalid="ignore", divide="ignore"):
        error = np.where(same, 0.0, np.abs(a - b) / np.maximum(u, 1e-300))
    return float(np.where(np.isnan(error), math.inf, error).max(initial=0.0))


def result_lines(results: Sequence[Result], *, all_checks: bool = False) -> list[str]:
    """Format results: a row for each, the failures below, and a summary.

    `all_checks`: Whether to list every check and every negative control below the table, not only
    failures.
    """
    head, *lines = align_columns([HEAD, *map(_result_row, results)], ALIGNMENT)
    out = [head, "-" * max(map(len, [head, *lines])), *lines]
    for result in results:
        out += _details(result, all_checks)
    checks = [check for result in results for check in result.checks]
    rejections = [rejected for result in results for rejected in result.rejections.values()]
    summary = render_sentences(
        "checks/summary.j2",
        results=results,
        allowed=results[0].allowed,
        false_alarms=MOST_FALSE_ALARMS,
        checks=len(checks),
        statistical=sum(check.se > 0.0 for check in checks),
        rejections=rejections,
    )
    return [*out, *summary]


def _verdict(holds: bool) -> str:
    """A verdict in a word."""
    return "holds" if holds else "FAILS"


def _result_row(result: Result) -> tuple[str, ...]:
    """The cells of a result under `HEAD`."""
    worst = result.worst
    unit = result.subject.unit
    return (
        result.subject.name,
        f"{worst.quantity}, relative to {unit}" if unit else worst.quantity,
        f"{worst.found:.6g}",
        f"{worst.truth:.6g}",
        *_error(worst),
        f"{sum(result.rejections.values())} of {len(result.controls)}",
        f"{result.seconds:.1f}",
        _verdict(result.holds),
    )


def _error(check: Check) -> tuple[str, str]:
    """Standard error and z as text; without randomness, the bound of the systematic error and a
    dash."""
    return (f"{check.se:.2g}", f"{check.z:.2f}") if check.se > 0.0 else (f"<{check.slack:.2g}", "-")


def _details(result: Result, everything: bool) -> list[str]:
    """The checks that fail and the negative controls that are not rejected, or all of them."""
    out = []
    for c in result.checks:
        if everything or not c.holds(result.allowed):
            se, z = _error(c)
            left = f", {c.slack:.2g} left by the method" if c.se > 0.0 and c.slack > 0.0 else ""
            numbers = f"{c.found:.8g}, truth {c.truth:.8g}, se {se}, z {z}{left}"
            out.append(f"  {_verdict(c.holds(result.allowed))}  {c.quantity}: {numbers}")
    for error, rejected in result.rejections.items():
        if everything or not rejected:
            out.append(f"  negative control: {error}: {'rejected' if rejected else 'NOT REJECTED'}")
    about = result.subject
    return ["", f"{about.name} ({about.reference}): {about.statement}", *out] if out else []


def results_record(results: Sequence[Result], seed: int) -> Facts:
    """Results as plain data."""
    return {
        "holds": all(result.holds for result in results),
        "false_alarm": MOST_FALSE_ALARMS,
        "seed": seed,
        "seconds": sum(result.seconds for result in results),
        "results": [result.to_dict() for result in results],
    }
