"""Figures of a validation: errors, correlation, section histograms, agreement."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from compare.frontier import frontiers
from compare.validate import Validation

__all__ = [
    "FIGURES",
    "agreement_figure",
    "correlation_figure",
    "error_figure",
    "frontier_figure",
    "save",
    "section_figure",
]

# Okabe and Ito's palette: told apart with every common colour vision, and by marker as well.
STYLE: Any = {
    "printed": {"color": "#D55E00", "marker": "s"},
    "mended": {"color": "#0072B2", "marker": "o"},
    "saltation": {"color": "#009E73", "marker": "^"},
    "branching": {"color": "#E69F00", "marker": "v"},
    "monte carlo": {"color": "#000000", "marker": "D"},
}
ACCURATE, FORBIDDEN = "#56B4E9", "#CC79A7"
SYMBOL = {
    "tau": r"$\tau$",
    "flight": r"$\Delta\tau$",
    "x1": "$x_1$",
    "y1": "$y_1$",
    "x2": "$x_2$",
    "y2": "$y_2$",
    "rho1": r"$\rho_1$",
    "rho2": r"$\rho_2$",
}
VISIBLE = 2e-3  # a histogram is drawn as far as its bins reach this share of the highest
Floats = NDArray[np.float64]

LINEAR = 0.1  # errors up to this many sds are drawn to scale, larger ones by their logarithm

SETTINGS: Any = {
    "svg.hashsalt": "rattle",
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
}


def _figure(width: float, height: float, rows: int, columns: int) -> tuple[Figure, list[Axes]]:
    with mpl.rc_context(SETTINGS):
        figure = Figure(figsize=(width, height), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False)
    return figure, list(axes.ravel())


def _legend(figure: Figure, axes: Sequence[Axes], columns: int) -> None:
    """One legend for all panels, above them."""
    gathered: dict[str, Artist] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            gathered.setdefault(label, handle)
    figure.legend(list(gathered.values()), list(gathered), loc="outside upper center", ncols=columns)


def _offsets(names: Sequence[str]) -> dict[str, float]:
    """Small sideways shifts, so that markers of one impact stand side by side."""
    return dict(zip(names, np.linspace(-0.13, 0.13, len(names)) if len(names) > 1 else [0.0], strict=True))


def error_figure(v: Validation) -> Figure:
    """Errors of section means and sds per impact and reading, in units of the quantity's sd, with intervals."""
    quantities = [q for q in ("tau", "y1", "y2") if v.scene.stages == 2 or q != "y2"]
    figure, axes = _figure(3.4 * len(quantities), 5.4, 2, len(quantities))
    section = v.table[
        (v.table["kind"] == "section") & (v.table["verdict"] != "not predicted") & (v.table["unit"] > 0.0)
    ]
    shift = _offsets(list(v.closures))
    for row, moment in enumerate(("mean", "sd")):
        share = getattr(v.tolerances, moment)
        for column, quantity in enumerate(quantities):
            ax = axes[row * len(quantities) + column]
            ax.axhspan(-share, share, color=ACCURATE, alpha=0.18, lw=0, label=f"accurate: within {share:.0%} of an sd")
            ax.axhline(0.0, color="0.4", lw=0.8)
            for reading in v.closures:
                rows = section[
                    (section["reading"] == reading) & (section["quantity"] == quantity) & (section["moment"] == moment)
                ]
                error, low, high = (rows[name] / rows["unit"] for name in ("error", "low", "high"))
                ax.errorbar(
                    rows["impact"] + shift[reading],
                    error,
                    [error - low, high - error],
                    ls="none",
                    ms=4,
                    capsize=2,
                    label=reading,
                    **STYLE[reading],
                )
            if not ((section["quantity"] == quantity) & (section["moment"] == moment)).any():
                ax.text(0.5, 0.75, "no reading predicts it", transform=ax.transAxes, ha="center", color="0.35")
            ax.set_yscale("symlog", linthresh=LINEAR)
            limit = max(10.0, *(abs(t) for t in ax.get_ylim()))
            ax.set_ylim(-limit, limit)
            ax.set_xlim(0.5, len(v.run.section) + 0.5)
            name = SYMBOL[quantity]
            ax.set_title(f"{'mean' if moment == 'mean' else 'sd'} of {name}", loc="left")
            ax.set_xlabel("impact")
            if column == 0:
                ax.set_ylabel("error / sd of the quantity")
    _legend(figure, axes, 5)
    return figure


def correlation_figure(v: Validation) -> Figure:
    """Correlation of displacement and velocity per stage: closures before impacts, both sides at mid-flight."""
    stages = range(1, v.scene.stages + 1)
    figure, axes = _figure(5.2 * len(stages), 3.9, 1, len(stages))
    limit, impacts = 1.9, len(v.run.section)
    readings = [name for name, closure in v.closures.items() if closure.trace.parts is None]
    for stage, ax in zip(stages, axes, strict=True):
        for sign in (-1.0, 1.0):
            ax.axhspan(
                sign,
                sign * limit,
                color=FORBIDDEN,
                alpha=0.22,
                lw=0,
                label=r"impossible: $|\rho| > 1$" if sign > 0 else None,
            )
        for reading, shift in _offsets(readings).items():
            rows = v.correlation[(v.correlation["reading"] == reading) & (v.correlation["stage"] == stage)]
            rho = rows["rho"].clip(-limit + 0.12, limit - 0.12)
            colour, marker = STYLE[reading]["color"], STYLE[reading]["marker"]
            ax.plot(rows["impact"] + shift, rho, marker, ms=5, color=colour, label=f"{reading}, before impact")
            broken = rows[rows["rho"].isna() & ~rows["realizable"]]
            if len(broken):
                ax.plot(
                    broken["impact"] + shift,
                    np.full(len(broken), limit - 0.25),
                    "x",
                    ms=6,
                    mew=1.6,
                    color=colour,
                    label=f"{reading}: negative variance",
                )
        clock = v.table[(v.table["kind"] == "clock") & (v.table["quantity"] == f"rho{stage}")]
        for reading in readings:
            rows = clock[clock["reading"] == reading].dropna(subset=["closure"])
            colour, marker = STYLE[reading]["color"], STYLE[reading]["marker"]
            ax.plot(
                rows["impact"] - 0.5,
                rows["closure"].clip(-limit, limit),
                marker,
                ms=5,
                mfc="none",
                color=colour,
                label=f"{reading}, mid-flight",
            )
        rows = clock[clock["reading"] == readings[0]]
        low, high = (rows["closure"] - rows["high"], rows["closure"] - rows["low"])
        known = rows["closure"].notna()
        errors = np.where(known, [rows["monte_carlo"] - low, high - rows["monte_carlo"]], v.z * rows["se"])
        ax.errorbar(
            rows["impact"] - 0.5,
            rows["monte_carlo"],
            np.abs(errors),
            ls="none",
            ms=3.5,
            capsize=2,
            label="Monte Carlo, mid-flight",
            **STYLE["monte carlo"],
        )
        ax.set_ylim(-limit, limit)
        ax.set_xlim(0.0, impacts + 0.5)
        ax.set_xlabel("impact (mid-flight: the flight that it ends)")
        ax.set_ylabel(SYMBOL[f"rho{stage}"])
        ax.set_title(f"stage {stage}", loc="left")
    _legend(figure, axes, 4)
    return figure


def section_figure(v: Validation) -> Figure:
    """Histogram of the velocities before each path's own impact, with the closures' Edgeworth densities over it."""
    impacts = sorted(set(np.linspace(1, len(v.run.section), 4).round().astype(int).tolist()))
    velocities = ["y1", "y2"][: v.scene.stages]
    figure, axes = _figure(3.0 * len(impacts), 2.7 * len(velocities), len(velocities), len(impacts))
    assert v.run.histograms is not None
    for row, quantity in enumerate(velocities):
        for column, impact in enumerate(impacts):
            ax = axes[row * len(impacts) + column]
            edges, density = v.run.histograms.density(impact, quantity)
            ax.stairs(density, edges, fill=True, color="0.75", label="Monte Carlo, own impact")
            shown = np.flatnonzero(density >= VISIBLE * density.max())
            y = np.linspace(edges[shown[0]], edges[shown[-1] + 1], 600)
            for reading, closure in v.closures.items():
                curve = closure.density(impact, quantity, y)
                if curve is not None:
                    label = f"{reading}, {'mixture' if closure.trace.parts is not None else 'Edgeworth'}"
                    ax.plot(
                        y,
                        curve,
                        color=STYLE[reading]["color"],
                        lw=1.4,
                        ls="--" if reading == "printed" else "-",
                        label=label,
                    )
            ax.set_ylim(0.0, 1.25 * max(density.max(), 1e-12))
            ax.set_xlim(y[0], y[-1])
            ax.xaxis.set_major_locator(MaxNLocator(4))
            ax.set_title(f"impact {impact}", loc="left")
            ax.set_xlabel(f"{SYMBOL[quantity]} before impact")
            if column == 0:
                ax.set_ylabel("density")
    _legend(figure, axes, 4)
    return figure


def frontier_figure(validations: Sequence[Validation]) -> Figure:
    """Impact up to which each reading is accurate (filled) and not refuted (open), per noise intensity."""
    table = frontiers(list(validations))
    impacts = len(validations[0].run.section)
    readings = list(validations[0].closures)
    figure, axes = _figure(2.2 + 1.9 * len(validations), 3.2, 1, 1)
    ax = axes[0]
    width = 0.8 / len(readings)
    for i, reading in enumerate(readings):
        rows = table[table["reading"] == reading]
        place = np.arange(len(rows)) + (i - 0.5 * (len(readings) - 1)) * width
        colour = STYLE[reading]["color"]
        ax.bar(place, rows["not_refuted"], 0.86 * width, facecolor="none", edgecolor=colour, hatch="////", lw=0.8)
        ax.bar(place, rows["accurate"], 0.86 * width, color=colour, label=reading)
        for x, height in zip(place, rows["not_refuted"], strict=True):
            ax.text(x, height + 0.15, f"{height}", ha="center", va="bottom", fontsize=8)
    ax.set_xticks(range(len(validations)), [rf"$\sigma$ = {v.scene.sigma:.4g}" for v in validations])
    ax.set_ylim(0.0, 1.12 * impacts)
    ax.set_ylabel("impact")
    ax.grid(visible=False, axis="x")
    handles: list[Artist] = [*ax.get_legend_handles_labels()[0], Patch(facecolor="none", edgecolor="0.3", hatch="////")]
    labels = [*(f"{r}: accurate up to" for r in readings), "not refuted up to"]
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    return figure


def agreement_figure(validations: Sequence[Validation]) -> Figure:
    """Share of paths that have followed an itinerary so far, per noise intensity; dashed what `branching` predicts."""
    first = validations[0]
    alike: dict[tuple[int, ...], list[str]] = {}  # readings by their itinerary at the first noise intensity
    for reading, closure in first.closures.items():
        alike.setdefault(closure.itinerary, []).append(reading)
    figure, axes = _figure(4.6 * len(alike), 3.3, 1, len(alike))
    shades = mpl.colormaps["cividis"](np.linspace(0.0, 0.8, len(validations)))
    for readings, ax in zip(alike.values(), axes, strict=True):
        for v, shade, marker in zip(validations, shades, "osD^vP*X" * 8, strict=False):
            share = v.run.agreement[readings[0]]
            ax.plot(
                share.index, share, marker=marker, ms=4, lw=1.2, color=shade, label=rf"$\sigma$ = {v.scene.sigma:.4g}"
            )
            if "branching" in readings and "agreement" in v.closures["branching"].section:
                ax.plot(share.index, v.closures["branching"].section["agreement"], color=shade, ls="--", lw=1.0)
        ax.set_ylim(-0.03, 1.05)
        ax.set_xlabel("impact")
        ax.set_ylabel("share of paths still agreeing")
        ax.set_title("itinerary of " + ", ".join(readings), loc="left")
    axes[0].legend(loc="best")
    return figure


FIGURES: dict[str, tuple[Callable[[Validation], Figure], str]] = {
    "errors": (
        error_figure,
        "Errors of the closure's section moments per impact, in units of the quantity's sd; bars are intervals with "
        "step bias, the band is what counts as accurate. Beyond 0.1 the scale is logarithmic.",
    ),
    "correlation": (
        correlation_figure,
        "Correlation of displacement and velocity per stage. Filled: closure just before its impacts. Open: closure at "
        "mid-flight, beside the Monte Carlo there. No correlation can lie in the shaded zone; a cross marks a variance "
        "that is negative.",
    ),
    "section": (
        section_figure,
        "Velocity of each path just before its own impact (histogram), and the Edgeworth density of the closures "
        "around their mean.",
    ),
}
"""Figures of one validation: name, how it is drawn, what it shows."""


def save(figure: Figure, path: Path) -> None:
    """Write a figure as SVG, the same bytes for the same figure."""
    with mpl.rc_context(SETTINGS):
        figure.savefig(path, format="svg", metadata={"Date": None})
