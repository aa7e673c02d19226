"""Figures of section moments, predicted or sampled, of an orbit between its walls, and of a
measured drive."""

from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rattle.scene.types import Constants, Floats, Ints


class ShownFigure(Figure):
    """A figure of matplotlib that a notebook shows, once, as the value of a cell."""

    def _repr_png_(self) -> bytes:
        """The picture that a notebook asks for."""
        picture = BytesIO()
        self.savefig(picture, format="png")
        return picture.getvalue()


def plot_section(columns: Any, quantity: str, unit: str, factor: float, title: str) -> ShownFigure:
    """Draw mean and sd of a quantity just before each impact, with the standard error of the mean
    where there is one.

    `columns` are dimensionless, of shape (impacts,), by their names in a section table; `factor`
    takes them to `unit`.
    """
    mean = factor * columns[quantity]
    sd = factor * columns["sd_" + quantity]
    impact = range(1, len(mean) + 1)
    figure = ShownFigure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.add_subplot()
    axes.fill_between(impact, mean - sd, mean + sd, alpha=0.2, lw=0.0, label="mean ± sd")
    if "se_" + quantity in columns:
        se = factor * columns["se_" + quantity]
        label = "mean, with its standard error"
        axes.errorbar(impact, mean, se, fmt="o-", ms=4, lw=1.2, capsize=2, label=label)
    else:
        axes.plot(impact, mean, "o-", ms=4, lw=1.2, label="mean")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("impact")
    axes.set_ylabel(f"{quantity} before the impact in {unit}")
    axes.set_title(title, loc="left")
    figure.legend(loc="outside upper center", ncols=2, frameon=False)
    return figure


def plot_orbit(
    c: Constants,
    times: Floats,
    states: Floats,
    tau: Floats,
    mesh: Ints,
    before: Floats,
    sticking: Sequence[tuple[int, int, float, float, int]],
) -> ShownFigure:
    """Draw displacements over time, the walls, the impacts at each mesh, and the times in which a
    mesh sticks.

    Shapes: `times` (n,) with `states` (n, 2 wheels); `tau` and `mesh` (impacts,) with the states
    `before` (impacts, 2 wheels); `sticking` as `rattle.scene.orbit.StickingPhase`.
    """
    figure = ShownFigure(figsize=(7.0, 0.6 + 1.8 * c.wheels.size), layout="constrained")
    # a wall that stands alone has no backlash
    unit = " in backlash1" if np.isfinite(c.wheels["low"]).all() else ""
    panels = figure.subplots(c.wheels.size, 1, sharex=True, squeeze=False)[:, 0]
    for i, (ax, wall) in enumerate(zip(panels, c.wheels["wall"], strict=True)):
        here = np.flatnonzero(mesh == i + 1)
        ax.plot(times, states[:, 2 * i], color="#0072B2", lw=1.2)
        ax.plot(
            tau[here],
            before[here, 2 * i],
            "o",
            color="#D55E00",
            ms=4,
            label="impact",
        )
        for flank in (wall, -c.wheels["low"][i]):
            if np.isfinite(flank):
                ax.axhline(flank, color="0.4", lw=1.0)
        phases = [(a, b) for stuck, _, a, b, _ in sticking if stuck == i + 1 and a < times[-1]]
        for number, (closed, opened) in enumerate(phases):
            label = "_" * (number > 0) + "sticks to the wall"
            ax.axvspan(
                closed, min(opened, times[-1]), color="#E69F00", alpha=0.3, lw=0, label=label
            )
        ax.set_ylabel(f"$x_{i + 1}$" + unit)
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False)
    panels[-1].set_xlabel(r"time $\tau = \omega t$")
    return figure


def plot_drive(
    cycle: Floats,
    spread: Floats,
    sum_of_orders: Floats,
    table: Mapping[str, Sequence[Any]],
    what: str,
) -> ShownFigure:
    """Draw a mean period beside the sum of its orders, with what is left out, and the size of each
    order.

    `what`: Name and unit of the quantity.
    """
    figure = ShownFigure(figsize=(7.4, 5.4), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(2.0, 1.0))
    at = np.arange(len(cycle)) / len(cycle)
    low = cycle - spread
    high = cycle + spread
    above.fill_between(at, low, high, color="0.8", lw=0.0, label="scatter of the periods (±1 sd)")
    above.plot(at, cycle, color="0.3", lw=2.0, label="mean period")
    above.plot(at, sum_of_orders, color="#0072B2", lw=1.2, ls="--", label="sum of the orders")
    above.plot(at, cycle - sum_of_orders, color="#D55E00", lw=1.0, label="left out")
    above.set_xlabel("share of a period")
    above.set_ylabel(f"{what}, less its mean")
    orders, amplitude, se = (np.array(table[name]) for name in ("order", "amplitude_mm", "se_mm"))
    pull = orders**2  # acceleration over displacement
    colours = ["#0072B2" if kept else "0.7" for kept in table["kept"]]
    largest = float((pull * amplitude).max())
    errors = {"ecolor": "0.3", "capsize": 2}
    below.bar(
        orders, pull * amplitude / largest, yerr=pull * se / largest, color=colours, error_kw=errors
    )
    below.set_xlabel("order (grey: left out)")
    below.set_ylabel("acceleration\nover the largest")
    below.xaxis.set_major_locator(MaxNLocator(integer=True))
    figure.legend(loc="outside upper center", ncols=4, frameon=False)
    return figure
