"""Rows that miss an accuracy: which are named, with which bound and reason, and what a cut-off
answer does not hide."""

import numpy as np
import pytest

from rattle import DAT21, InputError, Scene, simulate, simulate_to
from rattle.montecarlo import AccuracyWarning
from rattle.montecarlo.accuracy.cost import find_missed_rows, name_dearest_row
from rattle.montecarlo.diagnostics.accuracy import (
    FEWEST_PATHS,
    error_bound,
    units,
)
from rattle.montecarlo.looks import share_of_look

NOISY = Scene.from_gears(DAT21, sigma=0.1)
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
    """In 40 runs against one with 60 times the paths: at most the stated share has a row beyond its
    own bound."""
    reference = simulate(NOISY, paths=2_000_000, rng=1, impacts=3)
    failed = halved = 0
    for seed in range(40):
        run = simulate(NOISY, paths=FEWEST_PATHS, rng=100 + seed, impacts=3)
        unit = units(run)
        off = []
        for row in find_missed_rows(run, 1e-9, 0.05):
            name = ("sd_" if row.moment == "sd" else "") + row.quantity
            away = abs(run.section[name] - reference.section[name])[row.impact]
            off.append(away / unit[row.quantity][row.impact] / row.bound)
        failed = failed + (max(off) > 1.0)
        halved = halved + (max(off) > 0.5)
    allowed = 40 * 0.05 + 3.0 * np.sqrt(40 * 0.05)
    assert failed <= allowed
    assert halved > allowed  # a planted error: bounds of half the length are caught


def test_reasons_are_the_largest_part():
    scene = Scene.from_gears(DAT21, sigma=0.01)
    biased = simulate(scene, paths=4_000, impacts=3, scheme="euler-maruyama", dt=0.01, rng=1)
    assert {row.why for row in find_missed_rows(biased, 0.5, SHARE)} == {"bias of the step"}
    few = simulate(scene, paths=200, impacts=3, rng=1)
    assert {row.why for row in find_missed_rows(few, 0.01, SHARE)} >= {"too few paths"}


def test_without_noise_no_row_is_named():
    still = simulate(NOISY.with_sigma(0.0), paths=1, impacts=3)
    assert find_missed_rows(still, 1e-9, SHARE) == ()
    assert name_dearest_row(still, 1e-9, SHARE) == ""


def test_the_dearest_row_is_named_where_it_is_much_dearer(run):
    """A rare branch makes much of the variance of y2 there."""
    said = name_dearest_row(run, 0.001, SHARE)
    assert said.startswith(
        "the dearest is the sd of y2 at impact 3; nine in ten of the others would take "
    )


def test_an_answer_in_place_of_a_refusal(monkeypatch):
    monkeypatch.setattr("rattle.montecarlo.accuracy.simulate_to.INSTEAD", 0.5)
    with pytest.raises(InputError, match="is expected to take"):
        simulate_to(NOISY, 1e-8, impacts=2)
    for scheme in ("exact-flight", "euler-maruyama"):
        with pytest.warns(AccuracyWarning, match="NOT reached: with 95 %"):
            found = simulate_to(NOISY, 1e-8, impacts=2, refuse=False, scheme=scheme)
        assert not found.reach.reached
        assert len(found.reach.missed) > 20
        assert found.reach.more_seconds > 3600.0
    assert simulate_to(NOISY, 0.1, impacts=2, refuse=False).reach.missed == ()


def test_a_run_to_an_accuracy_does_not_chase_it():
    """Each look has a smaller share of the 5 %: paths foreseen for the present one fell short again
    and again."""
    run = simulate_to(
        Scene.from_gears(DAT21, sigma=0.3), 0.01, impacts=2, scheme="exact-flight", rng=3, workers=2
    )
    assert run.reach.reached
    assert 0.9 < run.paths / run.reach.expected.paths < 1.3
