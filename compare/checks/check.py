"""Numbers of the installed program with their true values, the verdict on them, and the run of many
such checks.

A subject is a function of seed and threads that returns a `Result`: checks, each a number with its
truth and tolerance, and negative controls.  `extreme` makes one of a function that yields errors.
"""

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from rattle.compare.report.texts import read_texts
from rattle.scene import Scene, choice, count
from rattle.scene.progress import ProgressBar

MOST_FALSE_ALARMS = 1e-3
"""Probability that at least one statistical check in a whole run of a correct program fails."""
FORMULA_ROUNDING = 4e-15
"""A few roundings of a double: the default bound where a formula is compared with 400-digit
arithmetic."""

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

    # description of the number; of extreme values, the fields of the scene that are extreme
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


class Result(NamedTuple):
    """The checks of one subject, with their verdict."""

    name: str
    reference: str  # the publication, or what the numbers are compared with
    # what is computed with which part of the program; of extreme values, their range
    statement: str
    checks: Sequence[Check]
    # negative controls: checks with a deliberate error, of which at least one must fail, by what
    # the error is
    controls: Mapping[str, Sequence[Check]] = {}
    # largest admissible error of each check, in standard errors; NaN where it depends on the other
    # checks of the run
    allowed: float = math.nan
    # of extreme values: the size that errors are relative to, or "z" for standard errors
    unit: str = ""
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

    def to_dict(self) -> dict[str, Any]:
        """The worst check and the verdict as plain data, with lists of all ``checks`` and
        ``controls``."""
        found = {
            name: getattr(self, name) for name in ("name", "reference", "statement")
        } | _to_dict(self.worst)
        controls = [
            {"error": error, "rejected": rejected} for error, rejected in self.rejections.items()
        ]
        found |= {
            "allowed": self.allowed,
            "holds": self.holds,
            "checks": [_to_dict(check) for check in self.checks],
        }
        return found | {"controls": controls, "seconds": self.seconds}


def _to_dict(check: Check) -> dict[str, Any]:
    return check._asdict() | {"z": check.z if math.isfinite(check.z) else None}


Found: TypeAlias = tuple[Iterable[Check], Mapping[str, Iterable[Check]]]
"""Checks of a subject, and its negative controls by what their error is."""
Subject: TypeAlias = Callable[[int, int], Result]
"""Computes the result of a subject with a seed and so many threads."""


def limit(checks: int) -> float:
    """Compute the admissible error of each check in standard errors, for `MOST_FALSE_ALARMS` over
    all (Bonferroni)."""
    return float(-ndtri(0.5 * MOST_FALSE_ALARMS / max(checks, 1)))


def run_checks(
    subjects: Mapping[str, Subject],
    names: Sequence[str] = (),
    *,
    seed: int = 0,
    workers: int = 2,
    progress: str | None = None,
) -> list[Result]:
    """Check the subjects of these names, or all; those without a bound of their own share `limit`
    of their checks.

    `progress`: Label of a progress bar.
    """
    count("seed", seed, least=0)
    count("workers", workers)
    found = []
    chosen = [choice("result", name, subjects) for name in dict.fromkeys(names)] or list(subjects)
    for name in (bar := ProgressBar(chosen, label=progress, unit="check", leave=False)):
        bar.set_postfix_str(name)
        started = time.perf_counter()
        found.append(subjects[name](seed, workers)._replace(seconds=time.perf_counter() - started))
    allowed = limit(sum(check.se > 0.0 for result in found for check in result.checks))
    return [
        result._replace(allowed=allowed) if math.isnan(result.allowed) else result
        for result in found
    ]


EXTREMES = read_texts("checks.extremes")
CHECK_TEXTS = read_texts("checks.published")
"""What is said of each check at extreme values, and of each published result, by the name of its
function."""


def extreme(
    allowed: float = FORMULA_ROUNDING, **texts: str
) -> Callable[[Callable[[], Iterable[float]]], Subject]:
    """Decorate a function that yields errors, so that it returns the check of the worst of them;
    NaN is the worst.

    `allowed`: The largest admissible error. `texts`: As in `EXTREMES`, for a function that is not
    there.
    """

    def make(errors: Callable[[], Iterable[float]]) -> Subject:
        said = {"unit": "its value"} | (texts or EXTREMES[errors.__name__])

        @wraps(errors)
        def check(seed: int = 0, workers: int = 1) -> Result:
            bound = {"se": 1.0} if said["unit"] == "z" else {"slack": allowed}
            largest = max(
                (math.inf if math.isnan(error) else error for error in errors()), default=math.inf
            )
            worst = Check(said["field"], largest, 0.0, **bound)
            return Result(
                said["name"],
                said["truth"],
                said["tried"],
                [worst],
                allowed=allowed,
                unit=said["unit"],
            )

        return check

    return make


def self_test(compute: Callable[[int, int], Found]) -> Subject:
    """Decorate a function that computes checks and negative controls, so that it returns them as a
    result."""

    @wraps(compute)
    def check(seed: int = 0, workers: int = 2) -> Result:
        checks, controls = compute(seed, workers)
        own = {error: list(wrong) for error, wrong in controls.items()}
        return Result(**CHECK_TEXTS[compute.__name__], checks=list(checks), controls=own)

    return check


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


def spread(low: float, high: float, count: int, *also: float) -> list[float]:
    """List logarithmically spaced values, preceded by others."""
    return [*also, *(float(v) for v in np.geomspace(low, high, count))]


def verdict(holds: bool) -> str:
    """A verdict in a word."""
    return "holds" if holds else "FAILS"


def result_lines(results: Sequence[Result], *, all_checks: bool = False) -> list[str]:
    """Format results: a row for each, the failures below, and a summary.

    `all_checks`: Whether to list every check and every negative control below the table, not only
    failures.
    """
    rows = [HEAD, *map(_result_row, results)]
    width = [max(map(len, column)) for column in zip(*rows, strict=True)]
    head, *lines = (
        "  ".join(f"{c:{a}{w}}" for c, a, w in zip(row, ALIGNMENT, width, strict=True)).rstrip()
        for row in rows
    )
    out = [head, "-" * max(map(len, [head, *lines])), *lines]
    for result in results:
        out += _details(result, all_checks)
    checks = [check for result in results for check in result.checks]
    rejections = [rejected for result in results for rejected in result.rejections.values()]
    bounds = {
        r.allowed for r in results if r.controls and any(check.se > 0.0 for check in r.checks)
    }
    each = (
        f", each allowed {bounds.pop():.2f} standard errors"
        f" (false alarm {MOST_FALSE_ALARMS:g} over all)"
        if bounds
        else ""
    )
    summary = (
        f"{sum(result.holds for result in results)} of {len(results)} results hold; {len(checks)}"
        f" checks, {sum(c.se > 0.0 for c in checks)} of them statistical{each}; {sum(rejections)}"
        f" of {len(rejections)} negative controls rejected;"
        f" {sum(result.seconds for result in results):.0f} s."
    )
    return [*out, summary]


def _result_row(result: Result) -> tuple[str, ...]:
    worst = result.worst
    rejected = f"{sum(result.rejections.values())} of {len(result.controls)}"
    numbers = (
        f"{worst.found:.6g}",
        f"{worst.truth:.6g}",
        *_error(worst),
        rejected,
        f"{result.seconds:.1f}",
    )
    relative = f", relative to {result.unit}" if result.unit not in ("", "z") else ""
    return result.name, worst.quantity + relative, *numbers, verdict(result.holds)


def _error(check: Check) -> tuple[str, str]:
    """Standard error and z as text; without randomness, the bound of the systematic error and a
    dash."""
    return (f"{check.se:.2g}", f"{check.z:.2f}") if check.se > 0.0 else (f"<{check.slack:.1g}", "-")


def _details(result: Result, everything: bool) -> list[str]:
    """The checks that fail and the negative controls that are not rejected, or all of them."""
    out = []
    for c in result.checks:
        if everything or not c.holds(result.allowed):
            se, z = _error(c)
            left = f", {c.slack:.2g} left by the method" if c.se > 0.0 and c.slack > 0.0 else ""
            numbers = f"{c.found:.8g}, truth {c.truth:.8g}, se {se}, z {z}{left}"
            out.append(f"  {verdict(c.holds(result.allowed))}  {c.quantity}: {numbers}")
    for error, rejected in result.rejections.items():
        if everything or not rejected:
            out.append(f"  negative control: {error}: {'rejected' if rejected else 'NOT REJECTED'}")
    return ["", f"{result.name} ({result.reference}): {result.statement}", *out] if out else []


def results_record(results: Sequence[Result], seed: int) -> dict[str, Any]:
    """Results as plain data."""
    return {
        "holds": all(result.holds for result in results),
        "false_alarm": MOST_FALSE_ALARMS,
        "seed": seed,
        "seconds": sum(result.seconds for result in results),
        "results": [result.to_dict() for result in results],
    }


def extreme_record(result: Result) -> dict[str, Any]:
    """A check at extreme values as plain data."""
    worst = result.worst
    row = {
        "name": result.name,
        "field": worst.quantity,
        "tried": result.statement,
        "truth": result.reference,
    }
    return row | {
        "worst": worst.found,
        "allowed": result.allowed,
        "unit": result.unit,
        "holds": result.holds,
    }
