"""The messages of a test that fails or stays undecided, the figure that it writes, and the summary
of a session."""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from rattle.compare.judge.verdict import DECIDED, Verdict
from rattle.compare.report.render import render_text
from rattle.compare.report.texts import REPORT_TEXTS
from rattle.compare.study.cells import Sampled
from rattle.compare.thresholds.claim import Claim
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
    return line(render_text("thresholds/remedy.j2", paths=paths, most=PATHS_OF_AN_HOUR[kind]))


def kind_of(table: pd.DataFrame) -> str:
    """Whether the rows of a table are section moments or quantities of the long run."""
    return "check" if "moment" in table else "long check"


PATHS_MARGIN = 2.0
"""Factor on the number of paths that should decide a test, since it is computed from an error that
is itself random."""

VERDICT_MARKERS: dict[str, Any] = REPORT_TEXTS["marks"]["tests"]
"""Colour and marker of each verdict in the figure."""
MOST_ROWS_DRAWN = 60
"""Largest number of rows in the figure; the worst are shown."""
WIDE = 12.0  # ratio of the largest error to the admissible one above which the axis is logarithmic


def _format_signed(value: float) -> str:
    """Four decimals, or an exponent where these would be zeros."""
    return f"{value:+.4f}" if abs(value) >= 1e-3 or value == 0.0 else f"{value:+.0e}"


def name_rows(rows: pd.DataFrame, form: str) -> list[str]:
    """Names of rows of section moments, by a form with their columns."""
    moments = rows["moment"].replace("mean", "E")
    return [form.format_map(row) for row in rows.assign(moment=moments).to_dict("records")]


def row_table(rows: pd.DataFrame) -> str:
    """Format rows as an aligned table, with errors and intervals in sds of the quantity."""
    shown = rows[["predicted", "simulated"]].map("{:.7g}".format)
    errors = rows[["error", "low", "high", "tolerance"]].div(rows["unit"], axis=0)
    shown = shown.join(errors.map(_format_signed))
    shown["tolerance"] = shown["tolerance"].str[1:]
    shown["on itinerary"] = rows["agreement"].map("{:.4f}".format)
    heads = {"predicted": "model", "error": "error/sd", "tolerance": "allowed"}
    names = name_rows(rows, "{moment} {quantity} at {impact}")
    return shown.rename(columns=heads).set_axis(names, axis=0).to_string(col_space=8)


def moment_rows(rows: pd.DataFrame, run: Sampled, z: float) -> str:
    """Rows of section moments with their remarks, as a message states them."""
    remarks = [remark for remark in rows["remark"].unique() if remark]
    head = (
        f"{run.paths} paths; intervals of {z:.2f} standard errors; errors in sds of the quantity,"
        " at each path's own impact"
    )
    return "\n".join([*remarks, head, row_table(rows)])


def long_rows(rows: pd.DataFrame, z: float) -> str:
    """Rows of the long run, dimensionless, as a message states them, and what has widened their
    intervals."""
    names = ["unit", "predicted", "simulated", "se", "low", "high", "tolerance", "paths", "periods"]
    shown = rows.set_index("quantity")[names].rename_axis(None)
    table = shown.rename(columns={"tolerance": "allowed"}).to_string(float_format="{:.5g}".format)
    wide = rows[rows["widened"] > WIDER * z].to_dict("records")
    return render_text("thresholds/long_rows.j2", table=table, wide=wide, z=z).rstrip("\n")


def failure_text(model: str, table: pd.DataFrame, shown: Callable[[pd.DataFrame], str]) -> str:
    """Say which rows failed; `shown` formats them."""
    failed = table[table["verdict"] == Verdict.INACCURATE]
    undecided = len(undecided_rows(table))
    beside = f", {undecided} undecided" if undecided else ""
    where = f"in {len(failed)} of {len(table)} rows{beside}"
    return f"{model} exceeds the allowed error {where}\n{shown(failed)}"


def undecided_rows(table: pd.DataFrame) -> pd.DataFrame:
    """Rows that are neither accurate nor inaccurate."""
    return table[~table["verdict"].isin(DECIDED)]


def paths_to_decide(table: pd.DataFrame) -> float:
    """Estimate the number of paths that would decide every undecided row."""
    return float(undecided_rows(table)["paths_needed"].fillna(math.inf).max())


def describe_undecided(
    model: str, table: pd.DataFrame, shown: Callable[[pd.DataFrame], str]
) -> str:
    """Say which rows are undecided, and how many paths would decide them; `shown` formats them."""
    rows = undecided_rows(table)
    decided = describe_remedy(paths_to_decide(table), kind_of(table))
    return f"{model} is undecided in {len(rows)} of {len(table)} rows; {decided}\n{shown(rows)}"


def remedies(table: pd.DataFrame, claim: Claim) -> str:
    """Describe what can be done about undecided rows."""
    text = render_text(
        "thresholds/remedies.j2",
        claim=claim,
        of_moments="moment" in table,
        needed=PATHS_MARGIN * paths_to_decide(table),
        most=PATHS_OF_AN_HOUR[kind_of(table)],
    )
    return line(text)


def error_figure(table: pd.DataFrame, model: str) -> "Figure":
    """Draw the error of each row of a claim with its interval and the admissible range, in sds of
    each quantity."""
    from rattle.compare.report.style import (
        ACCURATE_COLOUR,
        STYLE,
        SYMBOL,
        legend_above,
        new_figure,
    )

    excess = (table["error"] / table["tolerance"]).abs()
    rows = table.loc[excess.nlargest(MOST_ROWS_DRAWN).index.sort_values()]
    scaled = ["error", "low", "high", "tolerance"]
    verdicts = rows["verdict"].where(rows["verdict"].isin(DECIDED), Verdict.UNDECIDED)
    rows = rows.assign(**rows[scaled].div(rows["unit"], axis=0), verdict=verdicts)
    rows["place"] = np.arange(len(rows))[::-1]
    figure, (ax,) = new_figure(6.4, 1.5 + 0.2 * len(rows))
    allowed = rows["tolerance"]
    ax.barh(
        rows["place"],
        2.0 * allowed,
        left=-allowed,
        height=0.9,
        color=ACCURATE_COLOUR,
        alpha=0.35,
        lw=0,
        label="allowed",
    )
    for verdict, style in VERDICT_MARKERS.items():
        of_verdict = rows[rows["verdict"] == verdict]
        if len(of_verdict):
            error = of_verdict["error"]
            ax.errorbar(
                error,
                of_verdict["place"],
                xerr=(error - of_verdict["low"], of_verdict["high"] - error),
                ls="none",
                ms=6,
                elinewidth=1.6,
                label=verdict,
                **style,
            )
    reach = np.nanmax(rows[["low", "high", "tolerance"]].abs())
    room = 1.15
    if reach > WIDE * allowed.min():
        ax.set_xscale("symlog", linthresh=2.0 * allowed.max(), linscale=2.0)
        room = 2.0
    ax.axvline(0.0, color="0.3", lw=0.8)
    symbols = rows.assign(quantity=rows["quantity"].map(SYMBOL))
    ax.set_yticks(rows["place"], name_rows(symbols, "{moment} {quantity}, impact {impact}"))
    ax.set(
        xlim=(-room * reach, room * reach),
        ylim=(-0.7, len(rows) - 0.3),
        xlabel="error and its interval, in sds of the quantity",
    )
    ax.grid(False, axis="y")
    title = line(model)[:60]
    if len(table) > MOST_ROWS_DRAWN:
        title += f" (the worst {MOST_ROWS_DRAWN} of {len(table)} rows)"
    colour = STYLE[model]["color"]
    ax.set_title(title, loc="left", fontweight="bold", parse_math=False, color=colour)
    legend_above(figure, 4)
    return figure
