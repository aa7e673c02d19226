"""The figure of the section moments that a closure predicts or a simulation finds."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from matplotlib.ticker import MaxNLocator

from rattle.scene.figure import ShownFigure
from rattle.scene.moments import SECTION
from rattle.scene.scene import Scene
from rattle.scene.units import units_of
from rattle.scene.validate import choice

if TYPE_CHECKING:
    import pandas as pd


def plot_section(
    columns: "Mapping[str, Any] | pd.DataFrame", scene: Scene, quantity: str, units: str, title: str
) -> ShownFigure:
    """Draw mean and sd of a quantity just before each impact, with the standard error of the mean where there is one.

    `columns` are dimensionless, of shape (impacts,), by their names in a section table.
    """
    choice("quantity", quantity, SECTION[: 2 + 2 * scene.stages])
    unit, factor = units_of(units, scene.gears)[quantity]
    mean, sd = factor * columns[quantity], factor * columns["sd_" + quantity]
    impact = range(1, len(mean) + 1)
    figure = ShownFigure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.add_subplot()
    axes.fill_between(impact, mean - sd, mean + sd, alpha=0.2, lw=0.0, label="mean ± sd")
    if "se_" + quantity in columns:
        se, label = factor * columns["se_" + quantity], "mean, with its standard error"
        axes.errorbar(impact, mean, se, fmt="o-", ms=4, lw=1.2, capsize=2, label=label)
    else:
        axes.plot(impact, mean, "o-", ms=4, lw=1.2, label="mean")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("impact")
    axes.set_ylabel(f"{quantity} before the impact in {unit}")
    axes.set_title(f"{title}, sigma = {scene.sigma:.4g}", loc="left")
    figure.legend(loc="outside upper center", ncols=2, frameon=False)
    return figure
