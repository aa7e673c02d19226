"""The paths that an accuracy is expected to take, with the branches that a pilot run cannot have seen."""

import numpy as np
import pytest

from rattle.montecarlo import simulate, simulate_to
from rattle.montecarlo.accuracy import cost as module
from rattle.montecarlo.accuracy.cost import expect_paths
from rattle.montecarlo.diagnostics.accuracy import error_bound, share_of_look
from rattle.montecarlo.diagnostics.unseen import Added
from rattle.scene import DAT21, Gears, InputError, Scene

GEARS = Gears(
    alpha=1.5, epsilon=0.9, omega=300.0, inertia1=4000.0, inertia2=2500.0, radius1=41.0, radius2=26.4,
    backlash1=0.2, torque1=100.0,
)  # fmt: skip
BRANCHING = Scene.from_gears(GEARS, sigma=0.01)
"""27 paths in a million leave the others before impact 6, and make most of the variance there."""


@pytest.fixture(scope="module")
def pilot():
    return simulate(BRANCHING, paths=8192, impacts=6, scheme="exact-flight", rng=0)


def test_a_rare_branch_is_counted_before_it_is_seen(pilot):
    found = expect_paths(pilot, 0.3, share_of_look(1))
    assert found.branch == "a rare branch (about 27 in a million paths)"
    run = simulate(BRANCHING, paths=int(found.paths), impacts=6, scheme="exact-flight", rng=1, workers=2)
    assert 0.3 / 1.5 < error_bound(run, share_of_look(1)).error < 0.3 * 1.5


def test_negative_control_without_the_branch_it_expects_next_to_nothing(pilot, monkeypatch):
    monkeypatch.setattr(module, "branches_between", lambda *_: Added(*np.zeros((3, 6, 6)), np.zeros(0)))
    found = expect_paths(pilot, 0.3, share_of_look(1))
    run = simulate(BRANCHING, paths=int(found.paths), impacts=6, scheme="exact-flight", rng=1)
    assert error_bound(run, share_of_look(1)).error > 1.5 * 0.3


def test_where_no_branch_is_near_paths_fall_with_the_square_of_the_accuracy():
    run = simulate(Scene.from_gears(DAT21, sigma=0.01), paths=8192, impacts=6, scheme="exact-flight", rng=0)
    coarse, fine = (expect_paths(run, accuracy, share_of_look(1)) for accuracy in (0.05, 0.005))
    assert coarse.branch == fine.branch == ""
    assert fine.paths / coarse.paths == pytest.approx(100.0, rel=1e-6)


def test_what_is_too_dear_is_refused_before_the_work():
    with pytest.raises(InputError, match=r"without a budget the limit is one hour.*: ask for"):
        simulate_to(BRANCHING, 1e-5, impacts=6)


def test_what_a_branch_made_dear_samples_it_on_purpose():
    """Plain paths would have taken hours for the 27 in a million that take it."""
    run = simulate_to(BRANCHING, 0.02, impacts=6)
    assert run.reach.reached
    assert run.reach.expected.branches > 0
    assert run.paths < 500_000


def test_a_run_to_an_accuracy_does_not_chase_it():
    """Each look has a smaller share of the 5 %: paths foreseen for the present one fell short again and again."""
    run = simulate_to(Scene.from_gears(DAT21, sigma=0.3), 0.01, impacts=2, scheme="exact-flight", rng=3, workers=2)
    assert run.reach.reached
    assert 0.9 < run.paths / run.reach.expected.paths < 1.3
