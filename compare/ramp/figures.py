"""The figure of a run-up."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rattle.compare.report.style import ACCURATE_COLOUR, STYLE, error_bars, legend_above, new_figure

RAMP_COLOUR = "#D55E00"
LABELS = {
    "rate_above": "impacts a second\nthat are not slow",
    "speed_above": "their mean speed (mm/s)",
    "power": "power lost (mW)",
}


def run_up_figure(table: pd.DataFrame, thresholds: pd.DataFrame, speeds: pd.Series) -> Figure:
    """Draw every quantity over the speed, at constant speeds and in the ramp, with intervals; a
    speed without a result interrupts the line."""
    figure, axes = new_figure(7.4, 7.2, len(LABELS), 1)
    constant: Any = {"color": STYLE["monte carlo"]["color"], "fmt": "o-", "ms": 4, "capsize": 2}
    crossings = thresholds.dropna(subset="rpm")
    for ax, name in zip(axes, LABELS, strict=True):
        rows: Any = table[table["quantity"] == name].sort_values("rpm")
        steady = rows.set_index("rpm").reindex(speeds)
        ax.errorbar(
            speeds,
            steady["value"],
            yerr=np.nan_to_num(error_bars(steady)),
            lw=0.9,
            label="constant speed, 95 % interval",
            **constant,
        )
        if "ramp" in rows:
            ax.plot("ramp_rpm", "ramp", data=rows, color=RAMP_COLOUR, lw=1.2, label="ramp")
            ax.fill_between(
                "ramp_rpm",
                "ramp_low",
                "ramp_high",
                data=rows,
                color=RAMP_COLOUR,
                alpha=0.25,
                lw=0.0,
                label="ramp: 95 % interval",
            )
        for motion, style in (("constant speed", "--"), ("ramp", ":")):
            for rpm in crossings.loc[crossings["motion"] == motion, "rpm"]:
                label = f"threshold of rattle, {motion}"
                ax.axvline(rpm, color=ACCURATE_COLOUR, ls=style, lw=1.2, label=label)
        ends = (0.97 * speeds.min(), 1.03 * speeds.max())
        ax.set(ylabel=LABELS[name], ylim=(0.0, None), xlim=ends)
    axes[-1].set_xlabel("mean speed of the driver (1/min)")
    legend_above(figure, 3)
    return figure
