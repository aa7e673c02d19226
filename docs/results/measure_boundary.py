"""Whether searches find the boundary of `saltation` on DAT21, and at what cost:
docs/results/boundary_seeds.csv.

``python docs/results/measure_boundary.py`` takes ten minutes on one core and continues an
interrupted run.  40 searches, each with its own seed; the true value is where the error of the
worst row of 8 million paths at each of two values is its tolerance; and the path-steps of the study
over the noise intensity, counted with fewer paths.
"""

import math
import tempfile
from dataclasses import replace
from pathlib import Path

import pandas as pd
from kept_tables import Table, keep

from rattle import DAT21, Scene, Study, Tolerances, boundary, mean_map
from rattle.compare.engine.store import Store
from rattle.compare.judge.verdict import JUDGED
from rattle.compare.study.cells import Sample
from rattle.compare.validation.errors import section_errors
from rattle.montecarlo.statistics.intervals import widest

ROOT = Path(__file__).parents[2]
TABLE = Path(__file__).parent / "boundary_seeds.csv"
CELLS = Path(tempfile.gettempdir()) / "rattle-boundary-seeds"
SEEDS = range(40)
SIGMAS = (0.045, 0.048)
PATHS = 8_000_000
IMPACTS = 12
COUNTED = 4096
SCENE = Scene.from_gears(DAT21)


def shares(store, sigma):
    """The error of every judged row over its tolerance, and its standard error."""
    scene = SCENE.with_sigma(sigma)
    run = store.obtain(Sample(scene, IMPACTS, 2026, paths=PATHS))
    rows = section_errors(
        [mean_map(scene, impacts=IMPACTS, closure="saltation")], run, 1.0, Tolerances()
    )
    rows = rows[rows["verdict"].isin(JUDGED)].set_index(["quantity", "moment", "impact"])
    return rows["error"].abs() / rows["tolerance"], rows["noise"] / rows["tolerance"]


def true_boundary(store):
    """Where the first row leaves its tolerance, and its standard error."""
    (one, _), (other, errors) = (shares(store, sigma) for sigma in SIGMAS)
    row = other.idxmax()
    slope = math.log(other[row] / one[row]) / math.log(SIGMAS[1] / SIGMAS[0])
    truth = SIGMAS[1] * math.exp(-math.log(other[row]) / slope)
    assert one.max() < 1.0 < other[row], "the true value lies between the two"
    return truth, truth * errors[row] / other[row] / slope


def table(found: pd.DataFrame) -> Table:
    """Whether the searches hold the true boundary, and at what cost."""
    truth = found["truth"]
    ratio = found["path_steps"] / found["study_path_steps"]
    width = (found["wrong"] - found["accurate"]) / (found["wrong"] + found["accurate"])
    half = widest(1) * found["se_truth"].iloc[0]
    of = found["seed"].nunique()
    held = (found["accurate"] <= truth) & (found["wrong"] >= truth)
    row = {
        "true value of σ": f"{truth.iloc[0]:.4f} ± {half:.4f}",
        "searches that hold it": f"{held.sum()} of {of}",
        "half width: median (most)": f"{width.median():.1%} ({width.max():.1%})",
        "share of the study's path-steps": f"{ratio.median():.1%} ({ratio.max():.1%})",
        "at most a fifth": f"{(ratio <= 0.2).sum()} of {of}",
    }
    return list(row), [list(row.values())]


def main():
    """Write the table."""
    store = Store(CELLS)
    samples = [point.sample for point in Study.load(ROOT / "reports/studies/noise.toml").points]
    counted = [store.obtain(replace(one, paths=COUNTED)).facts["path_steps"] for one in samples]
    study = sum(steps * one.paths / COUNTED for steps, one in zip(counted, samples, strict=True))
    rows = []
    for seed in SEEDS:
        found = boundary(SCENE, rng=seed, folder=CELLS, budget=None)
        for edge in found.edges:
            rows.append(
                {
                    "seed": seed,
                    "accurate": edge.accurate,
                    "wrong": edge.wrong,
                    "path_steps": found.path_steps,
                }
            )
            print(rows[-1], flush=True)
    truth, error = true_boundary(store)
    found = pd.DataFrame(rows).assign(truth=truth, se_truth=error, study_path_steps=study)
    keep(found, TABLE, table, "%.6g")


if __name__ == "__main__":
    main()
