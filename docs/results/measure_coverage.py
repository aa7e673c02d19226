"""Measure how often stated 95 % intervals of the long run hold the truth; writes
docs/results/coverage.csv.

Run by hand: ``python docs/results/measure_coverage.py [seeds]``.  Every seed is a run of its own,
with its own burn-in; the truth is the mean of all.  The naive interval treats impacts as
independent.
"""

import math
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from kept_tables import Table, columns, keep, short

from rattle.montecarlo.long_run import long_run
from rattle.montecarlo.statistics.intervals import half_width
from rattle.scene import DAT21, Scene

TABLE = Path(__file__).parent / "coverage.csv"
SEEDS = 400
SIGMA = 0.01
RUNS = ((256, 64), (64, 64), (256, 512))
"""Paths and periods of a run; the first paths are the default ones."""
QUANTITIES = (
    "rate",
    "speed",
    "energy_per_period",
    "slow_share",
    "sd_speed",
    "q05_speed",
    "q95_speed",
)


def coverage(paths: int, periods: int, seeds: int = SEEDS) -> pd.DataFrame:
    """Coverage of each quantity: share of seeds whose interval holds the mean of all, and that of
    naive intervals."""
    scene = Scene.from_gears(DAT21, sigma=SIGMA)
    found = {name: [] for name in QUANTITIES}
    for seed in range(seeds):
        run = long_run(scene, periods=periods, paths=paths, rng=10_000 + seed)
        for name in QUANTITIES:
            found[name].append(run.estimates[name])
    rows = []
    for name, every in found.items():
        value = np.array([e.value for e in every])
        se = np.array([e.se for e in every])
        low = np.array([e.low for e in every])
        high = np.array([e.high for e in every])
        memory = float(np.mean([e.autocorrelation for e in every]))
        truth = float(value.mean())
        inside = (low <= value.mean()) & (value.mean() <= high)
        away = np.abs(value - truth)
        half = float(half_width(math.inf)) * se
        share = float(inside.mean())
        rows.append(
            {
                "quantity": name,
                "sigma": SIGMA,
                "seeds": seeds,
                "paths": paths,
                "periods": periods,
                "value": truth,
                "sd_of_estimates": float(value.std(ddof=1)),
                "stated_se": float(np.sqrt((se**2).mean())),
                "coverage": share,
                "se_coverage": math.sqrt(share * (1.0 - share) / seeds),
                "autocorrelation": memory,
                "naive_coverage": float((away <= half / math.sqrt(memory)).mean()),
            }
        )
    return pd.DataFrame(rows)


def table(found: pd.DataFrame) -> Table:
    """How often the intervals hold the truth, and how often naive ones would."""
    rate = found[found["quantity"] == "rate"].set_index(["paths", "periods"])["value"]

    def impacts_of(r: dict[str, float]) -> str:
        duration = r["periods"] * 2.0 * math.pi
        return short(float(f"{rate[r['paths'], r['periods']] * r['paths'] * duration:.2g}"))

    return columns(
        found.sort_values(["paths", "periods"], kind="stable"),
        {
            "paths × periods": lambda r: f"{r['paths']} × {r['periods']}",
            "impacts": impacts_of,
            "runs": lambda r: f"{r['seeds']}",
            "quantity": "quantity",
            "mean of all runs": lambda r: short(r["value"], 4),
            "intervals that hold it": lambda r: f"{r['coverage']:.1%} ± {r['se_coverage']:.1%}",
            "naive ones": lambda r: f"{r['naive_coverage']:.1%}",
            "autocorrelation (impacts)": "autocorrelation",
            "stated error / spread of the runs": lambda r: short(
                r["stated_se"] / r["sd_of_estimates"]
            ),
        },
    )


if __name__ == "__main__":
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS
    found = pd.DataFrame()
    for size in RUNS:
        found = pd.concat([found, coverage(*size, wanted)], ignore_index=True)
        keep(found, TABLE, table, "%.6g")
        print(found.to_string(index=False), flush=True)
