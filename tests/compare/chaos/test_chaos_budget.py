"""The sizes of a study of chaos are chosen by counted work: within its budget, the ends of a sweep
first, whatever the clock says."""

import math

import numpy as np
import pytest
from scenes import dat21

from rattle import chaos
from rattle.compare.chaos import effort
from rattle.compare.chaos.effort import Effort, Sizes
from rattle.compare.chaos.exponents import ORBIT, Exponents
from rattle.compare.chaos.record import STICKS_OFTEN, Regime


def exponents(regime):
    """Exponents of a record of 40,000 impacts."""
    return Exponents(ORBIT, np.zeros(4), np.full(4, 0.001), 1.0, 0.0, 40_000, 4e4, 32.0, regime)


def choose(budget, noisy_steps, end=""):
    """The sizes of all parts, and the core-seconds that they are counted to take."""
    sizes = Sizes(Effort(budget=budget), sweeps=True)
    chosen = [sizes.longest()]
    orbit = exponents(Regime(impacts=40_000, computed=41_000, end=end))
    sizes.count_exponents(
        dat21(), orbit, exponents(Regime(impacts=40_000, computed=40_000, steps=noisy_steps))
    )
    chosen += [sizes.points(), *sizes.spectra(), sizes.events()]
    scenes, at_value = sizes.sweep(dict.fromkeys(np.linspace(0.1, 2.0, 100).tolist(), dat21()))
    spent = effort.CHAOS_SHARE * budget - sizes.left
    return sizes.describe(), spent, [*chosen, len(scenes), at_value]


@pytest.mark.parametrize(("noisy_steps", "end"), [(400_000, ""), (800, STICKS_OFTEN)])
def test_the_counted_work_stays_within_the_budget(noisy_steps, end):
    said, spent, least = choose(5.0, noisy_steps, end)
    assert spent < 1.1 * 5.0 + 1.0
    assert "Within the budget of 5 s" in said
    said, spent, more = choose(60.0, noisy_steps, end)
    assert spent <= 60.0
    assert all(np.array(least[:-1]) <= more[:-1])  # fewer values may have longer records
    assert "values of the sweep" in said
    said, _, most = choose(math.inf, noisy_steps, end)
    assert most == [2_000_000, 1_000_000, 200_000, 4, 4000, 100, 2_000_000]
    assert said == ""


def test_a_small_budget_gives_less_and_says_so():
    found = chaos(dat21(0.5), over=(0.5, 1.0, 1.5), budget=0.5)
    assert sorted(found.sweep["alpha"].unique()) == [0.5, 1.5]
    assert np.isfinite(found.orbit.half).all()
    assert found.answer[-1] == found.reduced
    assert "2 of 3 values of the sweep" in found.reduced
