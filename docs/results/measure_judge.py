"""How often `rattle.judge` calls an exact closure inaccurate, and finds a planted error:
docs/results/judge_rates.csv.

``python docs/results/measure_judge.py`` takes about a minute.  Each run has one quantity of one
row, and each of 2,000 runs its own samples.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from kept_tables import Table, columns, keep, share

import rattle as rt

TABLE = Path(__file__).parent / "judge_rates.csv"
RUNS = 2000
PATHS = (100, 1000, 10_000, 30_000)
RUNS_AT_ONCE = 100
RARE = 1e-4  # weight of the far part of the mixture
FAR = 10.0  # its distance, in sds of the rest
VARIANCE = 1.0 + FAR**2 * RARE * (1.0 - RARE)
THIRD = FAR**3 * RARE * (1.0 - RARE) * (1.0 - 2.0 * RARE)
FOURTH = (
    3.0
    + 6.0 * FAR**2 * RARE * (1.0 - RARE)
    + FAR**4 * RARE * (1.0 - RARE) * (1.0 - 3.0 * RARE * (1.0 - RARE))
)
E = np.e
DISTRIBUTIONS = {
    "normal": (
        lambda random, shape: random.normal(size=shape),
        {"x": 0.0, "sd_x": 1.0, "skew_x": 0.0, "kurt_x": 0.0},
    ),
    "log-normal, sd of the logarithm 1": (
        lambda random, shape: random.lognormal(size=shape),
        {
            "x": np.sqrt(E),
            "sd_x": np.sqrt((E - 1.0) * E),
            "skew_x": (E + 2.0) * np.sqrt(E - 1.0),
            "kurt_x": E**4 + 2.0 * E**3 + 3.0 * E**2 - 6.0,
        },
    ),
    "Student's t, 3 degrees of freedom": (
        lambda random, shape: random.standard_t(3, size=shape),
        {"x": 0.0, "sd_x": np.sqrt(3.0)},
    ),
    "normal, 1 in 10,000 at ten sds": (
        lambda random, shape: random.normal(size=shape) + FAR * (random.random(shape) < RARE),
        {
            "x": FAR * RARE,
            "sd_x": np.sqrt(VARIANCE),
            "skew_x": THIRD / VARIANCE**1.5,
            "kurt_x": FOURTH / VARIANCE**2 - 3.0,
        },
    ),
}


def judge_runs(draw, moments, paths, seed):
    """The rows of all runs, for a closure with these moments."""
    parts = []
    for part in range(RUNS // RUNS_AT_ONCE):
        samples = draw(np.random.default_rng([seed, part]), (paths, RUNS_AT_ONCE))
        claim = {column: np.full(RUNS_AT_ONCE, value) for column, value in moments.items()}
        found = rt.judge(claim, {"x": samples}, checks=len(moments)).table
        parts.append(found.assign(row=found["row"] + part * RUNS_AT_ONCE))
    return pd.concat(parts)


def measure(name, paths, seed):
    """A row of the table."""
    draw, moments = DISTRIBUTIONS[name]
    exact = judge_runs(draw, moments, paths, seed)
    sd = moments["sd_x"]
    wrong = moments | {"x": moments["x"] + 0.1 * sd, "sd_x": 1.2 * sd}
    planted = judge_runs(draw, wrong, paths, seed)
    result = {"distribution": name, "paths": paths, "runs": RUNS}
    result["false"] = exact[exact["verdict"] == "inaccurate"]["row"].nunique()
    for moment in ("mean", "sd"):
        rows = planted[(planted["moment"] == moment) & planted["enough_paths"]]
        result[f"enough_{moment}"] = len(rows)
        result[f"found_{moment}"] = int((rows["verdict"] == "inaccurate").sum())
    return result


def table(found: pd.DataFrame) -> Table:
    """The table of the page."""

    def power(moment):
        def cell(row):
            enough = row[f"enough_{moment}"]
            return share(row[f"found_{moment}"], int(enough)) if enough else "never enough paths"

        return cell

    return columns(
        found,
        {
            "distribution": "distribution",
            "paths": "paths",
            "exact closure called inaccurate": lambda row: share(row["false"], int(row["runs"])),
            "0.1 sd in a mean found": power("mean"),
            "20 % in an sd found": power("sd"),
        },
    )


if __name__ == "__main__":
    rows = [
        measure(name, paths, seed) for seed, name in enumerate(DISTRIBUTIONS) for paths in PATHS
    ]
    keep(pd.DataFrame(rows), TABLE, table)
