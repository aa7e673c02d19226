"""The outcome of the checks of published results, as a text table and as plain data."""

from collections.abc import Sequence
from typing import Any

from rattle.compare.checks.published.result import FALSE_ALARM, Check, PublishedResult

HEAD = ("result", "check nearest to failing", "found", "truth", "se", "z", "controls", "s", "verdict")
LEFT = {0, 1, 8}  # columns with left alignment


def lines(results: Sequence[PublishedResult], *, all_checks: bool = False) -> list[str]:
    """Format the outcome as an aligned table with one row per result, the failures below it, and a summary.

    `all_checks`: Whether to list every check and every negative control below the table, not only failures.

    Examples
    --------
    >>> from rattle.compare.checks.published.run import check_results
    >>> for line in lines(check_results(["exponent-sum"]))[-1:]:
    ...     print(line.split(";")[0])
    1 of 1 results hold
    """
    rows = [HEAD, *(_row(result) for result in results)]
    width = [max(len(row[i]) for row in rows) for i in range(len(HEAD))]
    aligned = [
        [c.ljust(w) if i in LEFT else c.rjust(w) for i, (c, w) in enumerate(zip(r, width, strict=True))] for r in rows
    ]
    out = ["  ".join(row).rstrip() for row in aligned]
    out.insert(1, "-" * max(map(len, out)))
    for result in results:
        out += _details(result, all_checks)
    return [*out, _sentence(results)]


def _row(result: PublishedResult) -> tuple[str, ...]:
    m, worst = result.measured, result.worst
    seen = sum(p.rejected(result.allowed) for p in m.controls)
    return (
        m.name,
        worst.quantity,
        f"{worst.found:.6g}",
        f"{worst.truth:.6g}",
        *_error(worst),
        f"{seen} of {len(m.controls)}",
        f"{result.seconds:.1f}",
        "holds" if result.holds else "FAILS",
    )


def _error(check: Check) -> tuple[str, str]:
    """Standard error and z as text; without randomness, the bound of the systematic error and a dash."""
    return (f"{check.se:.2g}", f"{check.z:.2f}") if check.se > 0.0 else (f"<{check.slack:.1g}", "-")


def _details(result: PublishedResult, everything: bool) -> list[str]:
    m = result.measured
    shown = [c for c in m.checks if everything or not c.holds(result.allowed)]
    controls = [p for p in m.controls if everything or not p.rejected(result.allowed)]
    if not shown and not controls:
        return []
    out = ["", f"{m.name} ({m.reference}): {m.statement}"]
    for c in shown:
        se, z = _error(c)
        left = f", {c.slack:.2g} left by the method" if c.se > 0.0 and c.slack > 0.0 else ""
        verdict = "holds" if c.holds(result.allowed) else "FAILS"
        out.append(f"  {verdict}  {c.quantity}: {c.found:.8g}, truth {c.truth:.8g}, se {se}, z {z}{left}")
    return out + [
        f"  negative control: {p.error}: {'rejected' if p.rejected(result.allowed) else 'NOT REJECTED'}"
        for p in controls
    ]


def _sentence(results: Sequence[PublishedResult]) -> str:
    checks = [c for result in results for c in result.measured.checks]
    controls = [p.rejected(result.allowed) for result in results for p in result.measured.controls]
    return (
        f"{sum(result.holds for result in results)} of {len(results)} results hold; {len(checks)} checks, "
        f"{sum(c.se > 0.0 for c in checks)} of them statistical, each allowed {results[0].allowed:.2f} standard errors "
        f"(false alarm {FALSE_ALARM:g} over all); {sum(controls)} of {len(controls)} negative controls rejected; "
        f"{sum(result.seconds for result in results):.0f} s."
    )


def record(results: Sequence[PublishedResult], seed: int) -> dict[str, Any]:
    """Convert the outcome to plain data.

    Examples
    --------
    >>> from rattle.compare.checks.published.run import check_results
    >>> record(check_results(["exponent-sum"]), seed=0)["holds"]
    True
    """
    return {
        "holds": all(result.holds for result in results),
        "false_alarm": FALSE_ALARM,
        "seed": seed,
        "seconds": sum(result.seconds for result in results),
        "results": [result.to_dict() for result in results],
    }
