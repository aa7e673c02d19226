"""The summary of a session's checks at its end."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rattle.compare.validation.verdict import BY_SIZE

__all__ = ["decided_by", "summary_lines"]


def decided_by(paths: float) -> str:
    """Describe what would decide an undecided test.

    Parameters
    ----------
    paths : float
        Number of paths that would; infinite if no number would.

    Returns
    -------
    str

    Examples
    --------
    >>> decided_by(141_234.0)
    '140,000 paths would decide'
    """
    if math.isfinite(paths):
        return f"{float(f'{paths:.2g}'):,.0f} paths would decide"
    return "no number of paths would decide; a smaller step may, or another tolerance"


def summary_lines(records: Sequence[tuple[str, Mapping[str, Any]]]) -> Iterator[str]:
    """Format the summary.

    Parameters
    ----------
    records : sequence of (str, mapping)
        The id of each test, and what its fixture has recorded.

    Yields
    ------
    str
        Lines of text.

    Examples
    --------
    >>> facts = {"kind": "check", "model": "corrected", "rows": 4, "failed": 1, "undecided": 0, "z": 3.2905}
    >>> facts |= {"all_rows": 10, "looks": 40, "rate": 0.01, "drawn": 2, "computed": 1, "seconds": 1.5, "decide": 0.0}
    >>> facts |= {"folder": "cache", "not_judged": 1, "by_size": 2}
    >>> print("\\n".join(summary_lines([("test_a", facts)])))
    checks     4 rows in 1 test: 3 passed, 1 failed, 0 undecided
    not judged 1 row more: a displacement at the mesh that most simulated paths strike is the wall itself
    by size    2 of the rows: sd is 0, or below what doubles resolve: compared with 1e-06 of the quantity's size
    intervals  3.29 standard errors, for a false-alarm rate of 0.01 over up to 40 looks at the 10 rows collected
    ensembles  1 simulated in 1.5 s, 1 from the cache cache

    >>> facts = {"kind": "long check", "model": "saltation", "rows": 2, "failed": 0, "undecided": 1, "z": 3.2905}
    >>> facts |= {"drawn": 3, "computed": 3, "seconds": 1.5, "periods": 1024, "decide": 4123.0, "folder": "cache"}
    >>> print("\\n".join(summary_lines([("test_b", facts)])))
    long run   2 rows in 1 test: 1 passed, 0 failed, 1 undecided
    intervals  3.29 standard errors in the long run
    long runs  3 simulated in 1.5 s, 0 from the cache cache
    undecided  test_b (saltation) after 1,024 periods: 4,100 periods would decide
    """
    checks = [(test, facts) for test, facts in records if facts["kind"] == "check"]
    if checks:
        rows, failed, undecided = (sum(f[name] for _, f in checks) for name in ("rows", "failed", "undecided"))
        drawn, computed = (sum(f[name] for _, f in checks) for name in ("drawn", "computed"))
        first = checks[0][1]
        yield (
            f"checks     {rows} rows in {len(checks)} test{'s' * (len(checks) > 1)}: "
            f"{rows - failed - undecided} passed, {failed} failed, {undecided} undecided"
        )
        if spared := sum(f["not_judged"] for _, f in checks):
            yield (
                f"not judged {spared} row{'s' * (spared > 1)} more: a displacement at the mesh that most simulated "
                "paths strike is the wall itself"
            )
        if by_size := sum(f["by_size"] for _, f in checks):
            yield f"by size    {by_size} of the rows: {BY_SIZE}"
        yield (
            f"intervals  {first['z']:.2f} standard errors, for a false-alarm rate of {first['rate']:g} over up to "
            f"{first['looks']} looks at the {first['all_rows']} rows collected"
        )
        yield (
            f"ensembles  {computed} simulated in {sum(f['seconds'] for _, f in checks):.1f} s, "
            f"{drawn - computed} from the cache {first['folder']}"
        )
    for test, facts in checks:
        if facts["undecided"]:
            yield f"undecided  {test} ({facts['model']}) after {facts['paths']:,} paths: {decided_by(facts['decide'])}"
    yield from _long_lines([(test, facts) for test, facts in records if facts["kind"] == "long check"])
    compared = [(test, facts["done"]) for test, facts in records if facts["kind"] == "baseline"]
    if compared:
        written = [done for _, done in compared if done]
        yield f"baselines  {len(compared) - len(written)} as recorded, {len(written)} written"
        for done in written:
            yield from (f"           {line}" for line in done.splitlines())


def _long_lines(checks: Sequence[tuple[str, Mapping[str, Any]]]) -> Iterator[str]:
    """The same of the checks of the long run."""
    if not checks:
        return
    rows, failed, undecided = (sum(f[name] for _, f in checks) for name in ("rows", "failed", "undecided"))
    drawn, computed = (sum(f[name] for _, f in checks) for name in ("drawn", "computed"))
    widths = sorted({f"{f['z']:.2f}" for _, f in checks}, key=float)
    yield (
        f"long run   {rows} rows in {len(checks)} test{'s' * (len(checks) > 1)}: "
        f"{rows - failed - undecided} passed, {failed} failed, {undecided} undecided"
    )
    yield f"intervals  {' to '.join(dict.fromkeys((widths[0], widths[-1])))} standard errors in the long run"
    yield (
        f"long runs  {computed} simulated in {sum(f['seconds'] for _, f in checks):.1f} s, "
        f"{drawn - computed} from the cache {checks[0][1]['folder']}"
    )
    for test, facts in checks:
        if facts["undecided"]:
            periods = facts["decide"]
            known = math.isfinite(periods)
            more = f"{float(f'{periods:.2g}'):,.0f} periods would" if known else "no number of periods would"
            yield f"undecided  {test} ({facts['model']}) after {facts['periods']:,} periods: {more} decide"
