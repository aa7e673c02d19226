"""What a sample cannot have seen: rare branches are found, counted, and leave a verdict open."""

from types import SimpleNamespace

import numpy as np
import pytest
from random_gears import PAIR_B

from rattle import Tolerances
from rattle.compare.validation import errors
from rattle.compare.validation.errors import section_errors
from rattle.montecarlo import simulate
from rattle.montecarlo.branches import search as branches
from rattle.montecarlo.branches.search import BranchSearch
from rattle.montecarlo.diagnostics.unseen import Unseen
from rattle.montecarlo.looks import widest
from rattle.scene import DAT21, Scene

PROBABILITY = 7.9e-6
SD = 0.01528
"""Of the branch of `PAIR_B`, and sd of y2 at impact 2, from 8 million exact flights (63 paths on
the branch)."""


def test_a_rare_branch_has_the_probability_and_the_size_that_eight_million_paths_show():
    found = BranchSearch(PAIR_B, 2).until(1.0)
    (branch,) = [b for b in found.branches if b.impact == 1]
    assert abs(branch.probability - PROBABILITY) < 4.0 * PROBABILITY / np.sqrt(63.0)
    gap = branch.section[:, 1, 5] - found.orbit[1, 5]
    share = (branch.weights * gap**2).sum() / SD**2
    assert 0.2 < share < 0.5  # 0.34 by the kurtosis


def _verdict(monkeypatch, bounded):
    run = simulate(PAIR_B, paths=32_768, impacts=2, scheme="exact-flight", rng=0)
    truth = run.section.copy()
    truth.loc[2, "sd_y2"] = SD
    if not bounded:
        nil = np.zeros((2, 6))
        monkeypatch.setattr(errors, "unseen", lambda *_: Unseen(nil, nil, nil, nil, nil, nil, 2))
    table = section_errors(
        [SimpleNamespace(closure="exact", section=truth)], run, widest(48), Tolerances()
    )
    return table.query("impact == 2 and quantity == 'y2' and moment == 'sd'").iloc[0]


def test_an_exactly_right_sd_is_not_called_inaccurate_for_want_of_paths(monkeypatch):
    row = _verdict(monkeypatch, True)
    assert row["verdict"] == "undecided"
    assert "8 in a million" in row["remark"]
    assert row["paths_needed"] == pytest.approx(10.0 / PROBABILITY, rel=0.5)


def test_negative_control_without_the_bound_it_is(monkeypatch):
    assert _verdict(monkeypatch, False)["verdict"] == "inaccurate"


def test_where_no_other_event_is_near_nothing_is_counted():
    assert BranchSearch(Scene.from_gears(DAT21, sigma=0.01), 12).until(1.0).branches == ()


def test_a_branch_whose_window_lies_between_the_points_of_the_grid_is_found():
    """Below sigma = 0.07 it was lost, from one noise intensity to the next."""
    sigmas = (0.055, 0.06, 0.065, 0.07)
    found = [BranchSearch(Scene.from_gears(DAT21, sigma=s), 1).until(1.0).branches for s in sigmas]
    assert [(b.mesh, b.side) for (b,) in found] == [(2, -1)] * 4
    np.testing.assert_allclose(
        [b.beta * s for (b,), s in zip(found, sigmas, strict=True)], 0.328, rtol=5e-3
    )


def test_an_orbit_that_ends_leaves_later_impacts_unknown():
    scene = Scene(alpha=0.0, epsilon=0.5, beta1=5.0, gamma1=0.0, stages=1, sigma=1e-6)
    found = BranchSearch(scene, 3).until(1.0)
    assert found.known < 3
    assert found.why


def test_one_search_serves_all_probabilities(monkeypatch):
    """Whatever is asked for first, no flight is searched twice, and the answers are those of
    searches of their own."""
    flights = []
    one = branches.events
    monkeypatch.setattr(branches, "events", lambda flight: flights.append(flight) or one(flight))
    scene = Scene.from_gears(DAT21, sigma=0.1).phase_reduced
    wanted = [2.0**-k for k in (9, 2, 12, 8)]
    search = BranchSearch(scene, 12)
    found = [[b.probability for b in search.until(least).branches] for least in wanted]
    together = len(flights)
    apart = []
    for least in wanted:
        flights.clear()
        apart.append([b.probability for b in BranchSearch(scene, 12).until(least).branches])
        assert len(flights) <= together
    assert found == apart
    assert len({len(b) for b in found}) > 1
    flights.clear()
    BranchSearch(scene, 12).until(min(wanted))
    assert together == len(flights)


@pytest.mark.slow
def test_the_search_is_bounded_whatever_the_number_of_impacts(monkeypatch):
    """It took 45 seconds of an answer whose budget was 2; beyond what is searched, branches count
    as unknown."""
    flights = []
    one = branches.events
    monkeypatch.setattr(branches, "events", lambda flight: flights.append(flight) or one(flight))
    scene = Scene.from_gears(DAT21, sigma=1.2).phase_reduced
    for impacts in (200, 400):
        flights.clear()
        search = BranchSearch(scene, impacts)
        for k in range(4, 20):
            found = search.until(2.0**-k)
        assert len(flights) <= branches.MOST_SEARCHED_FLIGHTS
        assert found.known == min(impacts, branches.MOST_SEARCHED_FLIGHTS)
