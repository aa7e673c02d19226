"""Published results: the program obeys them, and a wrong result, scene or step is detected."""

from dataclasses import replace

import pandas as pd
import pytest
from commands import rattle
from places import EXAMPLES
from scenes import dat21

from rattle import DAT21, Scene
from rattle.compare.checks.check import MOST_FALSE_ALARMS, Check, Subject, run_checks
from rattle.compare.checks.published import RESULTS, impacts
from rattle.montecarlo.statistics.intervals import widest

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
    folder = EXAMPLES / "published"
    paper, basins_of_two = (
        Scene.load(folder / name) for name in ("dat21.toml", "de-souza-caldas.toml")
    )
    assert (paper, paper.gears) == (dat21(DAT21.alpha**0.5), DAT21)
    assert replace(basins_of_two, start=None) == impacts.GEARS


def test_tolerance_counts_every_statistical_check(results):
    checks = pd.DataFrame([check for result in results.values() for check in result.checks])
    statistical = checks["se"] > 0.0
    assert results["exit-time"].allowed == widest(statistical.sum(), MOST_FALSE_ALARMS)
    # where nothing is random the bound is of rounding or of the step, not of convenience
    size = checks["truth"].abs()
    assert (statistical | (checks["slack"] <= 1e-6 * size.clip(lower=1.0))).all()
    assert (checks["slack"] <= 2e-3 * size.clip(lower=1e-2)).all()


TRUTHS = {
    "mean flight 1, eps 0.8, exact-flight": 6.665031,
    "sd of flight 1, eps 0.8, exact-flight": 3.195996,
    "sd of speed 4, eps 0.8, exact-flight": 2.254239,
    "mean speed 4, eps 0.9, exact-flight": 9.582369,
    "sd of speed 4, eps 0.9, exact-flight": 4.398517,
    "E y": 28.01459,
    "Var y": 26.92088,
}
"""Of the balls, by another quadrature."""


def test_truths_of_the_balls_are_those_of_another_quadrature(results):
    checks = [*results["noisy-ball"].checks, *results["random-restitution"].checks]
    found = {check.quantity: check.truth for check in checks}
    assert {name: found[name] for name in TRUTHS} == pytest.approx(TRUTHS, abs=5e-6)


def test_unknown_result_is_refused():
    assert "result = 'gravity'" in rattle("check published --result gravity", code=2).stderr


def test_result_that_does_not_reject_its_negative_control_fails():
    found = [Check("mean", 1.0, 1.0, 0.01)], {"1 % more": [Check("mean", 1.0, 1.01, 0.01)]}
    (blind,) = run_checks({"blind": Subject("blind", "", "", lambda *_: found)})
    assert blind.worst.holds(blind.allowed)
    assert not blind.holds
