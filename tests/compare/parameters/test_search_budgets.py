"""A budget bounds the work that is counted, and what is returned has intervals.

The processor of these tests counts its time in impacts, and is three times slower than a usual one.
"""

import time

import numpy as np
import pytest
from scenes import dat21

from rattle import Scene, boundary_map, sensitivity
from rattle.montecarlo.kernel.blocks import Budget
from rattle.montecarlo.long_run import paths as long_paths
from rattle.montecarlo.long_run.sums import NUMBER
from rattle.montecarlo.long_run.walk import Walk
from rattle.montecarlo.looks import BUDGET_ENDED, Looks

CHATTERING = Scene.from_toml("""
[gears]
amplitude_rad = 0.014
driver_radius = 32.0
omega = 167.6
epsilon = 0.5
inertia1 = 950.0
inertia2 = 620.0
radius1 = 38.0
radius2 = 30.0
backlash1 = 0.12
backlash2 = 0.10
damping1 = 0.06
damping2 = 0.05
torque1 = 40.0
torque2 = 30.0

[scene]
sigma = 0.15
""")
BUDGET = 5.0


@pytest.fixture
def spent(monkeypatch):
    """The processor time that impacts take, in place of that of the process."""
    seconds = 3.0 * long_paths.IMPACT_SECONDS
    impacts = [0.0]
    follow = Walk.follow

    def counted(walk, sums, *how, **more):
        before = sums.main[:, :, NUMBER].sum()
        follow(walk, sums, *how, **more)
        impacts[0] += sums.main[:, :, NUMBER].sum() - before

    def clock():
        return impacts[0] * seconds

    monkeypatch.setattr(Walk, "follow", counted)
    monkeypatch.setattr(long_paths, "IMPACT_SECONDS", seconds)
    monkeypatch.setattr(time, "process_time", clock)
    return clock


def test_a_sensitivity_keeps_its_budget(spent):
    found = sensitivity(CHATTERING, quantities=["power"], budget=BUDGET, rng=3)
    assert 0.5 * BUDGET < spent() < 1.1 * BUDGET + 1.0
    unknown = found.table["effect"].isna()
    assert not unknown.all()
    assert (np.isfinite(found.table["high"] - found.table["low"]) != unknown).all()
    assert set(found.table["remark"][unknown]) == {"the budget ended before it was changed"}
    assert "The budget ended before" in found.said


def test_a_look_that_would_take_too_much_of_the_budget_is_not_begun(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(time, "process_time", lambda: now[0])
    looks = Looks((1, 4, 16, 64), budget=Budget(40.0), share=0.5)
    seen = []
    for size in looks:
        seen.append(size)
        now[0] += size
    assert seen == [1, 4, 16]
    assert looks.why == BUDGET_ENDED


def test_a_map_shares_its_budget_and_says_what_it_leaves_undecided():
    found = boundary_map(
        dat21(), along="alpha", between=(0.01, 0.1), impacts=1, points=2, values=2, budget=1e-6
    )
    assert found.path_steps == 0
    assert f"undecided: {BUDGET_ENDED}" in found.answer[0]
