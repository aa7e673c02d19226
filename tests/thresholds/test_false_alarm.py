"""The stated false-alarm rate against the measured one, over seeds; the rate of wrong passes beside it.

A true claim fails most easily where the model is exactly as wrong as it may be.  Intervals are two-sided, and an error
at one edge of what is allowed can be missed on one side only: so a single row fails with half the stated rate there,
and with all of it where nothing is allowed.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binomtest

from compare.moments import widest
from compare.thresholds.claim import read_claim
from compare.thresholds.judging import errors_of, judged
from compare.thresholds.prediction import Prediction
from montecarlo import simulate
from montecarlo.accumulate import single_statistics
from montecarlo.control import controlled_statistics
from scene import DAT21, Scene
from scene.moments import SECTION

SCENE = Scene.from_gears(DAT21, sigma=0.05, stages=1)
IMPACTS, PATHS, SEEDS = 2, 1024, 1000
SETTINGS = {"impacts": IMPACTS, "scheme": "exact-flight", "control": True}
RATE = 0.1
CONFIDENCE = 0.999
STATED = SECTION[:4]  # of a single stage


@dataclass
class Stacked:
    """Many runs below each other, the impacts of run i at ``i * IMPACTS + 1, ...``."""

    section: pd.DataFrame

    @property
    def agreement(self):
        return self.section[["agreement"]]

    @property
    def step_bias(self):
        nothing = {"bias": 0.0, "se_bias": 0.0, "rest": 0.0}
        parts = [
            pd.DataFrame({
                "impact": self.section.index, "quantity": q, "moment": moment, **nothing,
                "corrected": self.section[prefix + q], "se_corrected": self.section["se_" + prefix + q],
            })
            for moment, prefix in (("mean", ""), ("sd", "sd_"))
            for q in STATED
        ]  # fmt: skip
        return pd.concat(parts, ignore_index=True)


def columns_of(run):
    """What `Ensemble.section` holds of means and sds, without the time that tables take."""
    s = single_statistics(run.result.sums["section"])
    s |= controlled_statistics(run.result.sums["control"], run.plan.control.variance)
    names = {"": "mean", "sd_": "sd", "se_": "se_mean", "se_sd_": "se_sd"}
    return {prefix + q: s[name][:, i] for prefix, name in names.items() for i, q in enumerate(STATED)}


@pytest.fixture(scope="module")
def truth():
    return simulate(SCENE, paths=2**19, rng=10**9, workers=2, **SETTINGS).section


@pytest.fixture(scope="module")
def runs():
    found = [columns_of(simulate(SCENE, paths=PATHS, rng=seed, **SETTINGS)) for seed in range(SEEDS)]
    table = pd.DataFrame({name: np.concatenate([f[name] for f in found]) for name in found[0]})
    table.index += 1
    return Stacked(table.assign(paths=PATHS, agreement=1.0))


def outcomes(runs, truth, displaced, rate=RATE, impacts=(1, 2), naive=(), **options):
    """Outcomes, shape (sessions, rows), of a model that is `displaced` allowed errors away from the truth.

    `naive` leaves a correction out: the one for the number of "rows", or the one for the "unit" being measured.
    """
    places = [i * IMPACTS + k for i in range(SEEDS) for k in impacts]
    claim = read_claim({"scene": SCENE, "impacts": places, "quantities": ["tau", "y1"], **options}, Path())
    whole = pd.concat([truth] * SEEDS, ignore_index=True)
    whole.index += 1
    off = whole.copy()
    for moment, allowed in claim.allowed.items():
        for q in claim.quantities:
            unit = whole["sd_" + q] if allowed.in_sd else 1.0
            off[("" if moment == "mean" else "sd_") + q] += displaced * allowed.error * unit
    errors = errors_of(Prediction("truth", off), runs, claim)
    if "unit" in naive:
        errors["noise"] = errors["se"]
    rows = len(claim.rows) // SEEDS
    table = judged(errors, widest(1 if "rows" in naive else rows, rate))
    table["session"] = (table["impact"] - 1) // IMPACTS
    return table.sort_values("session", kind="stable")["outcome"].to_numpy().reshape(SEEDS, rows)


def share(hits):
    """Share of sessions with its interval."""
    found = binomtest(int(hits.sum()), len(hits)).proportion_ci(CONFIDENCE)
    return found.low, hits.mean(), found.high


def failing(found):
    return share((found == "fail").any(axis=1))


def passing(found):
    return share((found == "pass").all(axis=1))


ONE = {"impacts": (2,), "quantities": "y1", "moments": "mean"}


def test_one_row_that_is_allowed_nothing_fails_at_the_stated_rate(runs, truth):
    low, measured, high = failing(outcomes(runs, truth, 0.0, **ONE, absolute=1e-12))
    assert low <= RATE <= high, measured


@pytest.mark.parametrize("edge", [-1.0, 1.0])
def test_one_row_at_the_edge_fails_at_half_the_stated_rate(runs, truth, edge):
    low, measured, high = failing(outcomes(runs, truth, edge, **ONE, absolute=2e-3))
    assert low <= 0.5 * RATE <= high, measured
    low, measured, high = failing(
        outcomes(runs, truth, edge, **ONE, within=0.05)
    )  # its bound on the error is not tight
    assert low <= 0.5 * RATE, measured
    assert high >= 0.25 * RATE, measured


@pytest.mark.parametrize("within", [0.05, 0.5])
@pytest.mark.parametrize("edge", [-1.0, 0.0, 1.0])
def test_sessions_whose_claims_are_true_fail_at_most_at_the_stated_rate(runs, truth, edge, within):
    low, measured, _ = failing(outcomes(runs, truth, edge, within=within))
    assert low <= RATE, measured
    assert edge or measured == 0.0


def test_without_a_correction_it_would_be_found_out(runs, truth):
    low, _, _ = failing(outcomes(runs, truth, 1.0, within=0.05, naive=("rows",)))
    assert low > RATE
    sds = {"impacts": (2,), "quantities": "y1", "moments": "sd", "within": 0.9}
    honest, naive = (failing(outcomes(runs, truth, 1.0, 0.02, naive=n, **sds)) for n in ((), ("unit",)))
    assert honest[0] <= 0.02 < naive[0]


@pytest.mark.parametrize("beyond", [-1.0001, 1.0001])
def test_a_model_just_outside_seldom_passes(runs, truth, beyond):
    low, measured, _ = passing(outcomes(runs, truth, beyond, **ONE, within=0.05))
    assert low <= 0.5 * RATE, measured
    _, whole, _ = passing(outcomes(runs, truth, beyond, within=0.05))
    assert whole == 0.0  # every row would have to


def test_a_model_well_outside_fails_and_one_well_inside_passes(runs, truth):
    assert failing(outcomes(runs, truth, 4.0, rate=0.01, within=0.05))[1] > 0.99
    assert passing(outcomes(runs, truth, 0.0, rate=0.01, within=0.3))[1] == 1.0
