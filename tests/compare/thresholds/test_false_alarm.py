"""The nominal false-alarm rate compared with the measured one, and the rate of wrong passes.

A true claim fails most easily where the model is exactly as wrong as it may be.  Intervals are
two-sided, and an error at one edge of what is allowed can be missed on one side only: so a single
row fails with half the nominal rate there, and with all of it where nothing is allowed.

A session is measured with one look at its paths, and with four: at a block of them, and at two,
four and eight.
"""

from dataclasses import dataclass
from functools import reduce
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scenes import dat21
from scipy.stats import binomtest

from rattle import Sampling, Scene, simulate
from rattle.compare.judge.rows import NamedSection, judge_errors
from rattle.compare.thresholds.claim import read_claim
from rattle.compare.thresholds.decision import errors_of, merge_looks
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.kernel.blocks import in_threads
from rattle.montecarlo.schemes.control_variate import estimate_controlled
from rattle.montecarlo.statistics.intervals import widest
from rattle.montecarlo.statistics.section_statistics import single_statistics
from rattle.scene import section_names

SESSION_SCENE = dat21(0.05, stages=1)
# without branches that a sample may miss: no row is let off
WITHOUT_BRANCHES = dat21(0.0, stages=1)
SESSION_IMPACTS = 2
BLOCKS = 1600
LOOKS = (1, 2, 4, 8)  # blocks
ALARM_RATE = 0.1
CONFIDENCE = 0.999
ONE_STAGE_QUANTITIES = section_names(1)


@dataclass
class Stacked:
    """Many runs below each other, the impacts of run i at ``i * IMPACTS + 1, ...``."""

    section: pd.DataFrame
    scene: Scene = WITHOUT_BRANCHES

    @property
    def agreement(self):
        return self.section[["agreement"]]

    @property
    def step_bias(self):
        nothing = {"bias": 0.0, "se_bias": 0.0, "rest": 0.0}
        parts = [
            pd.DataFrame(
                {
                    "impact": self.section.index,
                    "quantity": q,
                    "moment": moment,
                    **nothing,
                    "corrected": self.section[prefix + q],
                    "se_corrected": self.section["se_" + prefix + q],
                }
            )
            for moment, prefix in (("mean", ""), ("sd", "sd_"))
            for q in ONE_STAGE_QUANTITIES
        ]
        return pd.concat(parts, ignore_index=True)

    @property
    def sessions(self):
        return len(self.section) // SESSION_IMPACTS


def merged(results):
    return reduce(lambda one, other: one.merge(other), results)


def stacked(results, size, control):
    """Runs of `size` blocks; columns that `Ensemble.section` holds of means and sds, without the
    time of its tables."""
    names = {
        "": "mean",
        "sd_": "sd",
        "se_": "se_mean",
        "se_sd_": "se_sd",
        "skew_": "skew",
        "se_skew_": "se_skew",
        "kurt_": "kurt",
    }
    found = []
    for result in results:
        s = single_statistics(result.sums["section"]) | estimate_controlled(
            result.sums["control"], control.variance
        )
        found.append(
            {
                prefix + q: s[name][:, i]
                for prefix, name in names.items()
                for i, q in enumerate(ONE_STAGE_QUANTITIES)
            }
        )
    table = pd.DataFrame({name: np.concatenate([f[name] for f in found]) for name in found[0]})
    table.index += 1
    same = {"paths": size * BLOCK, "agreement": 1.0, "mesh": 1}
    return Stacked(table.assign(flight=table["tau"], sd_flight=table["sd_tau"], **same))


@pytest.fixture(scope="module")
def simulated():
    """The blocks of one run, each by itself, and its control; their streams are independent."""
    results = []

    def blocks(plan, first):
        for result, rows in in_threads(2)(plan, first):
            results.append(result)
            yield result, rows

    sampling = Sampling(control=True, blocks=blocks)
    run = simulate(
        SESSION_SCENE,
        paths=BLOCKS * BLOCK,
        impacts=SESSION_IMPACTS,
        scheme="exact-flight",
        sampling=sampling,
        rng=1,
    )
    return results, run.plan.control


@pytest.fixture(scope="module")
def truth(simulated):
    """All blocks together: so much larger than a session that its own error and their correlation
    do not matter."""
    results, control = simulated
    return stacked([merged(results)], BLOCKS, control).section


@pytest.fixture(scope="module")
def once(simulated):
    """Sessions of one block and one look."""
    results, control = simulated
    return [stacked(results, 1, control)]


@pytest.fixture(scope="module")
def looks(simulated):
    """Sessions of eight blocks, as they are at each of four looks."""
    results, control = simulated
    starts = range(0, BLOCKS, LOOKS[-1])
    return [stacked([merged(results[i : i + n]) for i in starts], n, control) for n in LOOKS]


def displaced(truth, claim, by, sessions=1):
    """What a model says that is `by` allowed errors away from the truth."""
    whole = pd.concat([truth] * sessions, ignore_index=True)
    whole.index += 1
    off = whole.copy()
    for moment, allowed in claim.allowed.items():
        for q in claim.quantities:
            unit = whole["sd_" + q] if allowed.in_sd else 1.0
            off[("" if moment == "mean" else "sd_") + q] += by * allowed.error * unit
    return NamedSection("truth", off)


def outcomes(runs, truth, by, rate=ALARM_RATE, impacts=(1, 2), naive=(), **options):
    """Outcomes, shape (sessions, rows), of a model that is `by` allowed errors away from the truth.

    `naive` leaves a correction out: the one for the number of "rows" or "looks", or for the "unit"
    being measured.
    """
    sessions = runs[0].sessions
    places = [i * SESSION_IMPACTS + k for i in range(sessions) for k in impacts]
    claim = read_claim(
        {"scene": SESSION_SCENE, "impacts": places, "quantities": ["tau", "y1"], **options}, Path()
    )
    rows = len(claim.rows) // sessions
    z = widest((1 if "rows" in naive else rows) * (1 if "looks" in naive else len(runs)), rate)
    prediction = displaced(truth, claim, by, sessions)
    table = None
    for run in runs:
        errors = errors_of(prediction, run, claim)
        if "unit" in naive:
            errors["noise"] = errors["se"]
        table = (
            judge_errors(errors, z)
            if table is None
            else merge_looks(table, judge_errors(errors, z))
        )
    table["session"] = (table["impact"] - 1) // SESSION_IMPACTS
    return table.sort_values("session", kind="stable")["verdict"].to_numpy().reshape(sessions, rows)


def share(hits):
    """Share of sessions with its interval."""
    found = binomtest(int(hits.sum()), len(hits)).proportion_ci(CONFIDENCE)
    return found.low, hits.mean(), found.high


def failing(found):
    return share((found == "inaccurate").any(axis=1))


def passing(found):
    return share((found == "accurate").all(axis=1))


ONE_ROW = {"impacts": (2,), "quantities": "y1", "moments": "mean"}


def test_one_row_that_is_allowed_nothing_fails_at_the_stated_rate(once, looks, truth):
    low, measured, high = failing(outcomes(once, truth, 0.0, **ONE_ROW, absolute=1e-12))
    assert low <= ALARM_RATE <= high, measured
    low, measured, high = failing(outcomes(looks, truth, 0.0, **ONE_ROW, absolute=1e-12))
    assert low <= ALARM_RATE, measured
    assert high >= 0.5 * ALARM_RATE, measured  # looks at the same paths are not independent


@pytest.mark.parametrize("edge", [-1.0, 1.0])
def test_one_row_at_the_edge_fails_at_half_the_stated_rate(once, truth, edge):
    low, measured, high = failing(outcomes(once, truth, edge, **ONE_ROW, absolute=2e-3))
    assert low <= 0.5 * ALARM_RATE <= high, measured


def test_without_a_correction_it_would_be_found_out(once, looks, truth):
    low, _, _ = failing(outcomes(once, truth, 1.0, within=0.05, naive=("rows",)))
    assert low > ALARM_RATE
    sds = {"impacts": (2,), "quantities": "y1", "moments": "sd", "within": 0.9}
    honest, naive = (
        failing(outcomes(once, truth, 1.0, 0.02, naive=n, **sds)) for n in ((), ("unit",))
    )
    assert honest[0] <= 0.02 < naive[0]
    low, _, _ = failing(outcomes(looks, truth, 0.0, **ONE_ROW, absolute=1e-12, naive=("looks",)))
    assert low > ALARM_RATE


def test_a_model_just_outside_seldom_passes(once, looks, truth):
    beyond = 1.0001
    for runs in (once, looks):
        low, measured, _ = passing(outcomes(runs, truth, beyond, **ONE_ROW, within=0.05))
        assert low <= 0.5 * ALARM_RATE, measured
        _, whole, _ = passing(outcomes(runs, truth, beyond, within=0.05))
        assert whole == 0.0  # every row would have to
