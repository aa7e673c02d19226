"""A budget of a long run bounds all of it.

The clock of these tests ticks with the periods that blocks of paths are followed, so that no machine is too slow.
"""

import pytest

from rattle.montecarlo.long_run import long_run
from rattle.montecarlo.long_run.walk import Walk
from rattle.scene import DAT21, InputError, Scene

SCENE = Scene.from_gears(DAT21, sigma=0.5)
SECOND = 1.0  # of a block of paths and a period


class Watched:
    """A clock that each period of a block moves on; what compiles is not counted."""

    def __init__(self, monkeypatch):
        self.now, follow = 0.0, Walk.follow
        monkeypatch.setattr("rattle.montecarlo.kernel.blocks.time.process_time", lambda: self.now)

        def followed(walk, sums, periods=1, length=1, seen=None):
            self.now += SECOND * periods * (walk.paths > 1)
            follow(walk, sums, periods, length, seen)

        monkeypatch.setattr(Walk, "follow", followed)


@pytest.mark.parametrize("budget", [3.0, 20.0, 33.0])
def test_a_budget_that_ends_before_there_is_an_answer_says_what_would_do(monkeypatch, budget):
    """At least 32 periods of burn-in were followed, and 64 after it, whatever the budget was."""
    watched = Watched(monkeypatch)
    with pytest.raises(InputError, match="of processor time more") as refused:
        long_run(SCENE, accuracy=1e-9, paths=16, budget=budget, burn_in=32)
    assert refused.value.field == "budget"
    assert watched.now <= budget + SECOND


@pytest.mark.parametrize("budget", [60.0, 120.0, 1500.0])
def test_the_best_answer_is_within_the_budget(monkeypatch, budget):
    watched = Watched(monkeypatch)
    found = long_run(SCENE, accuracy=1e-9, paths=16, budget=budget, burn_in=32)
    assert watched.now <= budget + SECOND
    assert watched.now >= 0.9 * budget
    assert not found.reach.reached
    assert found.reach.more_seconds > budget
    assert found.periods + 32 <= budget


def test_without_a_budget_no_clock_decides(monkeypatch):
    monkeypatch.setattr("rattle.montecarlo.long_run.paths.IMPACT_SECONDS", 1.0)
    with pytest.raises(InputError, match="without a budget the limit is one hour: ask for"):
        long_run(SCENE, accuracy=1e-3, paths=16, burn_in=32)
    monkeypatch.setattr("rattle.montecarlo.long_run.paths.IMPACT_SECONDS", 1e-9)
    Watched(monkeypatch)
    monkeypatch.setattr("tests.montecarlo.test_mc_long_budget.SECOND", 1e6)
    assert long_run(SCENE, accuracy=0.1, paths=16, burn_in=32).reach.reached
