"""The figure behind `rattle.montecarlo.Ensemble.plot_section`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rattle.scene.moments import SECTION
from rattle.scene.units import check_units
from rattle.scene.validate import choice

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rattle.montecarlo.result import Ensemble

__all__ = ["plot_section"]


def plot_section(run: Ensemble, quantity: str, units: str) -> Figure:
    """Draw mean and standard deviation of a quantity just before each path's own impacts.

    Parameters
    ----------
    run : Ensemble
        What was simulated.
    quantity : {"tau", "flight", "x1", "y1", "x2", "y2"}
        What is drawn.
    units : {"dimensionless", "physical"}
        Units of the axis.

    Returns
    -------
    Figure
        Of matplotlib.

    Raises
    ------
    InputError
        For an unknown quantity, or physical units of a scene that was not made from gears.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    choice("quantity", quantity, SECTION)
    gears = run.scene.gears
    unit, factor = "", 1.0
    if check_units(units, gears) == "physical" and gears is not None:
        name, factor = gears.units.columns_of[quantity]
        unit = " in " + name.removeprefix(quantity + "_").replace("_per_", "/")
    impact = range(1, run.impacts + 1)
    mean, sd, se = (factor * run.columns[prefix + quantity] for prefix in ("", "sd_", "se_"))
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.add_subplot()
    axes.fill_between(impact, mean - sd, mean + sd, alpha=0.2, lw=0.0, label="mean ± sd of the paths")
    axes.errorbar(impact, mean, se, fmt="o-", ms=4, lw=1.2, capsize=2, label="mean, with its standard error")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("impact")
    axes.set_ylabel(f"{quantity} before the impact{unit}")
    axes.set_title(f"{run.paths:,} paths, sigma = {run.scene.sigma:.4g}", loc="left")
    axes.legend(loc="best", frameon=False)
    return figure
