"""How often the 95 % intervals of a long run hold on the gear sets of an engineer:
docs/results/engineers_coverage.csv.

``python docs/results/measure_engineers_coverage.py [SETS]`` (about 40 minutes on one core for all).
What they are compared with is a run of its own, as many times longer as `REFERENCE` says, whose
error is counted.  Intervals that are too narrow on purpose are the negative control.
"""

import math
import sys
import time

import numpy as np
import pandas as pd
from kept_tables import HERE, Table, keep

from rattle.montecarlo.long_run import LongRun, long_run
from rattle.montecarlo.long_run.estimates import StationaryEstimate, groups
from rattle.montecarlo.long_run.run import AtRest, BurnInError
from rattle.montecarlo.statistics.intervals import half_width
from rattle.scene import Scene

TABLE = HERE / "engineers_coverage.csv"
SETS = sorted((HERE / "engineers").glob("*.toml"))
SEEDS = 100
FIRST_SEED = 1000
ACCURACY = 0.02  # of the runs: what decides when they end, as with a user
REFERENCE = 36  # times the work of a run, so that its error is a sixth of theirs or less
REFERENCE_PATHS = 256
LEAST_PERIODS = 64  # of the reference
QUANTITIES = {
    "rate_above": "impacts a second above a speed",
    "power": "power",
    "rms_speed_above": "mean square speed",
    "q95_speed_above": "95 % speed",
}
ROUNDING = 1e-12  # of a value: counts in a locked motion are exact
NARROW = 0.7  # times the stated intervals: hold 83 % of all times, if those hold 95 %


def holds(e: StationaryEstimate, truth: StationaryEstimate, width: float = 1.0) -> bool:
    """Whether an interval, so many times as wide, holds a value that has an error itself."""
    known = half_width(truth.effective_paths) * truth.se
    away = truth.value - e.value
    side = e.high - e.value if away > 0.0 else e.value - e.low
    return abs(away) <= math.hypot(width * side, known) + ROUNDING * abs(truth.value)


def measure_set(scene: Scene) -> list[dict[str, object]]:
    """The rows of a set: each quantity, of all impacts and by mesh."""
    began = time.process_time()
    runs = [long_run(scene, accuracy=ACCURACY, rng=FIRST_SEED + seed) for seed in range(SEEDS)]
    seconds = (time.process_time() - began) / SEEDS
    whole = float(np.mean([run.paths * (run.periods + run.burn_in.periods) for run in runs]))
    periods = max(math.ceil(REFERENCE * whole / REFERENCE_PATHS), LEAST_PERIODS)
    longest = max(run.burn_in.periods for run in runs)
    truth = long_run(scene, periods=periods, paths=REFERENCE_PATHS, burn_in=2 * longest, rng=1)
    return [
        row | {"seconds": seconds, "reference_periods": truth.periods, "held": truth.left_out[0]}
        for row in tabulate(runs, truth)
    ]


def tabulate(runs: list[LongRun], truth: LongRun) -> list[dict[str, object]]:
    """How often the intervals of some runs hold what another one says."""
    rows = []
    for name in QUANTITIES:
        for _, suffix in groups(truth.scene.stages):
            if name + suffix not in truth.estimates:
                continue
            exact = truth.estimates[name + suffix]
            answers = [run.estimates[name + suffix] for run in runs]
            value = np.array([e.value for e in answers])
            spread = float(value.std(ddof=1))
            rows.append(
                {
                    "quantity": name,
                    "group": suffix.removeprefix("_") or "all",
                    "seeds": len(runs),
                    "hold": sum(holds(e, exact) for e in answers),
                    "hold_narrow": sum(holds(e, exact, NARROW) for e in answers),
                    "reference": exact.value,
                    "se_reference": exact.se,
                    "mean": float(value.mean()),
                    "sd_of_estimates": spread,
                    "stated_se": float(np.sqrt(np.mean([e.se**2 for e in answers]))),
                    "z_of_mean": (float(value.mean()) - exact.value)
                    / max(math.hypot(spread / math.sqrt(len(runs)), exact.se), 1e-300),
                }
            )
    return rows


def table(found: pd.DataFrame) -> Table:
    """How many intervals of each quantity hold, by set, and the share of all with its error."""
    rows = []
    for name, of in found.groupby("set"):
        cells = []
        for quantity in QUANTITIES:
            hold = of[of["quantity"] == quantity]["hold"]
            cells.append(" / ".join(f"{int(n)}" for n in hold) or "–")
        closed = f"{of['held'].iloc[0]:.0%}"
        rows.append([str(name), closed, *cells])
    for what, column in (("all", "hold"), (f"all, {NARROW:g} times as wide", "hold_narrow")):
        shares = [
            share_text(found[found["quantity"] == quantity], column) for quantity in QUANTITIES
        ]
        rows.append([what, "", *shares])
    return ["set", "held closed", *QUANTITIES.values()], rows


def share_text(of: pd.DataFrame, column: str) -> str:
    """The share of intervals that hold, with its standard error over sets.

    The three groups of a set share their runs, so the error is that of the sets' shares.
    """
    by_set = of.groupby("set")[[column, "seeds"]].sum()
    share = by_set[column] / by_set["seeds"]
    error = math.sqrt(float((share * (1.0 - share) / SEEDS).sum())) / len(share)
    return f"{share.mean():.1%} ± {error:.1%}"


def main() -> None:
    """Measure what is not yet in the table, set by set, or the sets that are named."""
    made = pd.read_csv(TABLE) if TABLE.exists() else pd.DataFrame({"set": []})
    missing = [file.stem for file in SETS if not (made["set"] == file.stem).any()]
    for name in sys.argv[1:] or missing:
        file = HERE / "engineers" / f"{name}.toml"
        began = time.process_time()
        try:
            rows = measure_set(Scene.load(file))
        except (AtRest, BurnInError) as error:  # no stationary motion, or several
            print(f"{name}: {error}", flush=True)
            continue
        made = pd.concat([made[made["set"] != name], pd.DataFrame(rows).assign(set=name)])
        made = made.sort_values("set", kind="stable")
        print(made[made["set"] == name].to_string(), flush=True)
        print(f"{name}: {time.process_time() - began:.0f} s", flush=True)
        keep(made, TABLE, table, "%.6g")


if __name__ == "__main__":
    main()
