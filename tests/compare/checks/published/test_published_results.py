"""Published results: the program obeys them, and a wrong result, scene or step is detected."""

import math
from dataclasses import replace

import numpy as np
import pytest
from commands import rattle
from places import EXAMPLES
from scenes import dat21

from rattle import DAT21, Scene
from rattle.compare.checks.check import MOST_FALSE_ALARMS, Check, Subject, run_checks
from rattle.compare.checks.published import RESULTS, bodies, impacts
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
    checks = [c for result in results.values() for c in result.checks]
    statistical = sum(c.se > 0.0 for c in checks)
    assert results["exit-time"].allowed == widest(statistical, MOST_FALSE_ALARMS)
    # where nothing is random the bound is of rounding or of the step, not of convenience
    for c in checks:
        assert c.se > 0.0 or c.slack <= 1e-6 * max(1.0, abs(c.truth)), c
        assert c.slack <= 2e-3 * max(abs(c.truth), 1e-2), c


BALLS = {  # flight 1, speeds 1 to 4: means and sds
    (0.8, 3.0): (
        [6.665031, 3.665031, 3.593258, 3.531660, 3.478757],
        [3.195996, 1.494183, 1.907721, 2.127491, 2.254239],
    ),
    (0.9, 10.0): (
        [20.666666, 10.666666, 10.266655, 9.906584, 9.582369],
        [5.374838, 2.624671, 3.493201, 4.033305, 4.398517],
    ),
}
"""Of another quadrature."""


@pytest.mark.parametrize(("launched", "truth"), BALLS.items())
def test_truths_of_the_ball_are_those_of_another_quadrature(launched, truth):
    exact = bodies.exact_impacts(*launched).section
    for values, prefix in zip(truth, ("", "sd_"), strict=True):
        found = [exact[f"{prefix}flight"][0], *exact[f"{prefix}y1"][:4]]
        assert found == pytest.approx(values, abs=1e-6)
    restitution, launch = launched
    square = exact["y1"] ** 2 + exact["sd_y1"] ** 2
    before = np.append(launch, restitution * exact["y1"][:-1])
    square_before = np.append(launch**2, restitution**2 * square[:-1])
    assert exact["y1"] == pytest.approx(exact["flight"] - before, abs=1e-6)
    assert square == pytest.approx(square_before + exact["flight"], abs=1e-5)


def test_height_of_the_dropped_ball_is_that_of_its_flights():
    """Bounce by bounce; mean and square about 25 are of another quadrature."""
    e = np.linspace(*bodies.RESTITUTION_ENDS, 20_001)
    heights = []
    for restitution in e:
        t = math.sqrt(2.0 * bodies.DROP_HEIGHT / bodies.GRAVITY)
        speed = restitution * bodies.GRAVITY * t
        while t + 2.0 * speed / bodies.GRAVITY < bodies.DROP_TIME:
            t += 2.0 * speed / bodies.GRAVITY
            speed *= restitution
        since = bodies.DROP_TIME - t
        heights.append(speed * since - 0.5 * bodies.GRAVITY * since**2)
    assert bodies._height(e) == pytest.approx(heights, abs=1e-9)
    weights = np.exp(-0.5 * ((e - bodies.RESTITUTION_MEAN) / bodies.RESTITUTION_SD) ** 2)
    mean = np.average(heights, weights=weights)
    square = np.average(np.subtract(heights, 25.0) ** 2, weights=weights)
    assert (mean, square) == (pytest.approx(28.01459, abs=2e-3), pytest.approx(36.00863, abs=2e-2))


def test_unknown_result_is_refused():
    assert "result = 'gravity'" in rattle("check published --result gravity", code=2).stderr


def test_result_that_does_not_reject_its_negative_control_fails():
    found = [Check("mean", 1.0, 1.0, 0.01)], {"1 % more": [Check("mean", 1.0, 1.01, 0.01)]}
    (blind,) = run_checks({"blind": Subject("blind", "", "", lambda *_: found)})
    assert blind.worst.holds(blind.allowed)
    assert not blind.holds
