"""Section statistics of exact flights on DAT21, with standard errors from the scatter of independent groups of paths.

``python exact_distribution.py FOLDER`` samples 10^7 paths an intensity in 64 groups (ten minutes on one core).
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from mc_checks import dat21

from rattle.montecarlo import simulate
from rattle.montecarlo.kernel.block import PAIRS
from rattle.scene.moments import SECTION

SIGMAS, IMPACTS = {"0.1": 0.1, "sqrt 1.5": 1.5**0.5}, 12
GROUPS, PATHS = 64, 160 * 1024
NAMES = ("tau", "x1", "y1", "x2", "y2")


def statistics(scene, paths, rng):
    """Mean, sd and skewness of each section quantity and correlation of each pair, a row of (impact, name) to value."""
    run = simulate(scene, paths=paths, impacts=IMPACTS, scheme="exact-flight", rng=rng)
    sums, pairs = run.result.sums["section"], run.result.sums["section_pairs"]
    sd = np.sqrt(sums.moment(2, 0))
    sd[sd < 1e-9] = np.nan  # on its own wall a displacement varies by rounding only
    with np.errstate(invalid="ignore", divide="ignore"):
        columns = {f"mean {q}": sums.mean[0][:, i] for i, q in enumerate(SECTION)}
        columns |= {f"sd {q}": sd[:, i] for i, q in enumerate(SECTION)}
        columns |= {f"skewness {q}": (sums.moment(3, 0) / sd**3)[:, i] for i, q in enumerate(SECTION)}
        for k, (i, j) in enumerate(PAIRS):
            a, b = SECTION.index(NAMES[i]), SECTION.index(NAMES[j])
            columns[f"rho {NAMES[i]} {NAMES[j]}"] = pairs.moment(1, 1)[:, k] / (sd[:, a] * sd[:, b])
    return pd.DataFrame(columns, index=pd.Index(range(1, IMPACTS + 1), name="impact")).stack(future_stack=True)


def grouped(scene, groups, paths, seed):
    """Statistics of independent groups of paths, a column each."""
    seeds = [np.random.SeedSequence([seed, g]) for g in range(groups)]
    return pd.concat([statistics(scene, paths, rng) for rng in seeds], axis=1)


def averages(groups):
    """Averages over groups, and their standard errors."""
    return pd.DataFrame({"value": groups.mean(axis=1), "se": groups.std(axis=1) / np.sqrt(groups.shape[1])})


def main(folder, seed=1):
    """Write a file for each group and intensity; a killed run goes on where it was."""
    Path(folder).mkdir(exist_ok=True)
    for g in range(GROUPS):
        for name, sigma in SIGMAS.items():
            file = Path(folder, f"{name} {g}.csv")
            if not file.exists():
                statistics(dat21(sigma), PATHS, np.random.SeedSequence([seed, g])).to_csv(file, float_format="%.12g")


def table(folder):
    """The table of a folder of groups."""
    read = {}
    for name in SIGMAS:
        groups = [pd.read_csv(file, index_col=[0, 1]) for file in Path(folder).glob(f"{name} *.csv")]
        read[name] = averages(pd.concat(groups, axis=1))
    return pd.concat(read, names=["sigma", "impact", "statistic"])


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
