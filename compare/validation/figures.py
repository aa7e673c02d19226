"""Figures of a validation: errors, correlation, section histograms, agreement."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rattle.compare.report.style import ACCURATE, FORBIDDEN, STYLE, SYMBOL, legend_above, new_figure, whole_impacts
from rattle.compare.validation.comparison import Comparison

VISIBLE = 2e-3  # the outermost bins of a histogram that are drawn have at least this share of the highest
LINEAR = 0.1  # the axis of errors is linear up to this many sds, logarithmic beyond


def _offsets(names: Sequence[str]) -> dict[str, float]:
    """Small sideways shifts, so that markers of one impact stand side by side."""
    return dict(zip(names, np.linspace(-0.13, 0.13, len(names)) if len(names) > 1 else [0.0], strict=True))


def error_figure(v: Comparison) -> Figure:
    """Errors of section means and sds per impact and closure, in units of the quantity's sd, with intervals."""
    quantities = [q for q in ("tau", "y1", "y2") if v.scene.stages == 2 or q != "y2"]
    figure, axes = new_figure(3.4 * len(quantities), 5.4, 2, len(quantities))
    section = v.table[
        (v.table["kind"] == "section") & (v.table["verdict"] != "not predicted") & (v.table["unit"] > 0.0)
    ]
    shift = _offsets(list(v.predictions))
    accurate = f"accurate: means within {v.tolerances.mean:.0%}, sds within {v.tolerances.sd:.0%} of an sd"
    for row, moment in enumerate(("mean", "sd")):
        share = getattr(v.tolerances, moment)
        for column, quantity in enumerate(quantities):
            ax = axes[row * len(quantities) + column]
            ax.axhspan(-share, share, color=ACCURATE, alpha=0.18, lw=0, label=accurate)
            ax.axhline(0.0, color="0.4", lw=0.8)
            for closure in v.predictions:
                rows = section[
                    (section["closure"] == closure) & (section["quantity"] == quantity) & (section["moment"] == moment)
                ]
                error, low, high = (rows[name] / rows["unit"] for name in ("error", "low", "high"))
                ax.errorbar(
                    rows["impact"] + shift[closure],
                    error,
                    [error - low, high - error],
                    ls="none",
                    ms=4,
                    capsize=2,
                    label=closure,
                    **STYLE[closure],
                )
            if not ((section["quantity"] == quantity) & (section["moment"] == moment)).any():
                ax.text(0.5, 0.75, "no closure predicts it", transform=ax.transAxes, ha="center", color="0.35")
            ax.set_yscale("symlog", linthresh=LINEAR)
            limit = max(10.0, *(abs(t) for t in ax.get_ylim()))
            ax.set_ylim(-limit, limit)
            ax.set_xlim(0.5, len(v.run.section) + 0.5)
            whole_impacts(ax)
            name = SYMBOL[quantity]
            ax.set_title(f"{'mean' if moment == 'mean' else 'sd'} of {name}", loc="left")
            ax.set_xlabel("impact")
            if column == 0:
                ax.set_ylabel("error / sd of the quantity")
    legend_above(figure, axes, 5)
    return figure


def correlation_figure(v: Comparison) -> Figure:
    """Correlation of displacement and velocity per stage: closures before impacts, all of them mid-flight."""
    stages = range(1, v.scene.stages + 1)
    figure, axes = new_figure(5.2 * len(stages), 3.9, 1, len(stages))
    limit, impacts = 1.9, len(v.run.section)
    closures = [name for name, prediction in v.predictions.items() if prediction.trace.parts is None]
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
        for closure, shift in _offsets(closures).items():
            rows = v.correlation[(v.correlation["closure"] == closure) & (v.correlation["stage"] == stage)]
            rho = rows["rho"].clip(-limit + 0.12, limit - 0.12)
            colour, marker = STYLE[closure]["color"], STYLE[closure]["marker"]
            if rho.notna().any():
                ax.plot(rows["impact"] + shift, rho, marker, ms=5, color=colour, label=f"{closure}, before impact")
            broken = rows[rows["rho"].isna() & ~rows["realizable"]]
            if len(broken):
                ax.plot(
                    broken["impact"] + shift,
                    np.full(len(broken), limit - 0.25),
                    "x",
                    ms=6,
                    mew=1.6,
                    color=colour,
                    label=f"{closure}: negative variance",
                )
        fixed = v.table[(v.table["kind"] == "fixed time") & (v.table["quantity"] == f"rho{stage}")]
        for closure in v.predictions:
            rows = fixed[fixed["closure"] == closure].dropna(subset=["predicted"])
            if rows.empty:
                continue
            colour, marker = STYLE[closure]["color"], STYLE[closure]["marker"]
            ax.plot(
                rows["impact"] - 0.5,
                rows["predicted"].clip(-limit, limit),
                marker,
                ms=5,
                mfc="none",
                color=colour,
                label=f"{closure}, mid-flight",
            )
        rows = fixed[fixed["closure"] == closures[0]]
        if len(rows):
            low, high = (rows["predicted"] - rows["high"], rows["predicted"] - rows["low"])
            known = rows["predicted"].notna()
            errors = np.where(known, [rows["simulated"] - low, high - rows["simulated"]], v.z * rows["se"])
            ax.errorbar(
                rows["impact"] - 0.5,
                rows["simulated"],
                np.abs(errors),
                ls="none",
                ms=3.5,
                capsize=2,
                label="Monte Carlo, mid-flight",
                **STYLE["monte carlo"],
            )
        ax.set_ylim(-limit, limit)
        ax.set_xlim(0.0, impacts + 0.5)
        whole_impacts(ax)
        ax.set_xlabel("impact (mid-flight: the flight that it ends)")
        ax.set_ylabel(SYMBOL[f"rho{stage}"])
        ax.set_title(f"stage {stage}", loc="left")
    legend_above(figure, axes, 4)
    return figure


def section_figure(v: Comparison) -> Figure:
    """Histogram of the velocities before each path's own impact, with the densities that the closures predict."""
    impacts = sorted(set(np.linspace(1, len(v.run.section), 4).round().astype(int).tolist()))
    velocities = ["y1", "y2"][: v.scene.stages]
    figure, axes = new_figure(3.0 * len(impacts), 2.7 * len(velocities), len(velocities), len(impacts))
    assert v.run.histograms is not None
    for row, quantity in enumerate(velocities):
        for column, impact in enumerate(impacts):
            ax = axes[row * len(impacts) + column]
            edges, density = v.run.histograms.density(impact, quantity)
            ax.stairs(density, edges, fill=True, color="0.75", label="Monte Carlo, own impact")
            shown = np.flatnonzero(density >= VISIBLE * density.max())
            y = np.linspace(edges[shown[0]], edges[shown[-1] + 1], 600)
            for closure, prediction in v.predictions.items():
                curve = prediction.density(impact, quantity, y)
                if curve is not None:
                    label = f"{closure}, {'mixture' if prediction.trace.parts is not None else 'Edgeworth'}"
                    ax.plot(
                        y,
                        curve,
                        color=STYLE[closure]["color"],
                        lw=1.4,
                        ls="--" if closure == "published" else "-",
                        label=label,
                    )
            ax.set_ylim(0.0, 1.25 * max(density.max(), 1e-12))
            if y[0] < y[-1]:  # the edges of very narrow bins may be the same float
                ax.set_xlim(y[0], y[-1])
            ax.xaxis.set_major_locator(MaxNLocator(4))
            ax.set_title(f"impact {impact}", loc="left")
            ax.set_xlabel(rf"{SYMBOL[quantity]} before impact ($\nu_1\omega$)")
            if column == 0:
                ax.set_ylabel(r"density ($1/\nu_1\omega$)")
    legend_above(figure, axes, 4)
    return figure


def agreement_figure(validations: Sequence[Comparison]) -> Figure:
    """Share of paths on an itinerary so far, per noise intensity; dashed: as `branching` predicts it."""
    first = validations[0]
    closures_by_itinerary: dict[tuple[int, ...], list[str]] = {}  # at the first noise intensity
    for closure, prediction in first.predictions.items():
        closures_by_itinerary.setdefault(prediction.itinerary, []).append(closure)
    figure, axes = new_figure(4.6 * len(closures_by_itinerary), 3.3, 1, len(closures_by_itinerary))
    shades = mpl.colormaps["cividis"](np.linspace(0.0, 0.8, len(validations)))
    for closures, ax in zip(closures_by_itinerary.values(), axes, strict=True):
        for v, shade, marker in zip(validations, shades, "osD^vP*X" * 8, strict=False):
            share = v.run.agreement[closures[0]]
            ax.plot(
                share.index, share, marker=marker, ms=4, lw=1.2, color=shade, label=rf"$\sigma$ = {v.scene.sigma:.4g}"
            )
            if "branching" in closures and "agreement" in v.predictions["branching"].section:
                ax.plot(share.index, v.predictions["branching"].section["agreement"], color=shade, ls="--", lw=1.0)
        ax.set_ylim(-0.03, 1.05)
        whole_impacts(ax)
        ax.set_xlabel("impact")
        ax.set_ylabel("share of paths still on it")
        ax.set_title("itinerary of " + ", ".join(closures), loc="left")
    axes[0].legend(loc="best")
    return figure


class Drawn(NamedTuple):
    """A figure of one validation."""

    draw: Callable[[Comparison], Figure]  # returns the figure of a validation
    caption: tuple[tuple[str, str], ...]  # for `rattle.compare.report.style.caption_of`
    moments: bool = False  # whether it needs a closure with moments of a perturbation, that is one that is no mixture

    def suits(self, v: Comparison) -> bool:
        """Whether a validation has something to draw."""
        return not self.moments or any(m.trace.parts is None for m in v.predictions.values())


FIGURES = {
    "errors": Drawn(
        error_figure,
        (
            (
                "Errors of the closure's section moments per impact, in units of the quantity's sd; bars are intervals "
                "with step bias, the band is what counts as accurate. Beyond 0.1 the scale is logarithmic.",
                "",
            ),
        ),
    ),
    "correlation": Drawn(
        correlation_figure,
        (
            ("Correlation of displacement and velocity per stage.", ""),
            (" Filled: closure just before its impacts.", "before impact"),
            (" Open: closure at mid-flight, next to the Monte Carlo at the same time.", "Monte Carlo, mid-flight"),
            (" No correlation can lie in the shaded zone", ""),
            ("; a cross marks a negative variance", "negative variance"),
            (".", ""),
        ),
        moments=True,
    ),
    "section": Drawn(
        section_figure,
        (
            ("Velocity of each path just before its own impact (histogram)", ""),
            (", and the Edgeworth density of the closures around their mean", "Edgeworth"),
            (", and the density of the mixture", "mixture"),
            (".", ""),
        ),
    ),
}
"""Figures of one validation, by name."""
