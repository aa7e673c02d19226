"""The messages of a test that fails or stays undecided, the figure that it writes, and the summary
of a session."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from rattle.compare.judge.rows import BY_SIZE
from rattle.compare.study.cells import Sampled
from rattle.compare.thresholds.claim import Claim
from rattle.compare.validation.verdict import DECIDED, Verdict, span
from rattle.scene import line

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDER = 1.1
"""Ratio of an interval to that of all paths above which it is said what widened it."""


PATHS_OF_AN_HOUR = {"check": 1e8, "long check": 1e5}
"""Paths that take about an hour of one core, of a few impacts or of 1,024 periods: more are no
remedy."""


def describe_remedy(paths: float, kind: str) -> str:
    """Describe what would decide an undecided test."""
    if not math.isfinite(paths):
        return "no number of paths would decide; a smaller step may, or another tolerance"
    if paths > PATHS_OF_AN_HOUR[kind]:
        least = f"more than {PATHS_OF_AN_HOUR[kind]:,.0f} paths, an hour or more of one core"
        return (
            f"its error is so close to what is allowed that it takes {least}: another tolerance"
            " decides sooner"
        )
    return f"{float(f'{paths:.2g}'):,.0f} paths would decide"


def count_rows(number: int) -> str:
    """A number of rows in words."""
    return f"{number} row{'s' * (number != 1)}"


def kind_of(table: pd.DataFrame) -> str:
    """Whether the rows of a table are section moments or quantities of the long run."""
    return "check" if "moment" in table else "long check"


def summary_lines(records: Sequence[tuple[str, Mapping[str, Any]]]) -> Iterator[str]:
    """Lines of the summary, from the id of each test and what its fixture has recorded."""
    for kind, title, simulations in (
        ("check", "checks", "ensembles"),
        ("long check", "long run", "long runs"),
    ):
        own = [(test, facts) for test, facts in records if facts["kind"] == kind]
        if own:
            yield from _check_lines(own, title, simulations)
    compared = [(test, facts["done"]) for test, facts in records if facts["kind"] == "baseline"]
    if compared:
        written = [done for _, done in compared if done]
        yield f"baselines  {len(compared) - len(written)} as recorded, {len(written)} written"
        for done in written:
            yield from (f"           {line}" for line in done.splitlines())


def _check_lines(
    checks: Sequence[tuple[str, Mapping[str, Any]]], title: str, simulations: str
) -> Iterator[str]:
    """The same of one kind of checks."""
    facts = pd.DataFrame([f for _, f in checks])
    rows, failed, undecided, drawn, computed = facts[
        ["rows", "failed", "undecided", "drawn", "computed"]
    ].sum()
    rate = facts["rate"][0]
    folder = facts["folder"][0]
    widest = facts["widened"].max()
    yield (
        f"{title:10} {count_rows(rows)} in {len(checks)} test{'s' * (len(checks) > 1)}: "
        f"{rows - failed - undecided} passed, {failed} failed, {undecided} undecided"
    )
    if excluded := int(facts["not_judged"].sum()):
        yield (
            f"excluded   {count_rows(excluded)} more (at the wall): displacements that are the"
            " position of the wall"
        )
    if by_size := facts["by_size"].sum():
        yield f"by size    {by_size} of the rows: {BY_SIZE}"
    yield (
        f"intervals  {span(facts['z'], '.2f')} standard errors, so that a test whose claim is true"
        f" fails with a probability of at most {rate:g}"
    )
    if (facts["widened"] > WIDER * facts["z"]).any():
        yield (
            f"widened    up to {widest:.3g} standard errors where a standard error rests on few"
            " paths"
        )
    kept = (
        f"the cache {folder}"
        if folder
        else "memory; they are kept only with a cache (--rattle-cache)"
    )
    yield (
        f"{simulations:10} {computed} simulated in {facts['seconds'].sum():.1f} s,"
        f" {drawn - computed} from {kept}"
    )
    for test, f in checks:
        if f["undecided"] and not f["failed"]:
            yield (
                f"undecided  {test} ({f['model']}) after {f['size']}:"
                f" {describe_remedy(f['decide'], f['kind'])}"
            )


PATHS_MARGIN = 2.0
"""Factor on the number of paths that should decide a test, since it is computed from an error that
is itself random."""

VERDICT_MARKERS = {
    Verdict.ACCURATE: ("#009E73", "o"),
    Verdict.INACCURATE: ("#D55E00", "X"),
    Verdict.UNDECIDED: ("#000000", "$?$"),
}
"""Colour and marker of each verdict in the figure."""
MOST_ROWS_DRAWN = 60
"""Largest number of rows in the figure; the worst are shown."""
WIDE = 12.0  # ratio of the largest error to the admissible one above which the axis is logarithmic


def _format_signed(value: float) -> str:
    """Four decimals, or an exponent where these would be zeros."""
    return f"{value:+.4f}" if abs(value) >= 1e-3 or value == 0.0 else f"{value:+.0e}"


def row_table(rows: pd.DataFrame) -> str:
    """Format rows as an aligned table, with errors and intervals in sds of the quantity."""
    signed = {"error/sd": "error", "low": "low", "high": "high", "allowed": "tolerance"}
    shown = (
        rows[["predicted", "simulated"]].rename(columns={"predicted": "model"}).map("{:.7g}".format)
    )
    shown = shown.assign(
        **{head: (rows[name] / rows["unit"]).map(_format_signed) for head, name in signed.items()}
    )
    shown["allowed"] = shown["allowed"].str[1:]
    shown["on itinerary"] = rows["agreement"].map("{:.4f}".format)
    names = [
        f"{'E' if r.moment == 'mean' else 'sd'} {r.quantity} at {r.impact}"
        for r in rows.itertuples()
    ]
    return shown.set_axis(names, axis=0).to_string(col_space=8)


def moment_rows(rows: pd.DataFrame, run: Sampled, z: float) -> str:
    """Rows of section moments with their remarks, as a message states them."""
    remarks = "".join(f"{r}\n" for r in dict.fromkeys(rows["remark"]) if r)
    return (
        f"{remarks}{run.paths} paths; intervals of {z:.2f} standard errors; errors in sds of the"
        f" quantity, at each path's own impact\n{row_table(rows)}"
    )


def long_rows(rows: pd.DataFrame, z: float) -> str:
    """Rows of the long run, dimensionless, as a message states them, and what has widened their
    intervals."""
    names = ["unit", "predicted", "simulated", "se", "low", "high", "tolerance", "paths", "periods"]
    shown = (
        rows.set_index("quantity")[names].rename_axis(None).rename(columns={"tolerance": "allowed"})
    )
    wide = [
        f"\n{r['quantity']}: its standard error rests on {r['effective_paths']:.1f} of {r['paths']}"
        f" paths, as with rare bursts; so its interval is {r['widened']:.3g} standard errors on"
        f" either side, not {z:.2f}"
        for r in rows[rows["widened"] > WIDER * z].to_dict("records")
    ]
    return (
        f"intervals of {z:.2f} standard"
        f" errors\n{shown.to_string(float_format='{:.5g}'.format)}{''.join(wide)}"
    )


def failure_text(model: str, table: pd.DataFrame, shown: Callable[[pd.DataFrame], str]) -> str:
    """Say which rows failed; `shown` formats them."""
    failed = table[table["verdict"] == Verdict.INACCURATE]
    undecided = count_undecided(table)
    beside = f", {undecided} undecided" if undecided else ""
    return (
        f"{model} exceeds the allowed error in {len(failed)} of {len(table)}"
        f" rows{beside}\n{shown(failed)}"
    )


def count_undecided(table: pd.DataFrame) -> int:
    """Rows that are neither accurate nor inaccurate."""
    return int((~table["verdict"].isin(DECIDED)).sum())


def paths_to_decide(table: pd.DataFrame) -> float:
    """Estimate the number of paths that would decide every undecided row."""
    undecided = table.loc[~table["verdict"].isin(DECIDED), "paths_needed"]
    return float(undecided.fillna(math.inf).max()) if len(undecided) else 0.0


def describe_undecided(
    model: str, table: pd.DataFrame, shown: Callable[[pd.DataFrame], str]
) -> str:
    """Say which rows are undecided, and how many paths would decide them; `shown` formats them."""
    rows = table[~table["verdict"].isin(DECIDED)]
    decided = describe_remedy(paths_to_decide(table), kind_of(table))
    return f"{model} is undecided in {len(rows)} of {len(table)} rows; {decided}\n{shown(rows)}"


def remedies(table: pd.DataFrame, claim: Claim) -> str:
    """Describe what can be done about undecided rows."""
    needed = PATHS_MARGIN * paths_to_decide(table)
    options = []
    if claim.accuracy is not None and "moment" in table:
        options.append(f"ask for a smaller accuracy than {claim.accuracy:g}")
    elif needed <= PATHS_OF_AN_HOUR[kind_of(table)]:
        options.append(
            f"give it more paths (budget={float(f'{needed:.2g}'):_.0f} in its marker, or"
            " --rattle-budget)"
        )
    if "moment" in table:
        given = " or ".join(
            dict.fromkeys("within" if a.in_sd else "absolute" for a in claim.allowed.values())
        )
        options.append(f"allow a larger error ({given})")
    options.append(
        'accept that it is undecided (undecided="skip" in its marker, or --rattle-undecided=skip)'
    )
    return f"Undecided is not passed: {', or '.join(options)}."


def error_figure(table: pd.DataFrame, model: str) -> "Figure":
    """Draw the error of each row of a claim with its interval and the admissible range, in sds of
    each quantity."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    from rattle.compare.report.style import ACCURATE_COLOUR, STYLE, SYMBOL, new_figure

    excess = (table["error"] / table["tolerance"]).abs()
    rows = table.loc[excess.nlargest(MOST_ROWS_DRAWN).index.sort_values()]
    unit = rows["unit"].to_numpy()
    error, low, high, allowed = (
        rows[c].to_numpy() / unit for c in ("error", "low", "high", "tolerance")
    )
    place = np.arange(len(rows))[::-1]
    figure, (ax,) = new_figure(6.4, 1.5 + 0.2 * len(rows), 1, 1)
    ax.barh(
        place, 2.0 * allowed, left=-allowed, height=0.9, color=ACCURATE_COLOUR, alpha=0.35, lw=0
    )
    verdicts = rows["verdict"].where(rows["verdict"].isin(DECIDED), Verdict.UNDECIDED)
    for verdict, (colour, marker) in VERDICT_MARKERS.items():
        own = (verdicts == verdict).to_numpy()
        ax.hlines(place[own], low[own], high[own], color=colour, lw=1.6)
        ax.plot(error[own], place[own], ls="none", marker=marker, ms=6, color=colour)
    reach = float(np.nanmax(np.abs([low, high, allowed])))
    room = 1.15
    if reach > WIDE * allowed.min():
        ax.set_xscale("symlog", linthresh=2.0 * float(allowed.max()), linscale=2.0)
        room = 2.0
    ax.axvline(0.0, color="0.3", lw=0.8)
    shown = zip(rows["moment"], rows["quantity"], rows["impact"], strict=True)
    ax.set_yticks(
        place, [f"{'E' if m == 'mean' else 'sd'} {SYMBOL[q]}, impact {k}" for m, q, k in shown]
    )
    ax.set(xlim=(-room * reach, room * reach), ylim=(-0.7, len(rows) - 0.3))
    ax.grid(False, axis="y")
    ax.set_xlabel("error and its interval, in sds of the quantity")
    worst = (
        f" (the worst {MOST_ROWS_DRAWN} of {len(table)} rows)"
        if len(table) > MOST_ROWS_DRAWN
        else ""
    )
    colour = STYLE[model]["color"]
    ax.set_title(
        f"{line(model)[:60]}{worst}", loc="left", fontweight="bold", parse_math=False, color=colour
    )
    handles = [
        Line2D([], [], color=colour, marker=marker, ms=6, label=verdict)
        for verdict, (colour, marker) in VERDICT_MARKERS.items()
        if (verdicts == verdict).any()
    ]
    allowance = Patch(color=ACCURATE_COLOUR, alpha=0.35, lw=0, label="allowed")
    figure.legend(handles=[*handles, allowance], loc="outside upper center", ncols=4, frameon=False)
    return figure
