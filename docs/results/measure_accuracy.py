"""What an accuracy takes on unseen random gear sets, and whether it is kept:
docs/results/accuracy_cells.csv.

``python docs/results/measure_accuracy.py [CELL ...]`` measures these cells, or all (about ten
minutes on one core), and keeps the other rows of the table.  The true error of a run is estimated
from a finer one of another seed.
"""

import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
from kept_tables import Table, keep, median_and_most, short

from rattle.montecarlo import AccuracyWarning, simulate, simulate_to
from rattle.montecarlo.accuracy.cost import cost_of, cost_to
from rattle.montecarlo.diagnostics.accuracy import units
from rattle.montecarlo.ensemble.simulate_rare import simulate_rare
from rattle.scene import DAT21, Scene
from rattle.scene.types import section_names

sys.path.append(str(Path(__file__).parents[2] / "tests" / "helpers"))
from random_gears import gear_sets, noisy

ROOT = Path(__file__).parents[2]
HEADS = [
    "cells",
    "accuracy",
    "number",
    "core-seconds: median (most)",
    "within 20 s and 5 min",
    "reached in 20 s",
    "true error within it",
    "largest difference from the reference",
]
TABLE = Path(__file__).parent / "accuracy_cells.csv"
SEED = 29
SETS = 8
NOISE = (0.01, 0.03, 0.1, 0.3)
# core-seconds of a run and of its reference
BUDGET = 20.0
FINER = 4.0


def cells():
    """Scenes and accuracies by name."""
    random = gear_sets(SEED, SETS)
    found = {
        f"{i + 1}, {noise:g}": (noisy(random[i], noise), 0.02)
        for i in range(SETS)
        for noise in NOISE
    }
    dat21 = Scene.from_gears(DAT21, sigma=0.1)
    pair = Scene.load(ROOT / "tests/compare/cli/pair.toml")
    return found | {
        "DAT21, 0.01": (dat21, 0.01),
        "DAT21, 0.001": (dat21, 0.001),
        "pair, 0.01": (pair, 0.01),
    }


def distance(run, truth):
    """Largest difference of two runs in units of the second, its standard error there, and that
    less two of them."""
    unit = units(truth).to_numpy().T
    worst = (0.0, 0.0)
    least = 0.0
    for i, q in enumerate(section_names(run.scene.stages)):
        for p in ("", "sd_"):
            off = np.nan_to_num(np.abs(run.columns[p + q] - truth.columns[p + q]) / unit[i])
            error = np.nan_to_num(truth.columns[f"se_{p}{q}"] / unit[i])
            k = int(off.argmax())
            worst = max(worst, (off[k], error[k]))
            least = max(least, float((off - 2.0 * error).max()))
    return *worst, least


def measure(name, scene, accuracy):
    """The row of a cell."""
    simulate(scene, paths=8)  # compiles
    simulate_rare(scene, paths=8, impacts=1)
    began = time.process_time()
    run = simulate_to(scene, accuracy, rng=1, budget=BUDGET)
    used = time.process_time() - began
    reached = run.reach.reached
    row = {
        "cell": name,
        "stages": scene.stages,
        "epsilon": scene.epsilon,
        "sigma": scene.sigma,
        "accuracy": accuracy,
        "reached": reached,
        "counted": (cost_of(run, run.paths) if reached else cost_to(run, accuracy)).core_seconds,
        "measured": used + run.reach.more_seconds,
        "paths": run.paths,
        "bound": run.reach.bound,
        "branches": 0 if run.plan.mixture is None else len(run.plan.mixture.unit),
        "missed": len(run.reach.missed),
        "worst": run.reach.missed[0].sentence if run.reach.missed else "",
    }
    truth = simulate_to(scene, 0.5 * accuracy, rng=2, budget=FINER)
    error, se, least = distance(run, truth)
    return row | {
        "error": error,
        "se_reference": se,
        "kept": least <= (accuracy if reached else run.reach.bound),
    }


def table(found: pd.DataFrame) -> Table:
    """What an accuracy takes, and its true error: of each noise of the random sets, and of the
    others by name."""
    random = found["cell"].str.match(r"\d")
    ratio = found["cell"].str.split(", ").str[1]
    groups = [(f"random, σ/√α = {name}", of) for name, of in found[random].groupby(ratio)]
    groups += [("random, all", found[random])]
    groups += [(r["cell"], found.loc[[i]]) for i, r in found[~random].iterrows()]
    rows = []
    for name, of in groups:
        reached = of[of["reached"]]
        row = [name, f"{of['accuracy'].iloc[0]:g}", str(len(of))]
        row += [median_and_most(of["counted"], " (", ")")]
        row += [f"{(of['counted'] <= 20.0).sum()} and {(of['counted'] <= 300.0).sum()}"]
        true = f"{reached['kept'].sum()} of {len(reached)}" if len(reached) else "–"
        rows.append([*row, str(len(reached)), true, short(reached["error"].max(), 2)])
    return HEADS, rows


if __name__ == "__main__":
    warnings.simplefilter("ignore", AccuracyWarning)
    every = cells()
    for name in sys.argv[1:] or every:
        found = measure(name, *every[name])
        print(found, flush=True)
        known = pd.read_csv(TABLE).to_dict("records") if TABLE.exists() else []
        rows = {row["cell"]: row for row in known} | {name: found}
        keep(pd.DataFrame([rows[cell] for cell in every if cell in rows]), TABLE, table)
