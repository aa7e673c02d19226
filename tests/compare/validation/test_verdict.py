"""The three-way verdict, its intervals, and the errors that they detect."""

import numpy as np
import pandas as pd
import pytest
from scenes import dat21
from settings import LOCATED

from rattle import Record, Tolerances, mean_map, simulate
from rattle.compare.judge.rows import NamedSection, waits_for_branch
from rattle.compare.judge.verdict import judge
from rattle.compare.validation.errors import judge_again, section_errors
from rattle.montecarlo import simulate_rare
from rattle.montecarlo.statistics.intervals import ABSOLUTE, widest

JUDGED_IMPACTS = 4


def rows(**columns):
    base = {"predicted": 1.0, "noise": 0.01, "tolerance": 0.05, "paths": 1000.0}
    return pd.DataFrame({**base, **columns})


def test_verdict():
    low, high = np.transpose(
        [(-0.04, 0.04), (-0.05, 0.05), (0.06, 0.08), (-0.08, -0.06), (0.04, 0.06), (-0.1, 0.1)]
    )
    found = judge(rows(error=0.5 * (low + high), low=low, high=high))["verdict"]
    assert found.tolist() == ["accurate"] * 2 + ["inaccurate"] * 2 + ["undecided"] * 2


@pytest.mark.parametrize(("shift", "needed"), [(0.0, 16_000.0), (1e-4, 16_660.0), (0.006, 1e12)])
def test_branches_that_hardly_matter_do_not_ask_for_the_paths_that_show_them(shift, needed):
    """Error 0.045 +- 0.02 of noise: the margin to 0.05 is 0.005, so 16 times the 1,000 paths."""
    found = judge(
        rows(
            error=0.045,
            noise=0.02,
            low=[0.025 - shift],
            high=0.065 + shift,
            unseen_low=shift,
            unseen_high=shift,
            unseen_paths=1e12,
        )
    )["paths_needed"]
    assert found.item() == pytest.approx(needed, rel=1e-3)


def judged(section, run, z):
    """The rows of a closure that claims given section moments."""
    return section_errors([NamedSection("claimed", section)], run, z, Tolerances())


def missed(claim, run, z):
    """Whether the interval of each moment that varies misses a claim."""
    table = judged(claim, run, z).set_index(["moment", "quantity"])
    varying = table[table["unit"] > ABSOLUTE]
    return (varying["low"] > 0.0) | (varying["high"] < 0.0)


@pytest.mark.parametrize("sigma", [0.01, 1.0])
def test_a_perfect_closure_is_within_its_intervals(sigma):
    """The share of families of intervals that miss the true value stays near the nominal 5 %; they
    always miss a mean that is off by a fifth of an sd, an sd by 30 %, and a wrong sign.

    Not tested where a rare itinerary matters but is expected less than once in the ensemble (sigma
    = 0.05 here): no interval estimated from such a sample can include it, and the report says so.
    """
    scene = dat21(sigma)
    truth = simulate(scene, paths=200_000, impacts=JUDGED_IMPACTS, rng=1, workers=2).section
    itinerary = mean_map(scene, impacts=JUDGED_IMPACTS, closure="corrected").itinerary
    wrong = truth.assign(
        tau=truth["tau"] + 0.2 * truth["sd_tau"], sd_y1=1.3 * truth["sd_y1"], y2=-truth["y2"]
    )
    z = widest(2 * 6 * JUDGED_IMPACTS)
    missing = 0
    for seed in range(100, 112):
        run = simulate(
            scene,
            paths=4096,
            impacts=JUDGED_IMPACTS,
            rng=seed,
            scheme=LOCATED,
            record=Record(itineraries={"claimed": itinerary}),
        )
        missing += missed(truth, run, z).any()
        assert missed(wrong, run, z)[[("mean", "tau"), ("sd", "y1"), ("mean", "y2")]].all()
    assert missing <= 3  # P(more than 3 of 12 | 5 %) = 0.002


Z_OF_FEW = widest(24)


@pytest.fixture(scope="module")
def few():
    """A perfect closure, judged by thirty samples of four paths."""
    scene = dat21(0.01)
    claim = mean_map(scene, impacts=2).section
    runs = [simulate(scene, paths=4, impacts=2, rng=seed) for seed in range(30)]
    return lambda: [judged(claim, run, Z_OF_FEW) for run in runs]


def called_inaccurate(tables):
    return sum("inaccurate" in set(table["verdict"]) for table in tables)


def test_few_paths_do_not_call_a_perfect_closure_inaccurate_and_judge_no_sd(few):
    tables = few()
    assert called_inaccurate(tables) <= 6  # P(more than 6 of 30 | 5 %) = 6e-4
    sds = tables[0].query("judged and moment == 'sd'")
    assert set(sds["verdict"]) == {"undecided"}
    assert sds["remark"].str.startswith("too few paths").all()


def test_few_paths_with_normal_intervals_would(few, monkeypatch):
    monkeypatch.setattr("rattle.compare.judge.rows.half_width", lambda *_: Z_OF_FEW)
    monkeypatch.setattr("rattle.montecarlo.diagnostics.reference.FEWEST_FOR_SD", 0)
    assert called_inaccurate(few()) > 15


def test_rows_that_wait_for_a_rare_branch_are_decided_by_paths_near_it():
    """The sd of y2 at impact 3 has a kurtosis of 1,500 from 5 paths in 10,000; one off by a third
    is noticed."""
    scene = dat21(0.1)
    run = simulate(scene, paths=8192, impacts=3, rng=1)
    exact = simulate_rare(scene, paths=131_072, impacts=3, rng=2).section
    claims = [
        NamedSection("right", exact),
        NamedSection("wrong", exact.assign(sd_y2=exact["sd_y2"] * [1.0, 1.0, 1.35])),
    ]
    first = section_errors(claims, run, widest(36), Tolerances())
    again, _ = judge_again(first, claims, run, widest(36, 0.0125), Tolerances(), 1)
    before, right = (table.query("closure == 'right'") for table in (first, again))
    waits = waits_for_branch(before)
    assert waits.any()
    assert not waits_for_branch(right).any()
    assert (right["verdict"][waits] == "accurate").all()
    row = "closure == 'wrong' and quantity == 'y2' and moment == 'sd' and impact == 3"
    assert first.query(row)["verdict"].item() == "undecided"
    assert again.query(row)["verdict"].item() == "inaccurate"
    assert right[~waits].equals(before[~waits])
