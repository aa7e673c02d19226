"""What rare branches gain: variance at equal processor time, and a z-test over 1000 seeds, against exact flights.

``python tests/montecarlo/measure_rare.py SCENE`` (``0.06``, ``0.1`` or ``pair``; about three minutes each on one core)
replaces that scene's row of docs/results/rare_branches.csv.
"""

import math
import sys
import time
from pathlib import Path
from statistics import NormalDist

import numpy as np
import pandas as pd

from rattle.montecarlo import simulate, simulate_rare
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.rare.design_points import find_branches, pilot_of
from rattle.montecarlo.rare.mixture import choose_branches, mixture_of
from rattle.montecarlo.rare.simulate_rare import run_block
from rattle.montecarlo.rare.weighted_moments import ORDERS, add, moments
from rattle.montecarlo.settings.plan import NOISE_FREE, plan_of
from rattle.scene import DAT21, Scene, Start

TABLE = Path(__file__).resolve().parents[2] / "docs" / "results" / "rare_branches.csv"
PAIR = Scene(
    alpha=0.511, epsilon=0.447, beta1=0.101, beta2=0.091, gamma1=0.004, gamma2=0.098, mu=0.625, gap1=0.5, gap2=0.959,
    sigma=0.4, start=Start(tau=2.66, x1=0.15, y1=-0.37, x2=-0.58, y2=1.82, mesh=0),
)  # fmt: skip
PATHS, SLICES, SEEDS, SEED_BLOCKS = 2**18, 5, 1000, 2
QUANTITIES = ("tau", "flight", "x1", "y1", "x2", "y2")


def scene_of(name):
    """Scene and number of impacts."""
    return (PAIR, 2) if name == "pair" else (Scene.from_gears(DAT21, sigma=float(name)), 12)


def judged(plain):
    """Rows that are compared: quantities that vary and are not on their own struck wall."""
    return [
        (k, name)
        for k in plain.index
        for name in QUANTITIES
        if name != ("x1" if plain["mesh"][k] == 1 else "x2") and plain["sd_" + name][k] > 1e-9
    ]


def compared(scene, impacts):
    """Sections of both sides in turn, with the processor time of each, everything included."""
    sides, seconds = ([], []), [0.0, 0.0]
    for seed in range(SLICES + 1):
        for side, follow in enumerate((lambda **k: simulate(scheme="exact-flight", **k), simulate_rare)):
            paths = PATHS if seed else BLOCK  # the first compiles
            started = time.process_time()
            run = follow(scene=scene, paths=paths, impacts=impacts, rng=100 * seed + side)
            if seed:
                seconds[side] += time.process_time() - started
                sides[side].append(run.section)
    return sides, seconds, run


def pooled(sections, column):
    """Root mean square of a standard error over the slices."""
    return np.sqrt(np.mean([s[column] ** 2 for s in sections], axis=0))


def z_test(scene, impacts, sections, rows):
    """Largest |z| of the mean over all seeds against exact flights, and the share of seeds whose intervals hold it."""
    plan = plan_of(scene, paths=BLOCK, impacts=impacts, dt=math.pi / 96, scheme="exact-flight", rng=0)
    codes = np.array(plan.itineraries[NOISE_FREE])
    pilot = pilot_of(plan, codes)
    mixture = mixture_of(choose_branches(find_branches(plan, codes, pilot.sd)[0]))
    counts = np.append(mixture.counts.ravel(), BLOCK - mixture.counts.sum())
    ends, found = np.cumsum(counts), []
    for seed in range(SEEDS):
        sums = np.zeros((counts.size, impacts, 6, ORDERS))
        own = plan._replace(seed=np.random.SeedSequence(10_000 + seed))
        for block in range(SEED_BLOCKS):
            path, weights = run_block(own, mixture, block)
            for k, end in enumerate(ends):
                add(path[end - counts[k] : end], weights[end - counts[k] : end], pilot.mean, sums[k])
        found.append(moments(sums, SEED_BLOCKS * counts.astype(float), pilot.mean))
    worst, covered = 0.0, []
    for k, name in rows:
        q = QUANTITIES.index(name)
        for i, column in ((0, name), (2, "sd_" + name)):
            values = np.array([f[i][k - 1, q] for f in found])
            errors = np.array([f[i + 1][k - 1, q] for f in found])
            values = values**2 if i else values  # variances are unbiased, sds of small samples are not
            errors = 2.0 * np.sqrt(values) * errors if i else errors
            known = np.array([s[column][k] for s in sections])
            known = known**2 if i else known
            se = np.mean([s["se_" + column][k] ** 2 for s in sections]) ** 0.5 / math.sqrt(len(sections))
            se *= 2.0 * math.sqrt(known.mean()) if i else 1.0
            z = (values.mean() - known.mean()) / math.hypot(values.std() / math.sqrt(SEEDS), se)
            worst = max(worst, abs(z))
            covered.append((abs(values - values.mean()) < 1.96 * errors).mean())
    return worst, -NormalDist().inv_cdf(0.025 / len(covered)), float(np.mean(covered)), min(covered)


def measure(name):
    """The scene's row."""
    scene, impacts = scene_of(name)
    (plain, rare), seconds, last = compared(scene, impacts)
    rows = judged(plain[0])
    ratio = seconds[1] / seconds[0]
    gains, kurtosis = {}, {}
    for column in ("", "sd_"):
        for k, q in rows:
            a, b = (pooled(s, f"se_{column}{q}")[k - 1] for s in (plain, rare))
            gains[k, q, column] = (a / b) ** 2 / ratio
            kurtosis[k, q] = float(np.mean([s["kurt_" + q][k] for s in plain])) + 3.0
    k, q = max(kurtosis, key=kurtosis.get)
    worst, allowed, covered, least = z_test(scene, impacts, plain, rows)
    return {
        "scene": "DAT21" if name != "pair" else "random pair", "sigma": scene.sigma, "impacts": impacts,
        "branches": "; ".join(f"{b.impact}: {b.code:+d}, beta {b.beta:.2f}" for b in last.sampled),
        "worst_row": f"{q} at {k}", "kurtosis": kurtosis[k, q], "gain": gains[k, q, "sd_"],
        "gain_of_its_mean": gains[k, q, ""], "median_gain": float(np.median(list(gains.values()))),
        "least_gain": min(gains.values()), "time_ratio": ratio, "rows": len(gains), "largest_z": worst,
        "allowed_z": allowed, "coverage": covered, "least_coverage": least,
    }  # fmt: skip


if __name__ == "__main__":
    row = measure(sys.argv[1])
    table = pd.read_csv(TABLE) if TABLE.exists() else pd.DataFrame(columns=list(row))
    table = table[(table["scene"] != row["scene"]) | (table["sigma"] != row["sigma"])]
    table = pd.concat([table, pd.DataFrame([row])]) if len(table) else pd.DataFrame([row])
    table.sort_values(["scene", "sigma"]).to_csv(TABLE, index=False, float_format="%.4g")
    print(row)
