"""The summary of a session's checks at its end."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rattle.compare.validation.section_errors import BY_SIZE

WIDER = 1.1
"""Ratio of an interval to that of all paths above which it is said what widened it."""


def describe_remedy(paths: float) -> str:
    """Describe what would decide an undecided test.

    Examples
    --------
    >>> describe_remedy(141_234.0)
    '140,000 paths would decide'
    """
    if math.isfinite(paths):
        return f"{float(f'{paths:.2g}'):,.0f} paths would decide"
    return "no number of paths would decide; a smaller step may, or another tolerance"


def summary_lines(records: Sequence[tuple[str, Mapping[str, Any]]]) -> Iterator[str]:
    """Lines of the summary, from the id of each test and what its fixture has recorded.

    Examples
    --------
    >>> facts = {"kind": "check", "model": "corrected", "rows": 4, "failed": 1, "undecided": 0, "z": 3.2905}
    >>> facts |= {"widened": 3.2905, "rate": 0.01, "drawn": 2, "computed": 1, "seconds": 1.5, "decide": 0.0}
    >>> facts |= {"folder": "cache", "not_judged": 1, "by_size": 2, "size": "2,048 paths"}
    >>> print("\\n".join(summary_lines([("test_a", facts)])))
    checks     4 rows in 1 test: 3 passed, 1 failed, 0 undecided
    excluded   1 row more (at the wall): displacements that are the position of the wall
    by size    2 of the rows: sd is 0, or too small for doubles: compared with 1e-06 of the quantity's size
    intervals  3.29 standard errors, so that a test whose claim is true fails with a probability of at most 0.01
    ensembles  1 simulated in 1.5 s, 1 from the cache cache

    >>> facts |= {"kind": "long check", "rows": 2, "failed": 0, "undecided": 1, "widened": 340.0, "decide": 4123.0}
    >>> facts |= {"folder": "", "not_judged": 0, "by_size": 0, "size": "2,048 paths of 1,024 periods"}
    >>> print("\\n".join(summary_lines([("test_b", facts)])))
    long run   2 rows in 1 test: 1 passed, 0 failed, 1 undecided
    intervals  3.29 standard errors, so that a test whose claim is true fails with a probability of at most 0.01
    widened    up to 340 standard errors where a standard error rests on few paths
    long runs  1 simulated in 1.5 s, 1 from memory; they are kept only with a cache (--rattle-cache)
    undecided  test_b (corrected) after 2,048 paths of 1,024 periods: 4,100 paths would decide
    """
    for kind, title, simulations in (("check", "checks", "ensembles"), ("long check", "long run", "long runs")):
        own = [(test, facts) for test, facts in records if facts["kind"] == kind]
        if own:
            yield from _check_lines(own, title, simulations)
    compared = [(test, facts["done"]) for test, facts in records if facts["kind"] == "baseline"]
    if compared:
        written = [done for _, done in compared if done]
        yield f"baselines  {len(compared) - len(written)} as recorded, {len(written)} written"
        for done in written:
            yield from (f"           {line}" for line in done.splitlines())


def _check_lines(checks: Sequence[tuple[str, Mapping[str, Any]]], title: str, simulations: str) -> Iterator[str]:
    """The same of one kind of checks."""
    rows, failed, undecided = (sum(f[name] for _, f in checks) for name in ("rows", "failed", "undecided"))
    drawn, computed = (sum(f[name] for _, f in checks) for name in ("drawn", "computed"))
    rate, folder = checks[0][1]["rate"], checks[0][1]["folder"]
    yield (
        f"{title:10} {rows} rows in {len(checks)} test{'s' * (len(checks) > 1)}: "
        f"{rows - failed - undecided} passed, {failed} failed, {undecided} undecided"
    )
    if excluded := sum(f["not_judged"] for _, f in checks):
        rows_more = f"{excluded} row{'s' * (excluded > 1)} more"
        yield f"excluded   {rows_more} (at the wall): displacements that are the position of the wall"
    if by_size := sum(f["by_size"] for _, f in checks):
        yield f"by size    {by_size} of the rows: {BY_SIZE}"
    widths = sorted({f"{f['z']:.2f}" for _, f in checks}, key=float)
    yield (
        f"intervals  {' to '.join(dict.fromkeys((widths[0], widths[-1])))} standard errors, so that a test whose claim "
        f"is true fails with a probability of at most {rate:g}"
    )
    if any(f["widened"] > WIDER * f["z"] for _, f in checks):
        most = max(f["widened"] for _, f in checks)
        yield f"widened    up to {most:.3g} standard errors where a standard error rests on few paths"
    kept = f"the cache {folder}" if folder else "memory; they are kept only with a cache (--rattle-cache)"
    took = sum(f["seconds"] for _, f in checks)
    yield f"{simulations:10} {computed} simulated in {took:.1f} s, {drawn - computed} from {kept}"
    for test, facts in checks:
        if facts["undecided"] and not facts["failed"]:
            yield f"undecided  {test} ({facts['model']}) after {facts['size']}: {describe_remedy(facts['decide'])}"
