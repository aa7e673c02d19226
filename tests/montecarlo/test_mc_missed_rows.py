"""Rows that miss an accuracy: which are named, with which bound and reason, and what a cut-off
answer does not hide."""

import numpy as np
import pytest
from mc_checks import NOISY

from rattle import simulate, simulate_to
from rattle.montecarlo import AccuracyWarning
from rattle.montecarlo.accuracy.cost import find_missed_rows, name_dearest_row
from rattle.montecarlo.diagnostics.accuracy import FEWEST_PATHS, error_bound, units
from rattle.montecarlo.looks import share_of_look

SHARE = share_of_look(1)


@pytest.fixture(scope="module")
def run():
    return simulate(NOISY, paths=20_000, impacts=4, rng=5)


def test_the_bound_of_all_rows_lies_among_their_own(run):
    """At the simultaneous bound some row misses; just above the largest own bound none does."""
    bound = error_bound(run, SHARE).error
    rows = find_missed_rows(run, bound * 0.999, SHARE)
    assert rows
    assert rows[0].bound == max(row.bound for row in rows) >= bound * 0.999
    assert not find_missed_rows(run, rows[0].bound * 1.001, SHARE)
    assert len(find_missed_rows(run, 1e-9, SHARE)) > len(rows)


@pytest.mark.slow
def test_own_bounds_hold_together():
    """In 20 runs against one with 30 times the paths: at most the stated share has a row beyond its
    own bound; bounds of half the length are caught."""
    reference = simulate(NOISY, paths=1_000_000, rng=1, impacts=3)
    worst = []
    for seed in range(20):
        run = simulate(NOISY, paths=FEWEST_PATHS, rng=100 + seed, impacts=3)
        unit = units(run)
        off = []
        for row in find_missed_rows(run, 1e-9, 0.05):
            name = row.quantity if row.moment == "mean" else f"sd_{row.quantity}"
            away = abs(run.section[name] - reference.section[name])[row.impact]
            off.append(away / unit[row.quantity][row.impact] / row.bound)
        worst.append(max(off))
    allowed = 20 * 0.05 + 3.0 * np.sqrt(20 * 0.05)
    assert sum(share > 1.0 for share in worst) <= allowed < sum(share > 0.5 for share in worst)


def test_reasons_are_the_largest_part():
    scene = NOISY.with_sigma(0.01)
    biased = simulate(scene, paths=4_000, impacts=3, scheme="euler-maruyama", dt=0.01, rng=1)
    assert {row.why for row in find_missed_rows(biased, 0.5, SHARE)} == {"bias of the step"}
    few = simulate(scene, paths=200, impacts=3, rng=1)
    assert {row.why for row in find_missed_rows(few, 0.01, SHARE)} >= {"too few paths"}


def test_the_dearest_row_is_named_where_it_is_much_dearer(run):
    """A rare branch makes much of the variance of y2 there."""
    said = name_dearest_row(run, 0.001, SHARE)
    assert said.startswith(
        "the dearest is the sd of y2 at impact 3; nine in ten of the others would take "
    )


def test_an_answer_in_place_of_a_refusal(monkeypatch):
    monkeypatch.setattr("rattle.montecarlo.accuracy.simulate_to.INSTEAD", 0.2)
    for scheme in ("exact-flight", "euler-maruyama"):
        with pytest.warns(AccuracyWarning, match="NOT reached: with 95 %"):
            found = simulate_to(NOISY, 1e-8, impacts=2, refuse=False, scheme=scheme)
        assert len(found.reach.missed) > 20
        assert found.reach.more_seconds > 3600.0
    assert simulate_to(NOISY, 0.1, impacts=2, refuse=False).reach.missed == ()


def test_a_run_to_an_accuracy_does_not_chase_it():
    """Each look has a smaller share of the 5 %: paths foreseen for the present one fell short again
    and again."""
    ask = {"impacts": 2, "scheme": "exact-flight", "rng": 3, "workers": 2}
    run = simulate_to(NOISY.with_sigma(0.3), 0.02, **ask)
    assert run.reach.reached
    assert 0.9 < run.paths / run.reach.expected.paths < 1.3
