"""How often the interval of `measure_drive` holds the noise of made measurements:
docs/results/drive_noise.csv.

``python docs/results/measure_drive_noise.py`` (about ten minutes on one core, with
``OPENBLAS_NUM_THREADS=1``).
"""

import math
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from kept_tables import Table, columns, keep, share, short

from rattle.scene.measured_drive import measure_drive

sys.path.append(str(Path(__file__).parents[2] / "tests" / "helpers"))
from measurements import QUANTITIES, measure

TABLE = Path(__file__).parent / "drive_noise.csv"
ORDERS = ((1, 1.0, -1.0), (4, 0.12, 0.5))
OMEGA = 417.0
PERIODS = 60
SEEDS = 200
SETTINGS = (
    (48, 0.0, (0.0005, 0.002, 0.05, 0.15)),
    (48, 0.001, (0.0, 0.05)),
)
"""Samples in a period, the sd of the noise of the measurement over the amplitude of order 1, and
sigma over alpha."""
PLANTED = 1.5  # times the true noise: what an interval should not hold


def run(samples: int, noise: float, quantity: str, ratio: float) -> dict[str, object]:
    """A row: how often the interval holds what was put into the files."""
    times = np.arange(samples * PERIODS) * 2.0 * math.pi / OMEGA / samples
    own = noise * OMEGA ** QUANTITIES.index(quantity)
    found = []
    for seed in range(SEEDS):
        text = measure(OMEGA, ORDERS, times, quantity=quantity, ratio=ratio, seed=seed, noise=own)
        found.append(measure_drive(text, omega=OMEGA))
    return {
        "samples": samples,
        "noise": noise,
        "quantity": quantity,
        "sigma": ratio,
        "seeds": SEEDS,
        "hold": sum(f.low <= ratio <= f.high for f in found),
        "hold_planted": sum(f.low <= PLANTED * ratio <= f.high for f in found),
        "at_most": sum(f.low == 0.0 for f in found),
        "median_sigma": np.median([f.sigma_ratio for f in found]),
        "median_high": np.median([f.high for f in found]),
        "median_floor": np.median([f.floor for f in found]),
    }


def table(found: pd.DataFrame) -> Table:
    """How often the interval holds the noise that was put into made measurements."""
    return columns(
        found,
        {
            "file": "quantity",
            "noise of the measurement": lambda r: f"{r['noise']:.1%}",
            "σ/α": "sigma",
            "median found": "median_sigma",
            "intervals that hold it (95 % interval)": lambda r: share(r["hold"], r["seeds"]),
            "that hold 1.5 times as much": lambda r: (
                "" if r["sigma"] == 0.0 else f"{r['hold_planted']} of {r['seeds']}"
            ),
            "said as “at most”": lambda r: f"{r['at_most']} of {r['seeds']}",
            "floor": lambda r: short(r["median_floor"], 2),
        },
    )


if __name__ == "__main__":
    rows = []
    for samples, noise, ratios in SETTINGS:
        for quantity in QUANTITIES:
            for ratio in ratios:
                rows.append(run(samples, noise, quantity, ratio))
                print(rows[-1], flush=True)
                keep(pd.DataFrame(rows), TABLE, table)
