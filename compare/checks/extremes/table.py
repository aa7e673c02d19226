"""The table of extremes as text."""

from collections.abc import Sequence

from rattle.compare.checks.extremes.row import Extreme

HEAD = ("extreme", "field", "worst", "allowed", "relative to", "verdict")
RIGHT = {2, 3}  # columns with right alignment


def lines(rows: Sequence[Extreme], *, ranges: bool = False) -> list[str]:
    """Format rows as an aligned table with a summary.

    `ranges`: Whether to print range and reference below each row, not only below those that fail.

    Examples
    --------
    >>> for line in lines([Extreme("E", "beta", "0 to 1e3", "mpmath", 2e-16, 4e-15, "its value")]):
    ...     print(line)
    extreme  field    worst  allowed  relative to  verdict
    ------------------------------------------------------
    E        beta   2.0e-16  4.0e-15  its value    holds
    1 of 1 extreme-value checks passed.
    """
    cells = [HEAD, *(_row(row) for row in rows)]
    width = [max(len(c[i]) for c in cells) for i in range(len(HEAD))]
    aligned = [
        "  ".join(t.rjust(w) if i in RIGHT else t.ljust(w) for i, (t, w) in enumerate(zip(c, width, strict=True)))
        for c in cells
    ]
    out = [aligned[0].rstrip(), "-" * max(len(line.rstrip()) for line in aligned)]
    for row, line in zip(rows, aligned[1:], strict=True):
        out.append(line.rstrip())
        if ranges or not row.holds:
            out.append(f"    {row.tried}; against: {row.truth}")
    return [*out, f"{sum(row.holds for row in rows)} of {len(rows)} extreme-value checks passed."]


def _row(row: Extreme) -> tuple[str, ...]:
    if row.unit == "z":
        errors = f"{row.worst:.2f}", f"{row.allowed:.2f}", "standard errors"
    else:
        errors = f"{row.worst:.1e}", f"{row.allowed:.1e}", row.unit
    return row.name, row.field, *errors, "holds" if row.holds else "FAILS"
