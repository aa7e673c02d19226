"""Measure how often an exactly right closure is called inaccurate, and whether an accuracy bounds
the errors.

``python docs/results/measure_unseen.py [SCENE ...]`` measures these scenes, or all (about twenty
minutes on one core), and keeps the other rows of docs/results/unseen.csv.  The stand-in of an exact
closure is a much larger, independent ensemble of exact flights.
"""

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pandas as pd
from kept_tables import Table, columns, keep
from kept_tables import share as share_with_interval

from rattle.compare.judge.verdict import Tolerances
from rattle.compare.validation import errors
from rattle.compare.validation.errors import judge_again, section_errors
from rattle.montecarlo import AccuracyWarning, simulate, simulate_to
from rattle.montecarlo.diagnostics.accuracy import units
from rattle.montecarlo.diagnostics.unseen import Unseen
from rattle.montecarlo.statistics.intervals import AGAIN, widest
from rattle.scene import Scene, Start
from rattle.scene.types import section_names

sys.path.append(str(Path(__file__).parents[2] / "tests" / "helpers"))
from random_gears import PAIR_B

TABLE = Path(__file__).parent / "unseen.csv"
IMPACTS = 4
TRUTH = 2_000_000
SEEDS = 400
PATHS = (4096, 32_768)
ACCURACY = 0.03
RUNS = 50


def scenes() -> dict[str, Scene]:
    """Four random gear sets at two noise intensities each, of one and two stages, and the pair."""
    rng = np.random.default_rng(2026)
    found = {}
    for name, stages in (("A", 2), ("B", 1), ("C", 2), ("D", 1)):
        alpha = float(np.exp(rng.uniform(np.log(0.5), np.log(3.0))))
        values = {
            "alpha": alpha,
            "epsilon": float(rng.uniform(0.3, 0.95)),
            "beta1": float(rng.uniform(0.0, 0.3)),
            "beta2": float(rng.uniform(0.0, 0.3)),
            "gamma1": float(rng.uniform(0.0, 0.2)),
            "gamma2": float(rng.uniform(0.0, 0.2)),
            "mu": float(rng.uniform(0.2, 0.8)),
            "gap2": float(rng.uniform(0.2, 1.0)),
        }
        for share in (0.05, 0.3):
            start = Start(mesh=1, x1=0.5, y1=2.0, x2=0.0, y2=0.5 * (stages - 1))
            found[f"{name}, {share:g}"] = Scene(
                sigma=share * alpha**0.5, stages=stages, start=start, **values
            )
    return found | {"pair": PAIR_B}


@contextmanager
def _nothing_unseen(wheels: int, impacts: int) -> Iterator[None]:
    """Context in which verdicts are as they were before rare branches and skewness counted."""
    nil = np.zeros((impacts, len(section_names(wheels))))
    with (
        mock.patch.object(
            errors, "unseen", return_value=Unseen(nil, nil, nil, nil, nil, nil, impacts)
        ),
        mock.patch.object(errors, "find_lean", lambda _, steps: np.zeros(len(steps))),
    ):
        yield


def _verdicts(scene: Scene, truth: pd.DataFrame, paths: int) -> list[pd.DataFrame]:
    """Verdicts on an exact closure, one row for each seed: without what cannot be seen, with it,
    and judged again."""
    exact = SimpleNamespace(closure="exact", section=truth)
    checks = 2 * len(section_names(scene.stages)) * len(truth)
    z = widest(checks)
    tables = list[list[pd.Series]]([[], [], []])
    for seed in range(SEEDS):
        run = simulate(scene, paths=paths, impacts=len(truth), scheme="exact-flight", rng=seed)
        with _nothing_unseen(scene.stages, len(truth)):
            before = section_errors([exact], run, z, Tolerances())
        bounded = section_errors([exact], run, z, Tolerances())
        again, _ = judge_again(bounded, [exact], run, widest(checks, 0.05 * AGAIN), Tolerances(), 1)
        for found, table in zip(tables, (before, bounded, again), strict=True):
            found.append(table.loc[table["judged"].astype(bool), "verdict"].reset_index(drop=True))
    return [pd.DataFrame(found) for found in tables]


def _covered(scene: Scene, truth: pd.DataFrame) -> tuple[int, int]:
    """Runs that reached the accuracy, and those of them whose largest true error is within it."""
    reached = held = 0
    for seed in range(RUNS):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AccuracyWarning)
            run = simulate_to(
                scene,
                ACCURACY,
                impacts=len(truth),
                scheme="exact-flight",
                rng=1000 + seed,
                budget=3.0,
            )
        unit = units(run)
        off = [
            ((run.section[p + q] - truth[p + q]).abs() / unit[q]).max()
            for q in section_names(scene.stages)
            for p in ("", "sd_")
        ]
        reached += run.reach.reached
        held += run.reach.reached and float(np.nanmax(off)) <= ACCURACY
    return reached, held


def measure(name: str, scene: Scene) -> Iterator[dict[str, object]]:
    """The rows of a scene."""
    pair = name == "pair"
    truth = simulate(
        scene, paths=TRUTH * (4 if pair else 1), impacts=2 if pair else IMPACTS, rng=99
    )
    told = ("tau", "y1", "y2")[: 1 + scene.stages]
    kurtosis = float(np.nanmax([truth.section[f"kurt_{q}"] for q in told]))
    for paths in PATHS:
        found = {
            "scene": name,
            "stages": scene.stages,
            "epsilon": scene.epsilon,
            "sigma": scene.sigma,
        }
        found |= {"kurtosis": kurtosis, "paths": paths, "seeds": SEEDS}
        for suffix, table in zip(
            ("_without", "", "_again"), _verdicts(scene, truth.section, paths), strict=True
        ):
            found["inaccurate" + suffix] = int((table == "inaccurate").sum().max())
            found["wrong" + suffix] = int((table == "inaccurate").any(axis=1).sum())
            found["decided" + suffix] = float(
                table.isin(["accurate", "inaccurate"]).to_numpy().mean()
            )
        if paths == PATHS[-1] and name in ("A, 0.3", "B, 0.3", "C, 0.3", "D, 0.3"):
            found["reached"], found["held"] = _covered(scene, truth.section)
        yield found


def table(found: pd.DataFrame) -> Table:
    """How often an exactly right closure is called inaccurate, with and without the bound of unseen
    branches."""
    return columns(
        found,
        {
            "scene": "scene",
            "largest kurtosis": "kurtosis",
            "paths": "paths",
            "called inaccurate": lambda r: f"{r['inaccurate']} of {r['seeds']}",
            "without": lambda r: f"{r['inaccurate_without']} of {r['seeds']}",
            "any row, judged again": lambda r: share_with_interval(r["wrong_again"], r["seeds"]),
            "rows decided": lambda r: f"{r['decided']:.1%}",
            "decided without": lambda r: f"{r['decided_without']:.1%}",
            "decided, judged again": lambda r: (
                f"{r['decided_again']:.1%}" if r["decided_again"] > 0.0 else ""
            ),
            "0.03 sd reached, and true": lambda r: (
                f"{r['held']:.0f} of {r['reached']:.0f}" if r["reached"] > 0.0 else ""
            ),
        },
    )


if __name__ == "__main__":
    every = scenes()
    for name in sys.argv[1:] or every:
        for found in measure(name, every[name]):
            print(found, flush=True)
            known = {
                (row["scene"], row["paths"]): row for row in pd.read_csv(TABLE).to_dict("records")
            }
            known[name, found["paths"]] = found
            order = [(one, paths) for one in every for paths in PATHS if (one, paths) in known]
            keep(pd.DataFrame([known[cell] for cell in order]), TABLE, table, "%.6g")
