r"""
A chemical reaction: two moment closures against Gillespie's algorithm
======================================================================

Molecules are born at a constant rate and vanish in pairs: birth at rate b, and x falls by one at
rate c x (x - 1). The equation of the mean needs the second moment, that of the second the third: a
closure has to guess it. The normal closure takes the third cumulant for 0, the log-normal one takes
:math:`E x^3 = (E x^2)^3 / (E x)^3`. Paths of Gillespie's algorithm are exact, so no step has a
bias; ``rattle.judge`` says how far each closure holds, for many molecules and for few.
"""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

from rattle import judge

DECAY = 0.1
TIMES = np.array([0.5, 1.0, 2.0, 4.0, 8.0])


def gillespie(birth, paths, seed):
    """Numbers of molecules of each path at `TIMES`, from none at the start."""
    rng = np.random.default_rng(seed)
    time, x = np.zeros(paths), np.zeros(paths)
    out = np.full((paths, len(TIMES)), np.nan)
    alive = np.arange(paths)
    while alive.size:
        death = DECAY * x[alive] * (x[alive] - 1.0)
        time[alive] += rng.exponential(size=alive.size) / (birth + death)
        for row, until in enumerate(TIMES):
            passed = alive[(time[alive] > until) & np.isnan(out[alive, row])]
            out[passed, row] = x[passed]
        x[alive] += np.where(rng.random(alive.size) * (birth + death) < birth, 1.0, -1.0)
        alive = alive[time[alive] <= TIMES[-1]]
    return out


def close(birth, third):
    """Mean and sd over time of the moment equations, closed by a guess of the third moment."""

    def slopes(_, moments):
        mean, square = moments
        cube = third(mean, square)
        falls = 2.0 * cube - 3.0 * square + mean  # E (2x - 1) x (x - 1)
        return [birth - DECAY * (square - mean), birth * (2.0 * mean + 1.0) - DECAY * falls]

    start = [1e-6, 1e-6]
    mean, square = solve_ivp(slopes, (0.0, TIMES[-1]), start, t_eval=TIMES, rtol=1e-9).y
    sd = np.sqrt(np.maximum(square - mean**2, 0.0))
    return pd.DataFrame({"x": mean, "sd_x": sd}, pd.Index(TIMES, name="time"))


CLOSURES = {
    "normal": lambda mean, square: 3.0 * mean * square - 2.0 * mean**3,
    "log-normal": lambda mean, square: (square / mean) ** 3,
}
figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
for ax, birth in zip(axes, (1.0, 40.0), strict=True):
    found = judge(
        {name: close(birth, third) for name, third in CLOSURES.items()},
        {"x": gillespie(birth, 40_000, seed=1)},
    )
    print(f"birth rate {birth:g}:", found, sep="\n")
    for name, rows in found.table[found.table["moment"] == "sd"].groupby("closure", sort=False):
        error, low, high = (rows[column] / rows["unit"] for column in ("error", "low", "high"))
        ax.errorbar(rows["time"], error, [error - low, high - error], label=name, capsize=2)
    ax.axhspan(-0.1, 0.1, color="tab:blue", alpha=0.15, label="counts as accurate")
    ax.set(xlabel="time", ylabel="error of the sd, in sds", title=f"birth {birth:g}")
axes[0].legend()
plt.show()
