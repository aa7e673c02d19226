"""What a long run leaves out at closed meshes, compared with every impact followed, and how often
its intervals hold: docs/results/chatter.csv.

``python docs/results/measure_chatter.py`` (about half an hour on one core).  The run with every
impact followed has as many times the work of a default run to 2 % as `WORK` says.
"""

import math
import time

import numpy as np
import pandas as pd
from kept_tables import HERE, Table, columns, keep, share, short

from rattle.montecarlo.long_run import LongRun, long_run
from rattle.scene import Order, Scene

TABLE = HERE / "chatter.csv"
SETS = 10
SEED = 46
SINGLE, ORDERS, MEMORY = 5, 6, 7  # sets of one stage, with drive orders, with noise of a memory
PATHS = 32
PERIODS = 64
BURN_IN = 32
WORK = 50.0
LONGEST_WHOLE = 120.0  # processor seconds: where WORK takes more, the run is not made longer
QUANTITIES = (
    "rate_above",
    "speed_above",
    "power",
    "q95_speed_above_mesh1",
    "q95_speed_above_mesh2",
)
COVERED = QUANTITIES[:3]
SEEDS = 40
FEW_SEEDS = 20  # of sets that follow more than so many impacts a period
MANY_IMPACTS = 500
ACCURACY = 0.02
PLANTED = 1.05  # times the value of the run that leaves impacts out


def draw_scene(number: int) -> Scene:
    """Gears that chatter, in dimensionless numbers; the constants of
    `rattle.montecarlo.schemes.quiet` were chosen on other ones."""
    rng = np.random.default_rng([SEED, number])
    alpha = float(np.exp(rng.uniform(math.log(1.0), math.log(5.0))))
    gamma = alpha * rng.uniform(0.12, 0.35)
    single = number == SINGLE
    values = {
        "alpha": alpha,
        "epsilon": rng.uniform(0.3, 0.7),
        "beta1": rng.uniform(1e-3, 0.1),
        "gamma1": gamma,
        "sigma": alpha * math.exp(rng.uniform(math.log(0.01), math.log(0.06))),
    }
    if not single:
        values |= {
            "beta2": rng.uniform(1e-3, 0.1),
            "gamma2": gamma * rng.uniform(0.5, 1.2),
            "mu": rng.uniform(0.3, 0.7),
            "gap2": rng.uniform(0.3, 0.5),
        }
    values["stages"] = 1 if single else 2
    if number == ORDERS:
        values["drive"] = (Order(1, 1.0, 0.0), Order(2, 0.2, 1.1), Order(3, 0.05, -0.4))
    if number == MEMORY:
        values["correlation_time"] = 0.5
    return Scene(**values)


def follow(
    scene: Scene, seed: int, resolve: float | None, periods: int = PERIODS
) -> tuple[LongRun, float]:
    """A long run, and its processor time."""
    began = time.process_time()
    run = long_run(scene, periods=periods, paths=PATHS, burn_in=BURN_IN, resolve=resolve, rng=seed)
    return run, time.process_time() - began


def follow_whole(scene: Scene, answer: float) -> tuple[LongRun, float]:
    """The run with every impact followed, and its processor time: about `WORK` times the seconds of
    a default answer, where that can be afforded."""
    whole, seconds = follow(scene, 1, 0.0)
    times = WORK * answer / seconds
    if not times > 1.0 or WORK * answer > LONGEST_WHOLE:
        return whole, seconds
    return follow(scene, 1, 0.0, math.ceil(times * (PERIODS + BURN_IN)) - BURN_IN)


def rows_of(number: int) -> list[dict[str, object]]:
    """The rows of a set."""
    scene = draw_scene(number)
    part, seconds_part = follow(scene, 2, None)
    began = time.process_time()
    seeds = FEW_SEEDS if part.impacts > MANY_IMPACTS * PATHS * PERIODS else SEEDS
    runs = [long_run(scene, accuracy=ACCURACY, rng=100 + seed) for seed in range(seeds)]
    seconds = (time.process_time() - began) / seeds
    whole, seconds_whole = follow_whole(scene, seconds)
    rows = []
    for name in QUANTITIES:
        if name not in whole.estimates:
            continue
        a = whole.estimates[name]
        b = part.estimates[name]
        se = math.hypot(a.se, b.se)
        row: dict[str, object] = {
            "set": number,
            "epsilon": scene.epsilon,
            "sigma_ratio": scene.sigma / scene.alpha,
            "quantity": name,
            "whole": a.value,
            "se_whole": a.se,
            "part": b.value,
            "se_part": b.se,
            "z": (b.value - a.value) / se,
            "z_planted": (PLANTED * b.value - a.value) / se,
            "impacts_whole": whole.impacts / (PATHS * whole.periods),
            "periods_whole": whole.periods,
            "impacts_part": part.impacts / (PATHS * PERIODS),
            "seconds_whole": seconds_whole,
            "seconds_part": seconds_part,
            "above_left_out": part.left_out[2] / part.estimates["rate_above"].value,
            "seconds_of_answer": seconds,
        }
        if name in COVERED:
            answers = [run.estimates[name] for run in runs]
            # of all seeds together: its error is a tenth of theirs
            mean = float(np.mean([e.value for e in answers]))
            row["seeds"] = seeds
            row["hold"] = sum(e.low <= mean <= e.high for e in answers)
            row["hold_planted"] = sum(e.low <= PLANTED * mean <= e.high for e in answers)
        rows.append(row)
    return rows


def pace(row: pd.Series, run: str) -> float:
    """Processor seconds of `PERIODS` periods after the burn-in, of the longer run too."""
    periods = row["periods_whole"] if run == "whole" else PERIODS
    return float(row[f"seconds_{run}"] * (PERIODS + BURN_IN) / (periods + BURN_IN))


def table(found: pd.DataFrame) -> Table:
    """The differences in standard errors by set, the work saved, and coverage."""
    sets = []
    for number, rows in found.groupby("set"):
        first = rows.iloc[0]
        covered = rows[rows["quantity"].isin(COVERED)]
        sets.append(
            {
                "set": number,
                "epsilon": first["epsilon"],
                "sigma_ratio": first["sigma_ratio"],
                "z": rows["z"].abs().max(),
                "z_planted": rows["z_planted"].abs().min(),
                "impacts_whole": first["impacts_whole"],
                "impacts_part": first["impacts_part"],
                "work": first["seconds_whole"] / first["seconds_of_answer"],
                "pace_whole": pace(first, "whole"),
                "pace_part": pace(first, "part"),
                "above_left_out": first["above_left_out"],
                "seconds_of_answer": first["seconds_of_answer"],
                "hold": int(covered["hold"].sum()),
                "seeds": int(covered["seeds"].sum()),
            }
        )
    return columns(
        pd.DataFrame(sets),
        {
            "set": "set",
            "ε": "epsilon",
            "σ/α": "sigma_ratio",
            "largest difference, in standard errors": "z",
            "smallest with 5 % put in": "z_planted",
            "impacts followed a period: all / by default": lambda r: (
                f"{short(r['impacts_whole'])} / {short(r['impacts_part'])}"
            ),
            "CPU-s of 32 paths and 96 periods": lambda r: (
                f"{short(r['pace_whole'])} / {short(r['pace_part'])}"
            ),
            "work of the run with all, in default runs to 2 %": lambda r: f"{r['work']:.0f}",
            "fast impacts left out, at most": lambda r: (
                "below 1e-6" if r["above_left_out"] < 1e-6 else f"{r['above_left_out']:.1g}"
            ),
            "CPU-s to 2 %": "seconds_of_answer",
            "intervals that hold (95 % interval)": lambda r: share(r["hold"], r["seeds"]),
        },
    )


if __name__ == "__main__":
    made = pd.read_csv(TABLE) if TABLE.exists() else pd.DataFrame({"set": []})
    for number in range(SETS):
        if (made["set"] == number).any():
            continue  # measured before: remove its rows to measure it again
        made = pd.concat([made, pd.DataFrame(rows_of(number))]).sort_values("set", kind="stable")
        print(made[made["set"] == number].to_string(), flush=True)
        keep(made, TABLE, table)
