"""Figures of a study of chaos: sections, spectra, exponents over a field, and the divergence of two
paths."""

import math
from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from rattle.compare.chaos.exponents import NOISY_PATH, Exponents, SqrtLaw
from rattle.compare.chaos.measure import CLAIMED, ChaosStudy
from rattle.compare.chaos.record import STICKS_AT_TIMES, STICKS_FOR_GOOD, STICKS_OFTEN
from rattle.compare.chaos.section import MAP, NOISY, ORBIT_SECTION, Section
from rattle.compare.chaos.spectrum import SEQUENCE, VELOCITY_IN_TIME, Spectra, Spectrum
from rattle.compare.chaos.sweep import Bifurcation
from rattle.compare.report.style import (
    SYMBOL,
    axis_label,
    error_bars,
    legend_above,
    new_figure,
    new_panels,
)
from rattle.compare.report.texts import REPORT_TEXTS
from rattle.scene import Bools, Floats, Gears

SIDE: Any = REPORT_TEXTS["marks"]["sides"]
"""Colours of the sides."""
LEAST_DENSITY = 1e-4  # lower end of the colours of a density, relative to its highest
HIGHEST_FREQUENCY = 6.5  # highest frequency drawn, in units of the excitation frequency


def speed_unit(gears: Gears | None = None) -> tuple[float, str]:
    """Factor and name of the unit in which speeds are drawn."""
    return (1.0, r"$\nu_1\omega$") if gears is None else (gears.units.speed, "mm/s")


def label_velocity(ax: Axes, mesh: int, unit: str, **style: Any) -> None:
    """Label the axis of the velocity before an impact."""
    ax.set_ylabel(rf"velocity before the impact $y_{{{mesh}}}$ ({unit})", **style)


def draw_cells(
    ax: Axes, x: Floats, y: Floats, cells: Floats, low: float, high: float, colours: str = "viridis"
) -> QuadMesh:
    """Draw the cells of a histogram on a logarithmic colour scale; empty ones stay white.

    Shapes: `x` and `y`, edges of the cells, (n + 1,) and (m + 1,); `cells` (n, m).
    """
    ax.grid(False)
    shown = np.ma.masked_where(~(cells.T > 0.0), cells.T)
    return ax.pcolormesh(x, y, shown, norm=LogNorm(low, high), cmap=colours, rasterized=True)


def section_figure(found: Mapping[str, Section]) -> Figure:
    """Draw the Poincaré sections of all sides on the same axes (Fig. 2 of the paper)."""
    sections = list(found.values())
    one = sections[0]
    stages = len(one.counts)
    figure, axes = new_figure(1.0 + 3.2 * len(sections), 0.7 + 2.9 * stages, stages, len(sections))
    area = (one.flight[1] - one.flight[0]) * (one.velocity[1] - one.velocity[0])
    highest = max(s.counts.max() / (s.points * area) for s in sections if s.side != MAP)
    for ax, (stage, s) in zip(axes, product(range(stages), sections), strict=True):
        density = s.counts[stage] / (max(s.points, 1) * area)
        image = draw_cells(ax, s.flight, s.velocity, density, LEAST_DENSITY * highest, highest)
        ax.set(xlim=s.flight[[0, -1]], ylim=s.velocity[[0, -1]])
        if stage == 0:
            ax.set_title(
                f"{s.side}\n{s.points:,} points",
                loc="left",
                color=SIDE[s.side]["color"],
                fontweight="bold",
            )
        if stage == stages - 1:
            ax.set_xlabel(r"time since the last impact $\Delta\tau$ (1/$\omega$)")
        if s is one:
            label_velocity(ax, stage + 1, speed_unit()[1])
    figure.colorbar(image, ax=axes, label=r"density ($1/\nu_1$)", pad=0.01, aspect=40)
    return figure


def spectrum_figure(found: Spectra) -> Figure:
    """Draw the spectra of both sides with their 95 % bands, floors and lines (Fig. 3 of the
    paper)."""
    names = list(dict.fromkeys(name for _, _, name in found))
    columns = min(len(names), 2)
    figure, axes = new_panels(2 * len(names), columns, 4.6, 3.2)
    kinds = (
        (
            VELOCITY_IN_TIME,
            "frequency / excitation frequency",
            "excitation frequency",
            HIGHEST_FREQUENCY,
        ),
        (SEQUENCE, "frequency (cycles per impact)", "cycle per impact", math.inf),
    )
    panels = enumerate(product(kinds, names))
    for ax, (number, ((kind, frequency, unit, highest), name)) in zip(axes, panels, strict=True):
        for side in (NOISY, ORBIT_SECTION):
            if (side, kind, name) in found:
                _spectrum(ax, found[side, kind, name], side, highest)
        ax.set(yscale="log", xlabel=frequency)
        # so that all curves are rasterized as one image; text and axes stay vector graphics
        ax.set_axisbelow(True)
        ax.set_title(f"{SYMBOL[name]}: {kind}", loc="left")
        if number % columns == 0:
            ax.set_ylabel(f"power spectral density\n($\\nu_1^2\\omega^2$ per {unit})", fontsize=8)
    legend_above(figure, 3)
    return figure


def _spectrum(ax: Axes, s: Spectrum, side: str, highest: float) -> None:
    """Draw a spectrum up to a frequency, with its band, its floor and its strongest lines."""
    image: Any = {"data": s.table.query("frequency <= @highest"), "rasterized": True}
    colour = SIDE[side]["color"]
    dashes = "--" if side == NOISY else ":"
    band: Any = {"color": colour, "alpha": 0.25, "lw": 0, "label": f"{side}: 95 % band"}
    ax.fill_between("frequency", "low", "high", **band, **image)
    ax.plot("frequency", "power", color=colour, lw=0.7, label=side, **image)
    ax.plot("frequency", "floor", color="k", lw=0.9, ls=dashes, label=f"{side}: floor", **image)
    strongest = s.lines[s.lines["frequency"] <= highest]["frequency"].head(12)
    if len(strongest):
        above = 2.0 * s.power[np.searchsorted(s.frequency, strongest).clip(0, s.power.size - 1)]
        label = f"{side}: line"
        ax.plot(strongest, above, ls="none", ms=4, mfc="none", zorder=3, label=label, **SIDE[side])


def _lines(ax: Axes, table: pd.DataFrame, field: str) -> None:
    """Draw the largest exponents with their intervals, and mark where the orbit sticks."""
    for of in (ORBIT_SECTION, NOISY_PATH):
        rows: Any = table[table["of"] == of].sort_values(field)
        colour = SIDE[of]["color"]
        ax.fill_between(field, "low", "high", data=rows, color=colour, alpha=0.3, lw=0)
        ax.plot(field, "largest", data=rows, color=colour, lw=1.2, label=of)
        if of == ORBIT_SECTION:
            sticks = rows["regime"].isin((STICKS_OFTEN, STICKS_FOR_GOOD)).to_numpy()
            _mark_values(ax, rows[field].to_numpy(), sticks)
            label = "orbit that sticks at times: between sticking phases"
            ring: Any = {"label": label, "ls": "none", "ms": 3.5, "mfc": "none", **SIDE[of]}
            ax.plot(field, "largest", data=rows[rows["regime"] == STICKS_AT_TIMES], **ring)
    ax.axhline(0.0, color="k", lw=0.8)
    ax.set_ylabel(r"largest exponent ($\omega$)")


def _half_cell(at: Floats) -> float:
    """Half the width of the cells around the values of a field."""
    return 0.5 * np.diff(at).min() if at.size > 1 else 0.5


def _mark_values(
    ax: Axes, at: Floats, where: Bools, label: str = "orbit sticks often or for good"
) -> None:
    """Shade some values of a field, under one label."""
    half = _half_cell(at)
    for value in at[where]:
        ax.axvspan(value - half, value + half, color="0.55", alpha=0.35, lw=0, label=label)
        label = ""


def sweep_figure(table: pd.DataFrame, field: str, claimed: tuple[float, float] | None) -> Figure:
    """Draw the largest exponent over a field (Fig. 4 of the paper)."""
    figure, (ax,) = new_figure(8.0, 4.4)
    if claimed:
        label = "chaotic according to the paper: {:g} to {:g}".format(*claimed)
        ax.axvspan(*claimed, color="#F0E442", alpha=0.25, lw=0, label=label)
    _lines(ax, table, field)
    ax.set_xlabel(axis_label(field))
    legend_above(figure, 2)
    return figure


def bifurcation_figure(
    b: Bifurcation, table: pd.DataFrame | None = None, gears: Gears | None = None
) -> Figure:
    """Draw a bifurcation diagram as shares of the impacts at each value, a row for each side.

    `table`: A sweep over the same field, whose largest exponents are drawn in a last row. `gears`:
    Those in whose unit velocities are drawn.
    """
    factor, unit = speed_unit(gears)
    rows = len(b.cells) + (table is not None)
    figure, axes = new_figure(8.0, 2.6 * rows + 0.4, rows, 1)
    at = b.at
    half = _half_cell(at)
    x = np.concatenate([[at[0] - half], 0.5 * (at[1:] + at[:-1]), [at[-1] + half]])
    for ax, (side, cells) in zip(axes, b.cells.items(), strict=False):
        whole = cells.sum(axis=1, keepdims=True)
        share = cells / np.where(whole > 0.0, whole, 1.0)
        if share.any():
            highest = share.max()
            draw_cells(ax, x, factor * b.edges, share, LEAST_DENSITY * highest, highest)
        lost = np.array(b.reasons[side]) != ""
        _mark_values(ax, at, lost, "no stationary motion")
        ax.set_title(side, loc="left", color=SIDE[side]["color"], fontweight="bold")
        label_velocity(ax, 1, unit, fontsize=8)
    if table is not None:
        _lines(axes[-1], table, b.field)
        legend_above(figure, 2, axes[-1:])
    elif any(reason for reasons in b.reasons.values() for reason in reasons):
        legend_above(figure, 1)
    for ax in axes:
        ax.set_xlim(x[0], x[-1])
    axes[-1].set_xlabel(axis_label(b.field))
    return figure


def _intervals(ax: Axes, table: pd.DataFrame, name: str, **style: Any) -> None:
    """Draw values over the distance of two paths, with their intervals."""
    bars = error_bars(table, name)
    ax.errorbar(table["delta"], table[name], bars, ms=5, capsize=2, **style, **SIDE[NOISY])


def finite_size_figure(table: pd.DataFrame, orbit: Exponents, drift: Exponents) -> Figure:
    """Draw the finite-size exponent of the noisy system over the distance of two paths."""
    figure, (ax,) = new_figure(6.4, 4.4)
    label = r"finite-size exponent $\lambda(\delta)$ of the noisy system"
    _intervals(ax, table, "exponent", ls="-", lw=1.0, label=label)
    colour = SIDE[ORBIT_SECTION]["color"]
    for exponents, style, name in (
        (orbit, "-", "orbit: largest Lyapunov exponent"),
        (drift, ":", "drift's linearisation: largest"),
    ):
        if (value := exponents.largest[0]) > 0.0:
            ax.axhline(value, color=colour, ls=style, lw=1.3, label=name)
    distance = r"distance $\delta$ of two paths on the same noise ($\nu_1$)"
    ax.set(xscale="log", yscale="log", ylabel=r"growth rate ($\omega$)", xlabel=distance)
    legend_above(figure, 1)
    return figure


def sqrt_law_figure(law: SqrtLaw) -> Figure:
    """Draw the distance of two paths after an impact against that before it, and its ratio to the
    square-root law."""
    figure, (ax, ratio) = new_figure(8.4, 3.9, 1, 2)
    t: Any = law.table
    of_law = r"$(1+\epsilon)\,\sigma\,|m|\,\sqrt{\delta/|y|}$"
    of_a_map = r"$\delta$: a differentiable map"
    label = "measured, root mean square"
    ax.plot("delta", "apart", data=t, label=label, ls="none", ms=5, **SIDE[NOISY])
    ax.plot("delta", "law", data=t, color="k", lw=1.0, label=of_law)
    ax.plot("delta", "delta", data=t, color="0.5", lw=1.0, ls=":", label=of_a_map)
    before = r"distance before the impact $\delta$ ($\nu_1$)"
    ax.set(
        xscale="log",
        yscale="log",
        xlabel=before,
        ylabel=r"distance of velocities after the impact ($\nu_1\omega$)",
    )
    ax.set_title(f"exponent {law.exponent:.4f} ± {0.5 * (law.high - law.low):.4f}", loc="left")
    _intervals(ratio, t, "ratio", ls="none")
    ratio.axhline(1.0, color="k", lw=1.0)
    ratio.set(xscale="log", xlabel=before, ylabel="mean square / that of the square-root law")
    legend_above(figure, 3, [ax])
    return figure


def draw(study: ChaosStudy) -> dict[str, Figure]:
    """Draw all figures of a study of chaos, by name; without those of what was not measured."""
    sizes = study.finite_size
    swept = study.sweep
    claimed = CLAIMED if study.field == "alpha" else None
    drawn: dict[str, Any] = {
        "section": study.sections and section_figure(study.sections),
        "spectra": study.spectra and spectrum_figure(study.spectra),
        "finite_size": (
            None if sizes is None else finite_size_figure(sizes, study.orbit, study.drift)
        ),
        "sqrt_law": study.law and sqrt_law_figure(study.law),
        "sweep": None if swept is None else sweep_figure(swept, study.field, claimed),
        "bifurcation": study.view and bifurcation_figure(study.view, swept),
    }
    return {name: figure for name, figure in drawn.items() if figure}
