"""What a self-test found, as text for a terminal and as plain data."""

from collections.abc import Sequence
from typing import Any

from rattle.compare.checks.laws.law import FALSE_ALARM, Check, Law

__all__ = ["lines", "record"]

HEAD = ("law", "check nearest to failing", "found", "truth", "se", "z", "planted", "s", "verdict")
LEFT = {0, 1, 8}  # columns that are aligned to the left


def lines(laws: Sequence[Law], *, all_checks: bool = False) -> list[str]:
    """An aligned table with one row per law, what failed below it, and a sentence on the whole.

    With `all_checks`, every check and every planted error has its line.

    Examples
    --------
    >>> from rattle.compare.checks.laws.run import selftest
    >>> for line in lines(selftest(["exponent-sum"]))[-1:]:
    ...     print(line.split(";")[0])
    1 of 1 laws hold
    """
    rows = [HEAD, *(_row(law) for law in laws)]
    width = [max(len(row[i]) for row in rows) for i in range(len(HEAD))]
    aligned = [
        [c.ljust(w) if i in LEFT else c.rjust(w) for i, (c, w) in enumerate(zip(r, width, strict=True))] for r in rows
    ]
    out = ["  ".join(row).rstrip() for row in aligned]
    out.insert(1, "-" * max(map(len, out)))
    for law in laws:
        out += _details(law, all_checks)
    return [*out, _sentence(laws)]


def _row(law: Law) -> tuple[str, ...]:
    m, worst = law.measured, law.worst
    seen = sum(p.rejected(law.allowed) for p in m.planted)
    return (
        m.name, worst.quantity, f"{worst.found:.6g}", f"{worst.truth:.6g}", *_error(worst),
        f"{seen} of {len(m.planted)}", f"{law.seconds:.1f}", "holds" if law.holds else "FAILS",
    )  # fmt: skip


def _error(check: Check) -> tuple[str, str]:
    """Standard error and z; for what is not random, the bound in place of the first."""
    return (f"{check.se:.2g}", f"{check.z:.2f}") if check.se > 0.0 else (f"<{check.slack:.1g}", "-")


def _details(law: Law, everything: bool) -> list[str]:
    m = law.measured
    shown = [c for c in m.checks if everything or not c.holds(law.allowed)]
    planted = [p for p in m.planted if everything or not p.rejected(law.allowed)]
    if not shown and not planted:
        return []
    out = ["", f"{m.name} ({m.reference}): {m.statement}"]
    for c in shown:
        se, z = _error(c)
        left = f", {c.slack:.2g} left by the method" if c.se > 0.0 and c.slack > 0.0 else ""
        verdict = "holds" if c.holds(law.allowed) else "FAILS"
        out.append(f"  {verdict}  {c.quantity}: {c.found:.8g}, truth {c.truth:.8g}, se {se}, z {z}{left}")
    return out + [f"  planted: {p.error}: {'rejected' if p.rejected(law.allowed) else 'NOT SEEN'}" for p in planted]


def _sentence(laws: Sequence[Law]) -> str:
    checks = [c for law in laws for c in law.measured.checks]
    planted = [p.rejected(law.allowed) for law in laws for p in law.measured.planted]
    return (
        f"{sum(law.holds for law in laws)} of {len(laws)} laws hold; {len(checks)} checks, "
        f"{sum(c.se > 0.0 for c in checks)} of them statistical, each allowed {laws[0].allowed:.2f} standard errors "
        f"(false alarm {FALSE_ALARM:g} over all); {sum(planted)} of {len(planted)} planted errors rejected; "
        f"{sum(law.seconds for law in laws):.0f} s."
    )


def record(laws: Sequence[Law], seed: int) -> dict[str, Any]:
    """Everything as plain data.

    Examples
    --------
    >>> from rattle.compare.checks.laws.run import selftest
    >>> record(selftest(["exponent-sum"]), seed=0)["holds"]
    True
    """
    return {
        "holds": all(law.holds for law in laws), "false_alarm": FALSE_ALARM, "seed": seed,
        "seconds": sum(law.seconds for law in laws), "laws": [law.to_dict() for law in laws],
    }  # fmt: skip
