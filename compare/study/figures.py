"""Figures of a study, ``r``, which is of `rattle.compare.study.impacts.Tables`: over the first
field that varies."""

from collections.abc import Callable, Iterable, Iterator
from itertools import islice, product
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rattle.compare.judge.verdict import ACCURATE_UP_TO, ENDED, NOT_WRONG, WRONG, Verdict, want
from rattle.compare.report.style import (
    STYLE,
    axis_label,
    legend_above,
    new_figure,
    plain_numbers,
    whole_impacts,
)
from rattle.compare.report.texts import REPORT_TEXTS
from rattle.compare.study.design import Placed, Study

IMPACT_COLOURS = ("#440154", "#31688E", "#35B779", "#C7B700")
"""Line colours of up to four impacts, in order (from viridis)."""
MOMENT_STYLE: Any = REPORT_TEXTS["marks"]["moments"]
BAND = 0.2  # opacity of an interval
FLOOR = 1e-4  # lower end of a logarithmic error axis, in sds


def _pick_impacts(impacts: int) -> list[int]:
    """A few impacts from the first to the last."""
    return sorted({1, *(round(impacts * share) for share in (1 / 3, 2 / 3, 1.0))} - {0})


def _draw_band(ax: Axes, x: Any, y: Any, low: Any, high: Any, **style: Any) -> None:
    """A line with markers and an interval in its colour."""
    ax.plot(x, y, **style)
    ax.fill_between(x, low, high, color=style["color"], alpha=BAND, lw=0)


def _by_impact(rows: pd.DataFrame, r: Any) -> Iterator[Placed]:
    """The rows of a few impacts in the order of the field that varies, each with colour and
    label."""
    for impact, colour in zip(_pick_impacts(r.study.impacts), IMPACT_COLOURS, strict=False):
        of_impact = rows[rows["impact"] == impact].sort_values(r.study.along)
        yield {"color": colour, "lw": 1.4, "marker": "o", "label": f"impact {impact}"}, of_impact


def scale_of(given: Iterable[float]) -> dict[str, Any]:
    """The scale of an axis: logarithmic if the values span more than a decade, with room for a zero
    beside them."""
    values = sorted(set(given))
    above = [v for v in values if v > 0.0]
    if not above or values[0] < 0.0 or above[-1] <= 10.0 * above[0]:
        return {"value": "linear"}
    return {"value": "log"} if values[0] > 0.0 else {"value": "symlog", "linthresh": above[0]}


def label_field(ax: Axes, name: str, given: Iterable[float]) -> None:
    """Label the axis of a field, and make it logarithmic if the values span more than a decade."""
    values = sorted(set(given))
    ax.set_xlabel(axis_label(name))
    scale = scale_of(values)
    ax.set_xscale(**scale)
    if scale["value"] == "symlog":
        ax.set_xlim(-0.2 * scale["linthresh"], None)
        ax.xaxis.set_major_formatter("{x:g}")
    if scale["value"] == "log":
        plain_numbers(ax.xaxis, values)


def errors(r: Any, rows: pd.DataFrame) -> Figure:
    """Draw the largest error of each closure at some impacts, with its interval: means above, sds
    below."""
    name = r.study.along
    shown = _pick_impacts(r.study.impacts)
    limits = {"mean": r.study.within.mean, "sd": r.study.within.sd}
    figure, axes = new_figure(2.6 * len(shown) + 0.8, 5.6, 2, len(shown))
    judged = rows[rows["judged"] & (rows["verdict"] != Verdict.NOT_PREDICTED)]
    for ax, (moment, impact) in zip(axes, product(limits, shown), strict=True):
        part = judged.query("moment == @moment and impact == @impact")
        for closure, group in part.groupby("closure", sort=False):
            worst = _worst(group, name)
            ends = (worst[end].clip(lower=FLOOR) for end in ("size", "least", "most"))
            style = STYLE[str(closure)]
            _draw_band(ax, worst[name], *ends, label=str(closure), lw=1.4, ms=3.5, **style)
        ax.axhline(limits[moment], color="k", ls="--", lw=1.0, label="tolerance")
        ax.set(yscale="log", ylim=(FLOOR, None))
        label_field(ax, name, rows[name])
        ax.set_title(f"impact {impact}", loc="left")
        if impact == shown[0]:
            ax.set_ylabel(f"largest error of a {moment}, in sds")
    legend_above(figure, len(r.study.closures) + 1)
    return figure


def _worst(rows: pd.DataFrame, name: str) -> pd.DataFrame:
    """The row with the largest absolute error in sds at each value of a field, with the interval of
    that error."""
    size = (rows["error"] / rows["unit"]).abs().fillna(0.0)
    half = 0.5 * (rows["high"] - rows["low"]) / rows["unit"]
    table = rows.assign(size=size, least=(size - half).clip(lower=0.0), most=size + half)
    return table.sort_values("size").groupby(name).tail(1).sort_values(name)


def validity(r: Any, rows: pd.DataFrame) -> Figure:
    """Draw the range of validity over the first k impacts: where each closure is accurate, and not
    shown wrong."""
    figure, (ax,) = new_figure(8.0, 3.8)
    name = r.study.along
    values = r.errors[name].unique()
    for closure, group in rows.groupby("closure", sort=False):
        style = STYLE[str(closure)]
        impact = group["impact"]
        accurate = group["accurate"]
        not_wrong = group["not_inaccurate"]
        if not_wrong.isna().all():
            what = ENDED if group["ended"].all() else WRONG
            ax.plot([], [], label=f"{closure}: {what} at the smallest", **style)
            continue
        ax.plot(impact, accurate, label=f"{closure}: {ACCURATE_UP_TO}", lw=1.5, ms=5, **style)
        ax.plot(impact, not_wrong, color=style["color"], ls=":", lw=1.5)
        lower = accurate.fillna(min(values))
        ax.fill_between(impact, lower, not_wrong, color=style["color"], alpha=BAND, lw=0)
    ax.plot([], [], color="0.3", ls=":", lw=1.5, label=NOT_WRONG)
    ax.fill_between([], [], color="0.3", alpha=BAND, lw=0, label=want(r.of_all_paths))
    if (scale := scale_of(values))["value"] != "linear":
        ax.set_yscale(**scale)
        ax.yaxis.set_major_formatter("{x:g}")
    ax.set_ylim(min(values), max(values) * 1.1)
    whole_impacts(ax)
    ax.set(xlabel="first impacts", ylabel=f"largest {axis_label(name)}")
    legend_above(figure, 2)
    return figure


def _draw_lines(axes: list[Axes], r: Any, rows: pd.DataFrame, by: str, *columns: str) -> None:
    """Draw a column in each panel: a line for each closure, or kind of cell."""
    for name, group in rows.sort_values(r.study.along).groupby(by, sort=False):
        for ax, column in zip(axes, columns, strict=True):
            style = STYLE[str(name)]
            ax.plot(group[r.study.along], group[column], label=name, lw=1.4, ms=4, **style)


def _correlation(axes: list[Axes], r: Any, rows: pd.DataFrame) -> None:
    """Draw the share of a closure's impacts at which its correlation is invalid, and the largest
    |rho|."""
    share = 100.0 * rows["invalid"] / rows["reached"].clip(lower=1)
    _draw_lines(axes, r, rows.assign(share=share), "closure", "share", "largest")
    axes[0].set(
        ylabel="impacts with invalid ρ, % of those reached",
        ylim=(-2.0, max(10.0, axes[0].get_ylim()[1])),
    )
    axes[1].axhline(1.0, color="k", ls="--", lw=1.0, label="|ρ| = 1")
    axes[1].set_ylabel("largest |ρ|")


def _wilson(k: int, n: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share k / n; without noise one path represents all, and k = 0 or
    1 is exact."""
    if n <= 1:
        return (float(k), float(k)) if n else (0.0, 1.0)
    from scipy.stats import binomtest  # takes longer to load than the figures to draw

    low, high = binomtest(k, n).proportion_ci(method="wilson")
    return float(low), float(high)


def _agreement(axes: list[Axes], r: Any, rows: pd.DataFrame) -> None:
    """Draw the share of paths that are still on the noise-free itinerary, with Wilson's 95 %
    interval."""
    part = rows.query("quantity == 'tau' and moment == 'mean' and paths > 0")
    for style, group in _by_impact(part, r):
        counts = zip(group["agreement"] * group["followed"], group["followed"], strict=True)
        interval = np.reshape([_wilson(round(k), int(n)) for k, n in counts], (-1, 2)).T
        _draw_band(axes[0], group[r.study.along], group["agreement"], *interval, ms=3, **style)
    axes[0].set(ylim=(-0.02, 1.04), ylabel="paths on the noise-free itinerary")


SECTION_PANELS: list[dict[str, str]] = REPORT_TEXTS["marks"]["panels"]
"""Quantity, moment and label of each panel."""


def _sections(axes: list[Axes], r: Any, rows: pd.DataFrame) -> None:
    """Draw sd and skewness at some impacts, impact rate and energy loss, with 95 % intervals."""
    for ax, panel in zip(axes, SECTION_PANELS, strict=True):
        moment = panel["moment"]
        part = rows[(rows["quantity"] == panel["quantity"]) & (rows["moment"] == moment)]
        for style, group in _by_impact(part, r):
            half = 1.96 * group["se"]
            value = group["value"]
            _draw_band(ax, group[r.study.along], value, value - half, value + half, ms=2.5, **style)
        ax.set_ylabel(panel["label"])
        if moment == "sd" and (part["value"] > 0.0).any():
            ax.set_yscale("log")
        if moment == "skew":
            ax.set_yscale("symlog", linthresh=1.0)


def draw_paired(r: Any, rows: pd.DataFrame) -> Figure:
    """Draw the gain of common random numbers: independent over paired standard error of a
    difference of neighbours."""
    figure, (ax,) = new_figure(6.2, 3.6)
    part = rows.query("se > 0.0 and se_independent > 0.0")
    part = part.assign(
        gain=part["se_independent"] / part["se"], middle=0.5 * (part["from"] + part["to"])
    )
    for moment, style in MOMENT_STYLE.items():
        known = part[part["moment"] == moment]
        if known.empty:  # too few batches for a standard error
            continue
        gains = known.groupby("middle")["gain"].quantile([0.1, 0.5, 0.9]).unstack()
        ends = (gains[share] for share in (0.5, 0.1, 0.9))
        label = f"{moment}s: median, 10 to 90 %"
        _draw_band(ax, gains.index, *ends, lw=1.4, ms=4, label=label, **style)
    ax.axhline(1.0, color="k", ls="--", lw=1.0)
    ax.set(yscale="log", ylabel="error of a difference, independent / paired")
    ax.yaxis.set_major_formatter("{x:g}")
    label_field(ax, r.study.along, part["middle"])
    legend_above(figure, 2)
    return figure


def _cost(axes: list[Axes], r: Any, rows: pd.DataFrame) -> None:
    """Draw the seconds of each cell."""
    _draw_lines(axes, r, rows, "what", "seconds")
    axes[0].set(yscale="log", ylabel="seconds of one core")


class TablePlot(NamedTuple):
    """A figure of a table of a study over the first field that varies, one for each value of the
    others."""

    table: str  # name of the table
    title: str
    # of axes, study and rows; or of study and rows, if the figure has no `size`
    draw: Callable[..., Any]
    size: tuple[float, float] | None = None
    grid: tuple[int, int] = (1, 1)

    def figure(self, r: Any, rows: pd.DataFrame) -> Figure:
        """Draw the figure."""
        if self.size is None:
            drawn: Figure = self.draw(r, rows)
            return drawn
        figure, axes = new_figure(*self.size, *self.grid)
        self.draw(axes, r, rows)
        for ax in axes:
            label_field(ax, r.study.along, rows[r.study.along])
        legend_above(figure, 4)
        return figure


STUDY_FIGURES = {
    "validity": TablePlot(
        "validity", "Range of validity, for all means and sds of the first impacts", validity
    ),
    "errors": TablePlot("of_all_paths", "Largest error of each closure, with its interval", errors),
    "agreement": TablePlot("sections", "Itinerary agreement", _agreement, (6.2, 3.8)),
    "sections": TablePlot(
        "sections",
        "Section sds, skewness, impact rate and impact energy",
        _sections,
        (11.0, 5.8),
        (2, 3),
    ),
    "correlation": TablePlot(
        "correlation", "Validity of the correlation", _correlation, (8.0, 3.4), (1, 2)
    ),
    "paired": TablePlot("paired", "What common random numbers save", draw_paired),
    "cost": TablePlot("cost", "Cost of each cell", _cost, (6.2, 3.8)),
}
"""All figures by name."""


def panels(study: Study, table: pd.DataFrame, most: int = 6) -> Iterator[Placed]:
    """Split a table into parts in which all fields but the first that varies are fixed, one for
    each figure."""
    if not study.along or table.empty:
        return
    if not study.others:
        yield {}, table
        return
    for key, part in islice(table.groupby(study.others, sort=False), most):
        yield dict(zip(study.others, key, strict=True)), part
