"""The outcome of checks as text for a terminal, and as plain data."""

from collections.abc import Sequence
from typing import Any

from rattle.compare.checks.check import FALSE_ALARM, Check, Result

PUBLISHED = ("result", "check nearest to failing", "found", "truth", "se", "z", "controls", "s", "verdict")
EXTREME = ("extreme", "field", "worst", "allowed", "relative to", "verdict")
NUMBERS = {"found", "truth", "se", "z", "controls", "s", "worst", "allowed"}  # columns with right alignment


def align(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """An aligned table: its head, a rule, and a line for each row."""
    width = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    right = [name in NUMBERS for name in head]
    lines = [
        "  ".join(c.rjust(w) if r else c.ljust(w) for c, w, r in zip(row, width, right, strict=True)).rstrip()
        for row in (head, *rows)
    ]
    return [lines[0], "-" * max(map(len, lines)), *lines[1:]]


def verdict(holds: bool) -> str:
    """A verdict in a word."""
    return "holds" if holds else "FAILS"


def published_lines(results: Sequence[Result], *, all_checks: bool = False) -> list[str]:
    """Format published results: a row for each, the failures below, and a summary.

    `all_checks`: Whether to list every check and every negative control below the table, not only failures.
    """
    out = align(PUBLISHED, [_published_row(result) for result in results])
    for result in results:
        out += _details(result, all_checks)
    checks = [check for result in results for check in result.checks]
    rejections = [rejected for result in results for rejected in result.rejections.values()]
    summary = (
        f"{sum(result.holds for result in results)} of {len(results)} results hold; {len(checks)} checks, "
        f"{sum(c.se > 0.0 for c in checks)} of them statistical, each allowed {results[0].allowed:.2f} standard errors "
        f"(false alarm {FALSE_ALARM:g} over all); {sum(rejections)} of {len(rejections)} negative controls rejected; "
        f"{sum(result.seconds for result in results):.0f} s."
    )
    return [*out, summary]


def _published_row(result: Result) -> tuple[str, ...]:
    worst = result.worst
    rejected = f"{sum(result.rejections.values())} of {len(result.controls)}"
    numbers = f"{worst.found:.6g}", f"{worst.truth:.6g}", *_error(worst), rejected, f"{result.seconds:.1f}"
    return result.name, worst.quantity, *numbers, verdict(result.holds)


def _error(check: Check) -> tuple[str, str]:
    """Standard error and z as text; without randomness, the bound of the systematic error and a dash."""
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


def published_record(results: Sequence[Result], seed: int) -> dict[str, Any]:
    """Published results as plain data."""
    return {
        "holds": all(result.holds for result in results),
        "false_alarm": FALSE_ALARM,
        "seed": seed,
        "seconds": sum(result.seconds for result in results),
        "results": [result.to_dict() for result in results],
    }


def extreme_record(result: Result) -> dict[str, Any]:
    """A check at extreme values as plain data."""
    worst = result.worst
    row = {"name": result.name, "field": worst.quantity, "tried": result.statement, "truth": result.reference}
    return row | {"worst": worst.found, "allowed": result.allowed, "unit": result.unit, "holds": result.holds}


def worst_error(result: Result) -> tuple[str, str, str]:
    """The worst error at extreme values and its bound as texts, and what they are relative to."""
    if result.unit == "z":
        return f"{result.worst.found:.2f}", f"{result.allowed:.2f}", "standard errors"
    return f"{result.worst.found:.1e}", f"{result.allowed:.1e}", result.unit


def extreme_lines(results: Sequence[Result], *, ranges: bool = False) -> list[str]:
    """Format checks at extreme values: a row for each, and a summary.

    `ranges`: Whether to print range and reference below each row, not only below those that fail.

    Examples
    --------
    >>> E = Result("E", "mpmath", "0 to 1e3", [Check("beta", 2e-16, 0.0, slack=4e-15)], {}, 4e-15, "its value")
    >>> for line in extreme_lines([E]):
    ...     print(line)
    extreme  field    worst  allowed  relative to  verdict
    ------------------------------------------------------
    E        beta   2.0e-16  4.0e-15  its value    holds
    1 of 1 extreme-value checks passed.
    """
    rows = [(r.name, r.worst.quantity, *worst_error(r), verdict(r.holds)) for r in results]
    head, rule, *aligned = align(EXTREME, rows)
    out = [head, rule]
    for result, line in zip(results, aligned, strict=True):
        out.append(line)
        if ranges or not result.holds:
            out.append(f"    {result.statement}; against: {result.reference}")
    return [*out, f"{sum(result.holds for result in results)} of {len(results)} extreme-value checks passed."]
