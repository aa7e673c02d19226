"""What sampling rare branches on purpose gains, and whether its intervals hold:
docs/results/rare_branches.csv.

``python docs/results/measure_rare.py [SCENE ...]`` measures these scenes, or all (about ten minutes
on one core), and keeps the other rows.  Each scene is sampled by 1000 seeds from one mixture; the
truth is their mean, and plain paths check it.  The probability of the branch that matters most is
given to first order, from paths near its design point, and from plain paths.
"""

import math
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from kept_tables import Table, columns, keep, short

from rattle.montecarlo import simulate
from rattle.montecarlo.branches.choose import choose_mixture, steps_of
from rattle.montecarlo.branches.search import SMALLEST, search_of
from rattle.montecarlo.kernel.block import BLOCK, run, sample_mixture
from rattle.montecarlo.kernel.mixture import mixture_of
from rattle.montecarlo.settings import NOISE_FREE
from rattle.scene import DAT21, Scene
from rattle.scene.types import section_names

sys.path.append(str(Path(__file__).parents[2] / "tests" / "helpers"))
from random_gears import PAIR_A, PAIR_B

TABLE = Path(__file__).parent / "rare_branches.csv"
SEEDS = 1000
SEED_BLOCKS = 32
PLAIN_PATHS = 4_000_000
PILOT = 32 * BLOCK
SCENES = {
    "DAT21, 0.06": (Scene.from_gears(DAT21, sigma=0.06), 4),
    "DAT21, 0.08": (Scene.from_gears(DAT21, sigma=0.08), 3),
    "DAT21, 0.1": (Scene.from_gears(DAT21, sigma=0.1), 3),
    "DAT21, 0.09": (Scene.from_gears(DAT21, sigma=0.09), 3),
    "DAT21, 0.2": (Scene.from_gears(DAT21, sigma=0.2), 3),
    "pair A": (PAIR_A, 2),
    "pair B": (PAIR_B, 2),
}


def estimate(plan, mixture, seed):
    """Moments of one seed's paths."""
    own = plan._replace(seed=np.random.SeedSequence(seed))
    merged = None
    for block in range(SEED_BLOCKS):
        result, _ = run(own._replace(mixture=mixture), block)
        merged = result if merged is None else merged.merge(result)
    return merged.sums["weighted"].moments()


def probability(plan, branch, orbit):
    """Probability of leaving the orbit at a branch's impact by what it strikes: near its design
    point; its error."""
    mixture = mixture_of([branch.shift], [0.5], np.zeros((plan.impacts, 6)), BLOCK)
    rows, weights = map(
        np.concatenate, zip(*(sample_mixture(plan, mixture, b)[:2] for b in range(32)), strict=True)
    )
    k = branch.impact - 1
    off = (rows[:, k, 6] != orbit[k]) & (rows[:, :k, 6] == orbit[:k]).all(axis=1)
    hits = weights[:, k] * off
    return hits.mean(), hits.std() / math.sqrt(hits.size)


def measure(name):
    """The scene's row."""
    scene, impacts = SCENES[name]
    pilot = simulate(scene, paths=PILOT, impacts=impacts, rng=1)
    plain = simulate(scene, paths=PLAIN_PATHS, impacts=impacts, rng=2)
    mixture = choose_mixture(pilot)
    if mixture is None:
        return {"scene": name, "impacts": impacts}
    found = [estimate(pilot.plan, mixture, 1000 + seed) for seed in range(SEEDS)]
    covered = []
    worst = 0.0
    gains = {}
    kurtosis = {}
    for k in range(impacts):
        for q, quantity in enumerate(section_names(scene.stages)):
            own = quantity == f"x{plain.columns['mesh'][k]}"
            if own or not plain.columns["sd_" + quantity][k] > 1e-9:
                continue
            for moment, column in (("mean", quantity), ("sd", "sd_" + quantity)):
                values, errors = (
                    np.array([f[n][k, q] for f in found]) for n in (moment, "se_" + moment)
                )
                truth = values.mean()
                spread = values.std()
                covered.append((np.abs(values - truth) < 1.96 * errors).mean())
                z = (truth - plain.columns[column][k]) / math.hypot(
                    spread / SEEDS**0.5, plain.columns["se_" + column][k]
                )
                worst = max(worst, abs(z))
                at_equal = (
                    plain.columns["se_" + column][k] ** 2 * PLAIN_PATHS / (SEED_BLOCKS * BLOCK)
                )
                gains[k + 1, quantity, moment] = at_equal / spread**2
            kurtosis[k + 1, quantity] = plain.columns["kurt_" + quantity][k] + 3.0
    k, quantity = max(kurtosis, key=kurtosis.get)
    orbit = np.array(pilot.plan.itineraries[NOISE_FREE])
    found = search_of(scene.phase_reduced, impacts, pilot.dt).until(SMALLEST)
    branches = found.within(steps_of(pilot))
    first = max(
        (b for b in branches if b.probability < 0.02),
        key=lambda b: mixture.boost(b.shift) * b.probability,
    )
    near, error = probability(pilot.plan, first, orbit)
    agreement = np.append(1.0, plain.columns["agreement"])
    return {
        "scene": name,
        "impacts": impacts,
        "branch": f"{first.impact}: {first.mesh * first.side:+d}",
        "first_order": first.probability,
        "near": near,
        "se_near": error,
        "plain": agreement[first.impact - 1] - agreement[first.impact],
        "parts": len(mixture.unit),
        "worst_row": f"{quantity} at {k}",
        "kurtosis": kurtosis[k, quantity],
        "gain": gains[k, quantity, "sd"],
        "median_gain": float(np.median(list(gains.values()))),
        "least_gain": min(gains.values()),
        "rows": len(covered),
        "largest_z": worst,
        "coverage": float(np.mean(covered)),
        "least_coverage": min(covered),
        "most_coverage": max(covered),
    }


def table(found: pd.DataFrame) -> Table:
    """What sampling rare branches gains, and whether its intervals hold."""
    heads, rows = columns(
        found,
        {
            "scene": name_with_impacts,
            "branch (impact: struck instead)": "branch",
            "first order": lambda r: short(r["first_order"], 2),
            "near": lambda r: f"{short(r['near'])} ± {short(r['se_near'], 1)}",
            "plain": "plain",
            "worst row (kurtosis)": lambda r: f"{r['worst_row']} ({r['kurtosis']:,.0f})",
            "its variance falls": lambda r: f"{r['gain']:,.0f}",
            "median row": lambda r: short(r["median_gain"], 2),
            "largest z": lambda r: f"{r['largest_z']:.1f}",
            "intervals that hold (worst row)": lambda r: (
                f"{r['coverage']:.1%} ({r['least_coverage']:.1%})"
            ),
        },
    )
    for row, sampled in zip(rows, found["parts"] > 0.0, strict=True):
        if not sampled:
            row[1:] = ["none is worth it", *["–"] * 8]
    return heads, rows


def name_with_impacts(row: dict[str, object]) -> str:
    """The name of a scene, and its impacts."""
    return f"{row['scene']}, {row['impacts']} impacts"


if __name__ == "__main__":
    for name in sys.argv[1:] or SCENES:
        rows = {row["scene"]: row for row in pd.read_csv(TABLE).to_dict("records")} | {
            name: measure(name)
        }
        print(rows[name], flush=True)
        keep(pd.DataFrame([rows[one] for one in SCENES if one in rows]), TABLE, table)
