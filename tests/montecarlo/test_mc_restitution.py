"""Restitution that is random, or falls with the impact speed: simulated impacts and `saltation`."""

import math

import numpy as np
import pytest
from scenes import chain

from rattle import (
    InputError,
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
from rattle.scene.tangent import saltation_matrix

GRAVITY = 9.807
HEIGHT = 50.0
READ_AT = 12.5  # between impacts 2 and 3 of all balls
MEAN_EPSILON = 0.9
SD_EPSILON = 0.02
LEAST_EPSILON = 0.84
BALL_PATHS = 40_000
# of 12 comparisons by one normal deviate each: false once in 5,000 runs
MOST_ERRORS = 4.2


BY_PATH = Restitution(sd=0.1, draw="path")


def ball(law, epsilon=MEAN_EPSILON, launch=None):
    """A ball that falls from rest, or leaves its floor at a speed; without noise."""
    start = Start(0.0, state=(-HEIGHT, 0.0)) if launch is None else Start(0.0, 0.0, -launch)
    body = Wheel(gamma=GRAVITY, gap=0.0, one_sided=True, restitution=law)
    return Scene(alpha=0.0, epsilon=epsilon, wheels=[body], start=start)


def heights_at(restitutions, time):
    """Height of balls that fall from rest, whose restitution at each impact is given."""
    v = np.full(restitutions.shape[1], math.sqrt(2.0 * GRAVITY * HEIGHT))
    since = np.full(v.size, time - v[0] / GRAVITY)
    for epsilon in restitutions:
        v = np.where(since > 0.0, epsilon * v, v)
        flight = 2.0 * v / GRAVITY
        last = since < flight
        height = v * since - 0.5 * GRAVITY * since**2
        if last.all():
            break
        since = np.where(last, since, since - flight)
    return height


def cut_normals(shape, rng):
    """Normal deviates of the restitution, cut as in the scene."""
    drawn = rng.normal(MEAN_EPSILON, SD_EPSILON, shape)
    while (out := (drawn < LEAST_EPSILON) | (drawn > 1.0)).any():
        drawn[out] = rng.normal(MEAN_EPSILON, SD_EPSILON, out.sum())
    return drawn


@pytest.mark.parametrize("draw", ["path", "contact"])
def test_the_height_of_a_ball_of_random_restitution_is_that_of_a_computation_apart(draw):
    """Mean and variance at a time, against a million balls by hand; a restitution that is drawn the
    other way is seen."""
    law = Restitution(sd=SD_EPSILON, least=LEAST_EPSILON, most=1.0, draw=draw)
    run = simulate(ball(law), paths=BALL_PATHS, impacts=3, rng=5, record=Record(times=[READ_AT]))
    at = run.at_times().reset_index().iloc[0]
    rng = np.random.default_rng(1)
    by_path = np.repeat(cut_normals((1, 10**6), rng), 2, axis=0)
    by_contact = cut_normals((2, 10**6), rng)
    deviates = {}
    for name, restitutions in {"path": by_path, "contact": by_contact}.items():
        height = heights_at(restitutions, at["time"])
        of_mean = (-at["x1"] - height.mean()) / math.hypot(at["se_x1"], height.std() / 1e3)
        off = (height - height.mean()) ** 2
        error = math.hypot(at["se_cov_x1_x1"], off.std() / 1e3)
        deviates[name] = max(abs(of_mean), abs(at["cov_x1_x1"] - off.mean()) / error)
    other = "contact" if draw == "path" else "path"
    assert deviates[draw] < MOST_ERRORS
    assert deviates[other] > 20.0


def test_the_bed_of_a_ball_of_random_restitution():
    """``E (y - 25)^2 = 36.00863`` for one draw a path, by quadrature over the restitution."""
    weight = np.linspace(LEAST_EPSILON, 1.0, 200_001)
    density = np.exp(-0.5 * ((weight - MEAN_EPSILON) / SD_EPSILON) ** 2)
    height = heights_at(np.repeat(weight[None], 2, axis=0), READ_AT)
    square = float(np.sum(density * (height - 25.0) ** 2) / np.sum(density))
    assert square == pytest.approx(36.00863, abs=2e-5)


def test_a_restitution_that_falls_with_the_speed_returns_what_it_says():
    """Of a ball without noise every launch is known; so is the derivative, by differences."""
    law = Restitution(speed=3.0)
    orbit = follow(ball(law, launch=8.0), 6)
    w = np.abs(orbit.before[1:, 1])
    assert np.abs(orbit.after[1:, 1]) == pytest.approx(0.9 * w * (1.0 + w / 3.0) ** -0.25)
    c = ball(law).constants
    for speed in (0.1, 4.0):
        state = np.array([0.0, speed])
        out = [0.9 * v * (1.0 + v / 3.0) ** -0.25 for v in (speed - 1e-5, speed + 1e-5)]
        slope = (out[1] - out[0]) / 2e-5
        assert saltation_matrix(c, 1, 0.0, state)[0, 0] == pytest.approx(-out[0] / speed, rel=1e-3)
        assert np.linalg.det(saltation_matrix(c, 1, 0.0, state)) == pytest.approx(
            slope * out[0] / speed, rel=1e-3
        )


RESTITUTION_ROWS = ((0.1, 0.9), (0.4, 0.9), (0.5, 0.7), (2.0, 0.6), (3.0, 0.0))
MEASURED = Restitution(table=RESTITUTION_ROWS)


def test_a_table_is_met_falls_and_has_a_slope_everywhere():
    """Rows are met, restitution is constant beyond them, falls between them, and returned speed
    and its derivatives fit each other; the first derivative has no jump at a row."""
    c = ball(MEASURED, epsilon=None).constants

    def returned(speed):
        state = np.array([0.0, speed])
        strike(c, 1, state)
        return -state[1]

    def slope(speed):
        return -contact_matrix(c, 1, speed)[1, 1]

    for speed, epsilon in (*RESTITUTION_ROWS, (0.01, 0.9), (50.0, 0.0)):
        assert returned(speed) == pytest.approx(epsilon * speed, abs=1e-14)
        assert slope(speed * (1.0 - 1e-12)) == pytest.approx(slope(speed), abs=1e-9)
    assert slope(0.1) == pytest.approx(0.9)
    speeds = np.linspace(0.05, 3.5, 700)
    epsilon = np.array([returned(speed) / speed for speed in speeds])
    assert (np.diff(epsilon) <= 1e-15).all()
    for speed in (0.05, 0.45, -0.45, 1.3, -2.9, 4.0):
        away = speed + np.array([-1e-5, 1e-5])
        assert slope(speed) == pytest.approx(np.diff([returned(v) for v in away])[0] / 2e-5)
        bend = np.diff([slope(v) for v in away])[0] / 2e-5
        assert rebound_bend(c, 1, speed) == pytest.approx(bend, rel=1e-6, abs=1e-9)


def test_a_table_made_of_the_formula_gives_what_the_formula_gives():
    """Rows 0.15 apart where impacts are: orbit, closures, energy lost and sampled paths, and what a
    locked chain of wheels returns; a table for another speed of the formula is seen in each."""
    formula = chain(Restitution(speed=4.0), 0.02)
    speeds = np.array([1e-3, *np.linspace(0.2, 2.2, 14), 6.0])
    dense, wrong = (
        chain(Restitution(table=zip(speeds, 0.9 * (1.0 + speeds / v) ** -0.25, strict=True)), 0.02)
        for v in (4.0, 4.001)
    )
    of_formula = pytest.approx(follow(formula, 4).before, abs=2e-6)
    assert follow(dense, 4).before == of_formula
    assert follow(wrong, 4).before != of_formula
    names = [f"{kind}{q}" for q in ("tau", "y1", "y2") for kind in ("", "sd_")]
    for closure in ("saltation", "branching"):
        right, planted, truth = (
            mean_map(scene, impacts=4, closure=closure).section[names].to_numpy()
            for scene in (dense, wrong, formula)
        )
        assert right == pytest.approx(truth, abs=5e-6), closure
        assert planted != pytest.approx(truth, abs=5e-6), closure
    settings = {"paths": 500, "impacts": 4, "rng": 3, "record": Record(energy=True)}
    right, planted, truth = (
        simulate(scene, **settings).section[[*names, "energy"]].to_numpy()
        for scene in (dense, wrong, formula)
    )
    assert right == pytest.approx(truth, abs=5e-6)
    assert planted != pytest.approx(truth, abs=5e-6)
    for scene in (dense, formula):
        body = np.array([0.0, 1.3])
        strike(as_bodies(scene.constants, np.array([1, 0])), 1, body)
        assert body[1] == pytest.approx(-1.3 * 0.9 * (1.0 + 1.3 / 4.0) ** -0.25, abs=1e-6)


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
    assert forced.mean() > MOST_ERRORS * forced.std(ddof=1) / math.sqrt(forced.size)


def measured(*rows, **others):
    """A law of restitution by some rows of a table."""
    return Restitution(table=rows, **others)


@pytest.mark.parametrize(
    ("make", "field", "value", "remedy"),
    [
        (lambda: Restitution(sd=1.5), "restitution.sd", "1.5", "between 0 and 1"),
        (lambda: Restitution(draw="once"), "restitution.draw", "once", "contact"),
        (lambda: Restitution(speed=0.0), "restitution.speed", "0.0", "greater than 0"),
        (lambda: ball(Restitution(sd=0.1, most=0.8)), "body.1.restitution", "0.8", "= 0.9"),
        (lambda: measured((0.1, 0.9)), "restitution.table", "0.9", "2 to 16 rows"),
        (lambda: Restitution(table=0.9), "restitution.table", "0.9", "2 to 16 rows"),
        (lambda: measured(*[(v, 0.5) for v in range(1, 18)]), "restitution.table", "17", "16"),
        (lambda: measured((0.1, 0.9, 1), (2, 0.8)), "restitution.table", "0.1", "impact speed"),
        (lambda: measured((0.0, 0.9), (1.0, 0.8)), "restitution.table", "0.0", "greater than 0"),
        (lambda: measured((2.0, 0.9), (1.0, 0.8)), "restitution.table", "1.0", "above 2"),
        (lambda: measured((1.0, 0.9), (2.0, 1.8)), "restitution.table", "1.8", "between 0 and 1"),
        (lambda: measured((1.0, 0.8), (2.0, 0.9)), "restitution.table", "0.9", "at most 0.8"),
        (lambda: measured((1.0, 0.0), (2.0, 0.0)), "restitution.table", "0.0", "epsilon = 0"),
        (lambda: measured(*RESTITUTION_ROWS, speed=2.0), "restitution.speed", "2.0", "not both"),
        (
            lambda: mean_map(ball(BY_PATH), impacts=2, closure="saltation"),
            "restitution.draw",
            "path",
            "contact",
        ),
        (
            lambda: stationary(ball(BY_PATH), periods=64),
            "restitution.draw",
            "path",
            "contact",
        ),
    ],
)
def test_a_law_that_cannot_be_is_refused_by_field_value_and_remedy(make, field, value, remedy):
    with pytest.raises(InputError) as caught:
        make()
    text = str(caught.value)
    assert text.startswith(field)
    assert value in text
    assert remedy in text


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
