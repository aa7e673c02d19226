"""Restitution that is random, or falls with the impact speed: simulated impacts and `saltation`."""

import math
from functools import partial

import numpy as np
import pytest
from limits import FALSE_ALARM, limit
from refusals import refusal
from scenes import chain
from scipy import stats

from rattle import (
    Record,
    Scene,
    Start,
    Wheel,
    follow,
    mean_map,
    simulate,
    stationary,
    validate,
)
from rattle.montecarlo.long_run import long_run, walk
from rattle.montecarlo.long_run.sums import NOISE
from rattle.scene import Restitution
from rattle.scene.impact import contact_matrix, rebound_bend, strike
from rattle.scene.sticking import as_bodies

BY_PATH = Restitution(sd=0.1, draw="path")
SLOWING = Restitution(speed=3.0)
RESTITUTION_ROWS = ((0.1, 0.9), (0.4, 0.9), (0.5, 0.7), (2.0, 0.6), (3.0, 0.0))
MEASURED = Restitution(table=RESTITUTION_ROWS)
BALL_PATHS = 20_000


def ball(law, launch=1.0):
    """A ball that leaves its floor at a speed; without noise."""
    body = Wheel(gamma=9.807, gap=0.0, one_sided=True, restitution=law)
    return Scene(alpha=0.0, epsilon=0.9, wheels=[body], start=Start(0.0, 0.0, -launch))


@pytest.mark.parametrize("draw", ["path", "contact"])
def test_restitution_is_drawn_once_a_path_or_anew_at_each_impact(draw):
    """Each one is a cut normal deviate; half a percent more is noticed."""
    law = Restitution(sd=0.02, least=0.84, most=1.0, draw=draw)
    record = Record(raw=True)
    speed = simulate(ball(law), paths=BALL_PATHS, impacts=4, rng=5, record=record).raw[:, :, 3]
    drawn = (speed[:, 1:] / speed[:, :-1]).T
    cut = stats.truncnorm(-3.0, 5.0, 0.9, 0.02)
    for epsilon in drawn:
        assert stats.kstest(epsilon, cut.cdf).pvalue > FALSE_ALARM / 6
        assert stats.kstest(1.005 * epsilon, cut.cdf).pvalue < 1e-9
    if draw == "path":
        assert np.ptp(drawn, axis=0).max() < 1e-12
    else:
        correlations = np.corrcoef(drawn)[np.triu_indices(3, 1)]
        assert np.abs(correlations).max() * math.sqrt(BALL_PATHS) < limit(3)


def test_a_restitution_that_falls_with_the_speed_returns_what_it_says():
    """Of a ball without noise every launch is known."""
    orbit = follow(ball(SLOWING, launch=8.0), 6)
    w = np.abs(orbit.before[1:, 1])
    assert np.abs(orbit.after[1:, 1]) == pytest.approx(0.9 * w * (1.0 + w / 3.0) ** -0.25)


def returned(c, speed):
    """Speed after an impact."""
    state = np.array([0.0, speed])
    strike(c, 1, state)
    return -state[1]


def slope(c, speed):
    """Its derivative."""
    return -contact_matrix(c, 1, speed)[1, 1]


def test_a_table_is_met_and_falls_everywhere():
    """Rows are met, restitution is constant beyond them and falls between them; the first
    derivative has no jump at a row."""
    c = ball(MEASURED).constants
    for speed, epsilon in (*RESTITUTION_ROWS, (0.01, 0.9), (50.0, 0.0)):
        assert returned(c, speed) == pytest.approx(epsilon * speed, abs=1e-14)
        assert slope(c, speed * (1.0 - 1e-12)) == pytest.approx(slope(c, speed), abs=1e-9)
    speeds = np.linspace(0.05, 3.5, 700)
    epsilon = np.array([returned(c, speed) / speed for speed in speeds])
    assert (np.diff(epsilon) <= 1e-15).all()


@pytest.mark.parametrize("law", [SLOWING, MEASURED])
@pytest.mark.parametrize("speed", [0.05, 0.45, -0.45, 1.3, -2.9, 4.0])
def test_derivatives_of_a_returned_speed_are_its_differences(law, speed):
    c = ball(law).constants
    ends = speed - 1e-5, speed + 1e-5
    of_speed = np.diff([returned(c, end) for end in ends])[0] / 2e-5
    assert slope(c, speed) == pytest.approx(of_speed)
    of_slope = np.diff([slope(c, end) for end in ends])[0] / 2e-5
    assert rebound_bend(c, 1, speed) == pytest.approx(of_slope, rel=1e-6, abs=1e-9)


def test_a_table_made_of_the_formula_gives_what_the_formula_gives():
    """Rows 0.15 apart where impacts are: a closure, sampled paths and the energy that they lose,
    and what a locked chain of wheels returns; a table for another speed of the formula is seen."""
    names = [f"{kind}{q}" for q in ("tau", "y1", "y2") for kind in ("", "sd_")]

    def moments(law):
        scene = chain(law, 0.02)
        run = simulate(scene, paths=500, impacts=4, rng=3, record=Record(energy=True))
        predicted = mean_map(scene, impacts=4, closure="branching").section
        body = np.array([0.0, 1.3])
        strike(as_bodies(scene.constants, np.array([1, 0])), 1, body)
        sampled = run.section[[*names, "energy"]].to_numpy()
        return [*sampled.flat, *predicted[names].to_numpy().flat, body[1]]

    def rows(speed):
        speeds = np.array([1e-3, *np.linspace(0.2, 2.2, 14), 6.0])
        return zip(speeds, 0.9 * (1.0 + speeds / speed) ** -0.25, strict=True)

    truth = pytest.approx(moments(Restitution(speed=4.0)), abs=5e-6)
    assert moments(Restitution(table=rows(4.0))) == truth
    assert moments(Restitution(table=rows(4.001))) != truth


def test_a_long_run_of_random_restitution_has_no_control_variates(monkeypatch):
    """A piece of flight begins with a speed that no one knows: forced upon it, the work of the
    noise has no mean of zero."""
    body = Wheel(beta=0.1, gamma=0.3, restitution=Restitution(sd=0.2))
    scene = Scene(alpha=1.0, epsilon=0.6, sigma=0.5, wheels=[body])

    def work():
        run = long_run(scene, periods=128, paths=64, burn_in=32, rng=1)
        return run.sums.main[:, :, NOISE].sum(axis=1)

    assert not work().any()
    monkeypatch.setattr(walk, "has_controls", lambda constants: True)
    forced = work()
    assert forced.mean() > 4.2 * forced.std(ddof=1) / math.sqrt(forced.size)


BAD_LAWS = [
    ({"sd": 1.5}, "restitution.sd", "between 0 and 1"),
    ({"draw": "once"}, "restitution.draw", "contact"),
    ({"speed": 0.0}, "restitution.speed", "greater than 0"),
    ({"sd": 0.1, "most": 0.8}, "body.1.restitution", "= 0.9"),
    ({"table": [(0.1, 0.9)]}, "restitution.table", "2 to 16 rows"),
    ({"table": 0.9}, "restitution.table", "2 to 16 rows"),
    ({"table": [(0.1, 0.9, 1), (2, 0.8)]}, "restitution.table", "impact speed"),
    ({"table": [(0.0, 0.9), (1.0, 0.8)]}, "restitution.table", "greater than 0"),
    ({"table": [(2.0, 0.9), (1.0, 0.8)]}, "restitution.table", "above 2"),
    ({"table": [(1.0, 0.9), (2.0, 1.8)]}, "restitution.table", "between 0 and 1"),
    ({"table": [(1.0, 0.8), (2.0, 0.9)]}, "restitution.table", "at most 0.8"),
    ({"table": [(1.0, 0.0), (2.0, 0.0)]}, "restitution.table", "epsilon = 0"),
    ({"table": RESTITUTION_ROWS, "speed": 2.0}, "restitution.speed", "not both"),
]


@pytest.mark.parametrize(("settings", "field", "remedy"), BAD_LAWS)
def test_a_law_that_cannot_be_is_refused_by_field_and_remedy(settings, field, remedy):
    with refusal(f"^{field}.*{remedy}"):
        ball(Restitution(**settings))


@pytest.mark.parametrize("call", [partial(mean_map, closure="saltation"), stationary])
def test_a_restitution_of_each_path_is_refused_where_impacts_draw(call):
    with refusal("^restitution.draw = 'path'.*contact"):
        call(ball(BY_PATH))


def test_without_noise_restitution_is_its_mean():
    scene = ball(Restitution(sd=0.05, least=0.8, speed=2.0))
    assert scene.noise_free.tree[0].restitution == Restitution(speed=2.0)
    table = validate(scene, impacts=2, paths=2_000, closures=["saltation"], rng=1).table
    assert set(table["closure"]) == {"saltation"}


def test_a_table_of_a_file_is_multiplied_by_an_epsilon():
    """Of the first row by default; in another unit of length speeds alone are others."""
    body = """
        name = "ball"
        gamma = 1.0
        gap = 0.0
        one_sided = true
        restitution.table = [[0.5, 0.8], [2.0, 0.6]]
    """
    scene = Scene.from_toml(f"[scene]\nepsilon = 0.5\n[[body]]{body}")
    assert scene.tree[0].epsilon == 0.8
    assert scene.scaled(2.0).tree[0].restitution.table == ((1.0, 0.8), (4.0, 0.6))
    slower = Scene.from_toml(f"[scene]\n[[body]]{body}epsilon = 0.4")
    state = np.array([0.0, 3.0])
    strike(slower.constants, 1, state)
    assert state[1] == pytest.approx(-0.3 * 3.0)
