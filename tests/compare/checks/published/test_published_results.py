"""Published results: the program obeys them, and a wrong result, scene or step is detected."""

from dataclasses import replace
from pathlib import Path

import pytest
from commands import rattle

from rattle.compare.checks.check import MOST_FALSE_ALARMS, Check, Subject, run_checks
from rattle.compare.checks.published import RESULTS, impacts
from rattle.montecarlo.statistics.intervals import widest
from rattle.scene import DAT21, Scene

pytestmark = pytest.mark.published


@pytest.fixture(scope="module")
def results():
    return dict(zip(RESULTS, run_checks(RESULTS), strict=True))


@pytest.mark.parametrize("name", RESULTS)
def test_result(results, name):
    result = results[name]
    assert result.worst.holds(result.allowed), result.worst
    assert len(result.controls) >= 2
    assert result.holds, result.rejections


def test_published_rigs_are_scenes_to_copy():
    folder = Path(__file__).parents[4] / "examples" / "published"
    paper, basins_of_two = (
        Scene.load(folder / name) for name in ("dat21.toml", "de-souza-caldas.toml")
    )
    assert (paper, paper.gears) == (Scene.from_gears(DAT21, sigma=DAT21.alpha**0.5), DAT21)
    assert replace(basins_of_two, start=None) == impacts.GEARS


def test_tolerance_counts_every_statistical_check(results):
    checks = [c for result in results.values() for c in result.checks]
    statistical = sum(c.se > 0.0 for c in checks)
    assert results["exit-time"].allowed == widest(statistical, MOST_FALSE_ALARMS)
    # where nothing is random the bound is of rounding or of the step, not of convenience
    for c in checks:
        assert c.se > 0.0 or c.slack <= 1e-6 * max(1.0, abs(c.truth)), c
        assert c.slack <= 2e-3 * max(abs(c.truth), 1e-2), c


def test_unknown_result_is_refused():
    assert "result = 'gravity'" in rattle("check published --result gravity", code=2).stderr


def test_result_that_does_not_reject_its_negative_control_fails():
    found = [Check("mean", 1.0, 1.0, 0.01)], {"1 % more": [Check("mean", 1.0, 1.01, 0.01)]}
    (blind,) = run_checks({"blind": Subject("blind", "", "", lambda *_: found)})
    assert blind.worst.holds(blind.allowed)
    assert not blind.holds
