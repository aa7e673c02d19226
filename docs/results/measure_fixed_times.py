"""How far `branching` and `saltation` are off at fixed times: docs/results/fixed_times.csv.

``python docs/results/measure_fixed_times.py`` (about five minutes on one core).  DAT21 and the
first six gear sets were looked at while the closure was made, the others once.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from kept_tables import Table, keep, short

from rattle.closure import follow, mean_map
from rattle.montecarlo import Record, simulate
from rattle.scene import DAT21, Scene
from rattle.scene.types import state_names

sys.path.append(str(Path(__file__).parents[2] / "tests" / "helpers"))
from random_gears import TUNED, gear_sets, noisy

TABLE = Path(__file__).parent / "fixed_times.csv"
SETS = (0, 3, 5, 6, 8, 12)
NOISE = (0.01, 0.03, 0.1, 0.3)
PATHS = 200_000
IMPACTS = 8
TOLD = 0.02  # standard error of an sd, relative to it, above which the sample cannot judge it


def times_of(scene: Scene) -> np.ndarray:
    """Middles of the orbit's flights, and its impacts."""
    tau = follow(replace(scene, sigma=0.0), IMPACTS).tau
    times = np.sort(np.concatenate([0.5 * (tau[1:] + tau[:-1]), tau[1:-1]]))
    return times[times > tau[0] + 0.1]


def errors(
    predicted: pd.DataFrame, simulated: pd.DataFrame, stages: int
) -> tuple[list[float], list[float]]:
    """Errors of means in sds, and relative ones of those sds that the sample tells."""
    mean = []
    sd = []
    for q in state_names(stages):
        variance = simulated[f"cov_{q}_{q}"]
        mean += list((predicted[q] - simulated[q]).abs() / variance**0.5)
        told = 0.5 * simulated[f"se_cov_{q}_{q}"] / variance < TOLD
        sd += list(((predicted[f"cov_{q}_{q}"] / variance) ** 0.5 - 1.0).abs()[told])
    return mean, sd


def measure() -> pd.DataFrame:
    """A row for each gear set and noise intensity; set 0 is DAT21."""
    rows = []
    for i in SETS:
        base = (gear_sets()[i - 1] if i else Scene.from_gears(DAT21)).phase_reduced
        for noise in NOISE:
            scene = noisy(base, noise)
            maps = {
                name: mean_map(scene, impacts=IMPACTS, closure=name)
                for name in ("branching", "saltation")
            }
            last = min(m.trace.span[1] for m in maps.values())
            record = Record(times=[t for t in times_of(scene) if t <= last])
            run = simulate(
                scene,
                paths=PATHS,
                impacts=IMPACTS,
                scheme="exact-flight",
                rng=150 + i,
                record=record,
            )
            simulated = run.at_times()
            row = {
                "set": i,
                "seen": i <= TUNED,
                "stages": scene.stages,
                "noise": noise,
                "times": len(simulated),
            }
            for name, m in maps.items():
                mean, sd = errors(m.at_times(simulated.index), simulated, scene.stages)
                for of, found in (("mean", mean), ("sd", sd)):
                    row |= {
                        f"{name}_{of}_median": np.nanmedian(found),
                        f"{name}_{of}_largest": np.nanmax(found),
                    }
            rows.append(row)
            print(row, flush=True)
    return pd.DataFrame(rows)


def table(found: pd.DataFrame) -> Table:
    """Errors of `branching` and `saltation` at fixed times."""
    sides = [(closure, of) for closure in ("branching", "saltation") for of in ("mean", "sd")]
    rows = []
    for (seen, noise), of in found.groupby(["seen", "noise"]):
        row = ["looked at" if seen else "unseen", short(noise)]
        for closure, moment in sides:
            median = of[f"{closure}_{moment}_median"].median()
            largest = of[f"{closure}_{moment}_largest"].max()
            row.append(f"{short(median, 2)} / {short(largest, 2)}")
        rows.append(row)
    return ["gear sets", "σ/√α", *(f"`{closure}`: {of}" for closure, of in sides)], rows


if __name__ == "__main__":
    keep(measure(), TABLE, table)
