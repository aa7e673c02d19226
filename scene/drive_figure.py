"""The figure of a measured drive."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from rattle.scene.shown_figure import ShownFigure
from rattle.scene.types import Floats


def plot_drive(
    cycle: Floats, spread: Floats, sum_of_orders: Floats, table: Mapping[str, Sequence[Any]], what: str
) -> ShownFigure:
    """Draw a mean period beside the sum of its orders, with what is left out, and the size of each order.

    `what`: Name and unit of the quantity.
    """
    figure = ShownFigure(figsize=(7.4, 5.4), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(2.0, 1.0))
    at = np.arange(len(cycle)) / len(cycle)
    low, high = cycle - spread, cycle + spread
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
    below.bar(orders, pull * amplitude / largest, yerr=pull * se / largest, color=colours, error_kw=errors)
    below.set_xlabel("order (grey: left out)")
    below.set_ylabel("acceleration\nover the largest")
    below.xaxis.set_major_locator(MaxNLocator(integer=True))
    figure.legend(loc="outside upper center", ncols=4, frameon=False)
    return figure
