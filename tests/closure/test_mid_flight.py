"""The saltation closure between impacts: sds and rho of all paths at one time, against
simulation."""

import numpy as np
import pandas as pd
import pytest
from common_scenes import SCENES

from rattle.closure import follow, mean_map
from rattle.montecarlo import Record, simulate
from rattle.scene import STATE

LIMIT = 4.0  # standard errors; of at most 72 moments of a scene, Bonferroni at 0.5 %
SIGMA = 0.002
DT = 1e-3
PATHS = 30_000
CLEAR = 6.0  # sds of the impact times that must fit between a fixed time and the impacts around it
SHORT = 100 * DT  # shorter flights have too few steps
SHIFTED = 10 * DT  # bias of an impact time above which later flights are left out: a near graze
# relative change by a doubled step above which a moment is left out: an sd near a focus, say
COARSE = 0.05


def middles(orbit, run):
    """Mid-flight times that all paths reach along the orbit's itinerary, in flight, and well
    resolved."""
    sd_tau = run.section["sd_tau"]
    agreement = run.agreement["noise-free"]
    shift = (
        run.step_bias.query("quantity == 'tau' and moment == 'mean'")
        .set_index("impact")["bias"]
        .abs()
    )
    times = []
    for k in range(1, orbit.found + 1):
        half = 0.5 * (orbit.tau[k] - orbit.tau[k - 1])
        if (
            agreement.loc[k] < 1.0
            or half < CLEAR * sd_tau.loc[max(k - 1, 1) : k].max()
            or shift.loc[k] > SHIFTED
        ):
            break
        if 2.0 * half > SHORT:
            times.append(orbit.tau[k] - half)
    return times


def sampled(scene):
    """Sds and rho of the simulation at mid-flight with standard errors and the change that doubling
    the step makes."""
    orbit = follow(scene, 12)
    all_middles = 0.5 * (orbit.tau[1 : orbit.found + 1] + orbit.tau[: orbit.found])
    record = Record(times=all_middles[all_middles > 4.0 * DT])
    run = simulate(
        scene, paths=PATHS, dt=DT, scheme="euler-maruyama-located", rng=5, workers=2, record=record
    )
    fixed = run.at_times()
    coarse = run.result.sums["coarse_fixed"]
    parts = []
    for i, name in enumerate(STATE[: 2 * scene.stages]):
        variance = fixed[f"cov_{name}_{name}"]
        sd = np.sqrt(variance)
        doubled = np.sqrt(coarse.moment(*((2, 0), (0, 2))[i % 2])[:, i // 2])
        se = 0.5 * fixed[f"se_cov_{name}_{name}"] / sd
        parts.append(
            pd.DataFrame({"what": name, "value": sd, "se": se, "step": doubled - sd, "unit": sd})
        )
    for name in ("rho1", "rho2")[: scene.stages]:
        change = fixed[f"coarse_{name}"] - fixed[name]
        parts.append(
            pd.DataFrame(
                {
                    "what": name,
                    "value": fixed[name],
                    "se": fixed[f"se_{name}"],
                    "step": change,
                    "unit": 1.0,
                }
            )
        )
    table = pd.concat(parts).reset_index()
    judged = np.abs(table["time"].to_numpy()[:, None] - middles(orbit, run)).min(axis=1) <= 2.0 * DT
    # false where sds are 0: stage 2 before an impact, damped alike
    fine = table["step"].abs() < COARSE * table["unit"]
    return table[judged & fine]


def excess(table, prediction, scale=1.0):
    """Standard errors by which a closure, its covariances times `scale`, is beyond what the step
    size explains."""
    fixed = prediction.at_times(sorted(set(table["time"])))
    predicted = pd.concat(
        [np.sqrt(scale * fixed[f"cov_{name}_{name}"]).rename(name) for name in STATE]
        + [fixed[["rho1", "rho2"]]],
        axis=1,
    )
    value = np.array(
        [predicted.loc[t, w] for t, w in zip(table["time"], table["what"], strict=True)]
    )
    return (np.abs(value - table["value"]) - table["step"].abs()) / table["se"]


@pytest.mark.parametrize(
    "name", [n if n == "DAT21" else pytest.param(n, marks=pytest.mark.slow) for n in SCENES]
)
def test_sds_and_rho_between_impacts(name):
    scene = SCENES[name](SIGMA)
    table = sampled(scene)
    assert table["time"].nunique() >= 4
    found = excess(table, mean_map(scene, impacts=12))
    assert (found < LIMIT).all(), table.assign(excess=found)[found > LIMIT]
    # negative control: covariances 5 % too large, and the closure whose impact times do not vary
    assert (excess(table, mean_map(scene, impacts=12), scale=1.05) > LIMIT).any()
    assert (
        excess(table, mean_map(scene, impacts=12, closure="corrected")) > LIMIT
    ).sum() > 0.2 * len(table)
