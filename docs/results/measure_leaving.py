"""How often the intervals of the probability of leaving hold it: docs/results/leaving_coverage.csv.

``python docs/results/measure_leaving.py [SET ...]`` measures these gear sets, or all twelve (about
twenty minutes on one core), and keeps the other rows.  The first six sets were looked at while the
method was made, the others not.  Of each set the noise is taken at which an exit that is aimed at
has about a given probability.  Truths come from a much longer run that is drawn otherwise, half of
it plainly and the rest wider around points of other pilots, and from plain paths, by their errors;
how far the two are apart is in the table.  The mean over the seeds, which no interval can shift, is
known better, so how often it is held is told too.
"""

import math
import sys
from pathlib import Path
from unittest import mock

import numpy as np
import pandas as pd
from kept_tables import Table, columns, keep, short

from rattle.montecarlo import Record, simulate
from rattle.montecarlo.ensemble import aim
from rattle.montecarlo.kernel.block import (
    BLOCK,
    add_exits,
    follow_itinerary,
    impact_codes,
    sample_mixture,
)
from rattle.montecarlo.kernel.mixture import mixture_of
from rattle.montecarlo.schemes.step_size import default_step
from rattle.montecarlo.settings import EXACT_SCHEME, NOISE_FREE, plan_of

sys.path.append(str(Path(__file__).parents[2] / "tests" / "helpers"))
from random_gears import gear_sets, noisy

TABLE = Path(__file__).parent / "leaving_coverage.csv"
# seeds of the gear sets
TUNED = 42
UNSEEN = 3042
IMPACTS = 5
PATHS = 1024
SEEDS = 200
PROBABILITIES = (1e-3, 1e-4, 1e-5, 1e-6)  # one of each set in turn
NOISES = np.geomspace(0.005, 0.3, 12)
# probabilities of the rows
LEAST = 3e-7
GREATEST = 3e-3
# blocks; share near exits; distance of their points, over the usual
TRUTH_BLOCKS = 384
TRUTH_NEAR = 0.5
WIDER = 0.9
PLAIN_PATHS = 1_000_000
OTHER_SEED = 0xA14  # of the pilots of the truth


def gears():
    """Twelve random gear sets, six of each seed."""
    return [*gear_sets(TUNED)[:6], *gear_sets(UNSEEN)[:6]]


def choose_scene(number, gear_set):
    """The noise at which the probability of an exit that is aimed at is nearest to what is
    wanted."""
    wanted = PROBABILITIES[number % len(PROBABILITIES)]
    best = math.inf
    found = None
    for noise in NOISES:
        scene = noisy(gear_set, noise)
        for one in aim.aim(scene.phase_reduced, IMPACTS, default_step(scene, EXACT_SCHEME)):
            off = abs(math.log(one.probability / wanted))
            if one.effective >= aim.ENOUGH_PATHS and off < best:
                best = off
                found = (noise, scene)
    return found


def find_truth(scene):
    """Probabilities and their variances, from a run that is drawn otherwise; (impacts, codes)
    each."""
    dt = default_step(scene, EXACT_SCHEME)
    with mock.patch.object(aim, "AIM_KEY", OTHER_SEED):
        exits = aim.aim.__wrapped__(scene.phase_reduced, IMPACTS, dt)
    points, shares = aim.share_out(exits)
    scale = TRUTH_NEAR / aim.NEAR_EXITS
    shares = [scale * share for share in shares]
    centre = np.zeros((IMPACTS, 2 + 2 * scene.stages))
    mixture = mixture_of([WIDER * point for point in points], shares, centre, BLOCK)
    plan = plan_of(scene.phase_reduced, BLOCK, IMPACTS, dt, EXACT_SCHEME, OTHER_SEED)
    left = np.zeros((3, IMPACTS, len(impact_codes(scene.stages))))
    orbit = plan.itineraries[NOISE_FREE]
    for block in range(TRUTH_BLOCKS):
        rows, weights, _, _ = sample_mixture(plan, mixture, block)
        _, stays = follow_itinerary(rows, weights, orbit)
        add_exits(rows, weights, orbit, stays, left)
    paths = TRUTH_BLOCKS * BLOCK
    return left[0] / paths, left[1] / paths**2


def measure(number, gear_set):
    """The rows of a gear set: its exits that are aimed at."""
    noise, scene = choose_scene(number, gear_set)
    truths, variances = find_truth(scene)
    apart = Record(on_itinerary=True)
    plain = simulate(scene, paths=PLAIN_PATHS, impacts=IMPACTS, rng=9, record=apart)
    counts = plain.result.followers[NOISE_FREE].left[0]
    runs = [
        simulate(scene, paths=PATHS, impacts=IMPACTS, rng=seed, record=apart).leaving
        for seed in range(SEEDS)
    ]
    codes = impact_codes(scene.stages)
    found = pd.concat(runs).query("near")
    for (impact, mesh, side), rows in found.groupby(["impact", "mesh", "side"]):
        at = impact - 1, codes.index(mesh * side)
        wide = truths[at]
        of_wide = variances[at]
        of_plain = truths[at] / PLAIN_PATHS
        p = (wide / of_wide + counts[at] / PLAIN_PATHS / of_plain) / (
            1.0 / of_wide + 1.0 / of_plain
        )
        se = math.sqrt(1.0 / (1.0 / of_wide + 1.0 / of_plain))
        if not LEAST <= p <= GREATEST:
            continue
        mean = rows["probability"].mean()
        within = [((rows["low"] < one) & (one < rows["high"])).mean() for one in (p, mean)]
        yield {
            "set": number + 1,
            "unseen": number >= 6,
            "stages": scene.stages,
            "noise": noise,
            "impact": impact,
            "mesh": mesh,
            "side": side,
            "truth": p,
            "se_truth": se,
            "plain": counts[at] / PLAIN_PATHS,
            "plain_z": (counts[at] / PLAIN_PATHS - wide) / math.sqrt(of_wide + of_plain),
            "seeds": len(rows),
            "mean": mean / p,
            "se_mean": rows["probability"].std() / p / math.sqrt(len(rows)),
            "scatter": rows["probability"].std() / mean,
            "effective": rows["paths"].median(),
            "coverage": within[0],
            "coverage_of_mean": within[1],
        }


def table(found: pd.DataFrame) -> Table:
    """How often intervals of the probability of leaving hold it."""
    heads, rows = columns(
        found,
        {
            "gear set": lambda r: f"{r['set']}, {'unseen' if r['unseen'] else 'looked at'}",
            "exit": lambda r: f"{r['impact']}: mesh {r['mesh']}, side {r['side']:+d}",
            "truth": lambda r: f"{short(r['truth'])} ± {short(r['se_truth'], 1)}",
            "plain paths": lambda r: short(r["plain"], 2),
            "mean": mean_with_error,
            "scatter": lambda r: f"{r['scatter']:.0%}",
            "95 % intervals that hold the truth": lambda r: f"{r['coverage']:.1%}",
            "the mean": lambda r: f"{r['coverage_of_mean']:.1%}",
        },
    )
    for name, some in (("looked at", found[~found["unseen"]]), ("unseen", found[found["unseen"]])):
        scatter = f"{some['scatter'].median():.0%} (median)"
        every = [
            f"{np.average(some[column], weights=some['seeds']):.1%}"
            for column in ("coverage", "coverage_of_mean")
        ]
        rows.append([f"all {name}", "", "", "", "", scatter, *every])
    return heads, rows


def mean_with_error(row: dict[str, float]) -> str:
    """The mean estimate over the truth, with the errors of both."""
    error = math.hypot(row["se_mean"], row["se_truth"] / row["truth"])
    return f"{row['mean']:.3f} ± {error:.3f}"


if __name__ == "__main__":
    for number, gear_set in enumerate(gears()):
        if len(sys.argv) > 1 and str(number + 1) not in sys.argv[1:]:
            continue
        kept = pd.read_csv(TABLE) if TABLE.exists() else pd.DataFrame({"set": []})
        rows = pd.DataFrame(measure(number, gear_set))
        print(rows.to_string(), flush=True)
        every = pd.concat([one for one in (kept[kept["set"] != number + 1], rows) if len(one)])
        keep(every.sort_values(["set", "impact", "mesh", "side"]), TABLE, table)
