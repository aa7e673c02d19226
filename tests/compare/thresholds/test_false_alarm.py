"""The nominal false-alarm rate compared with the measured one, and the rate of wrong passes.

A true claim fails most easily where the model is exactly as wrong as it may be.  Intervals are
two-sided, and an error at one edge of what is allowed can be missed on one side only: so a single
row fails with half the nominal rate there, and with all of it where nothing is allowed.

A session is measured with one look at its paths, and with four: at a block of them, and at two,
four and eight.
"""

from dataclasses import replace
from functools import reduce
from pathlib import Path

import pandas as pd
import pytest
from scenes import dat21
from scipy.stats import binomtest

from rattle import Sampling, simulate
from rattle.compare.judge.rows import PREFIX, NamedSection, judge_errors
from rattle.compare.study.cells import Sampled
from rattle.compare.thresholds.claim import read_claim
from rattle.compare.thresholds.decision import errors_of, merge_looks
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.kernel.blocks import in_threads
from rattle.montecarlo.statistics.intervals import widest
from rattle.scene import section_names

SESSION_SCENE = dat21(0.05, stages=1)
SESSION_IMPACTS = 2
BLOCKS = 1600
LOOKS = (1, 2, 4, 8)  # blocks
ALARM_RATE = 0.1


def stacked(runs):
    """Runs below each other as one, the impacts of run i at ``i * SESSION_IMPACTS + 1, ...``."""
    section = pd.concat([run.section for run in runs], ignore_index=True)
    section.index += 1
    steps = [
        pd.DataFrame(
            {
                "impact": section.index,
                "quantity": q,
                "moment": moment,
                **dict.fromkeys(("bias", "se_bias", "rest"), 0.0),
                "corrected": section[PREFIX[moment] + q],
                "se_corrected": section["se_" + PREFIX[moment] + q],
            }
        )
        for moment in ("mean", "sd")
        for q in section_names(1)
    ]
    steps = pd.concat(steps, ignore_index=True)
    # without branches that a sample may miss: no row is let off
    return Sampled(dat21(stages=1), section, steps, section, {})


@pytest.fixture(scope="module")
def sized():
    """A run as so many, each of some blocks of it; their streams are independent."""
    results = []

    def blocks(plan, first):
        for result, rows in in_threads(2)(plan, first):
            results.append(result)
            yield result, rows

    sampling = Sampling(control=True, blocks=blocks)
    run = simulate(
        SESSION_SCENE, paths=BLOCKS * BLOCK, impacts=SESSION_IMPACTS, rng=1, sampling=sampling
    )

    def parts(blocks, every):
        begins = range(0, BLOCKS, every)
        merged = (reduce(lambda a, b: a.merge(b), results[i : i + blocks]) for i in begins)
        return stacked([replace(run, result=result) for result in merged])

    return parts


@pytest.fixture(scope="module")
def truth(sized):
    """All blocks together: so much larger than a session that its own error and their correlation
    do not matter."""
    return sized(BLOCKS, BLOCKS).section


@pytest.fixture(scope="module")
def once(sized):
    """Sessions of one block and one look."""
    return [sized(1, 1)]


@pytest.fixture(scope="module")
def looks(sized):
    """Sessions of eight blocks, as they are at each of four looks."""
    return [sized(blocks, LOOKS[-1]) for blocks in LOOKS]


def displaced(truth, claim, by, sessions):
    """What a model says that is `by` allowed errors away from the truth."""
    off = truth.copy()
    for moment, allowed in claim.allowed.items():
        for q in claim.quantities:
            off[PREFIX[moment] + q] += (
                by * allowed.error * (truth["sd_" + q] if allowed.in_sd else 1.0)
            )
    whole = pd.concat([off] * sessions, ignore_index=True)
    whole.index += 1
    return NamedSection("truth", whole)


def outcomes(runs, truth, by, rate=ALARM_RATE, impacts=(1, 2), naive=(), **options):
    """Verdicts of each session on a model that is `by` allowed errors away from the truth.

    `naive` leaves a correction out: the one for the number of "rows" or "looks", or for the "unit"
    being measured.
    """
    sessions = len(runs[0].section) // SESSION_IMPACTS
    places = [i * SESSION_IMPACTS + k for i in range(sessions) for k in impacts]
    claim = read_claim(
        {"scene": SESSION_SCENE, "impacts": places, "quantities": ["tau", "y1"], **options}, Path()
    )
    z = widest(
        (1 if "rows" in naive else len(claim.rows) // sessions)
        * (1 if "looks" in naive else len(runs)),
        rate,
    )
    prediction = displaced(truth, claim, by, sessions)

    def look(run):
        errors = errors_of(prediction, run, claim)
        if "unit" in naive:
            errors["noise"] = errors["se"]
        return judge_errors(errors, z)

    table = reduce(merge_looks, map(look, runs))
    return table["verdict"].groupby((table["impact"] - 1) // SESSION_IMPACTS).agg(set)


def share(hits):
    """Share of sessions with its interval."""
    found = binomtest(sum(hits), len(hits)).proportion_ci(0.999)
    return found.low, hits.mean(), found.high


def failing(found):
    return share(found.map(lambda verdicts: "inaccurate" in verdicts))


def passing(found):
    return share(found.map(lambda verdicts: verdicts == {"accurate"}))


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
    honest, naive = (
        failing(
            outcomes(
                once,
                truth,
                1.0,
                0.02,
                naive=n,
                impacts=(2,),
                quantities="y1",
                moments="sd",
                within=0.9,
            )
        )
        for n in ((), ("unit",))
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
