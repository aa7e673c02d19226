"""Closed meshes in the sampler: the rule of `rattle.montecarlo.schemes.sticking`, and what it costs
in accuracy."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import STICKING
from settings import EXACT

from rattle import Record, Sampling, Scene, follow, simulate, stationary
from rattle.scene import state_names

STICKING_SCENES = STICKING | {
    "plastic": Scene(alpha=1.0, epsilon=0.0, beta1=0.1, gamma1=0.3, stages=1)
}


def distances(scene, scheme, dt, other=None):
    """Distance in x from the orbit (of another scene) at 200 times, as far as it is followed, over
    its largest speed."""
    orbit = follow(other or scene, 150)
    end = min(float(orbit.tau[orbit.found]), 12.0)
    given = {"paths": 1, "impacts": 10_000, "dt": dt, "scheme": scheme}
    record = Record(times=np.linspace(0.3, end - dt, 200))
    run = simulate(scene, sampling=Sampling(horizon=end), record=record, **given)
    assert run.sticking_steps > 10 or scheme != EXACT
    table = run.at_times()
    states = np.array([orbit.state(time) for time in table.index])
    gaps = table[[*state_names(scene.stages)[::2]]]
    return np.abs(gaps - states[:, ::2]).to_numpy().max(axis=1) / np.abs(states[:, 1::2]).max()


@pytest.mark.parametrize("scheme", ["euler-maruyama-located", "euler-maruyama"])
@pytest.mark.parametrize("name", STICKING_SCENES)
def test_sticking_costs_no_more_than_the_way_of_a_step(name, scheme):
    """The rule is late by less than a step.  What comes of that later, through ten or so impacts,
    is of its order."""
    coarse = distances(STICKING_SCENES[name], scheme, 0.02)
    fine = distances(STICKING_SCENES[name], scheme, 0.0023)
    assert np.median(coarse) <= 0.02
    assert fine.max() <= 10.0 * 0.0023
    assert np.median(fine) <= 0.0023
    assert fine.mean() < 0.5 * coarse.mean()


@pytest.mark.parametrize("name", STICKING_SCENES)
def test_exact_flights_are_right_to_second_order_through_sticking(name):
    """But where both meshes meet: there the impact of the other stage waits for the end of the
    step.  A mesh that opens 1 % later is noticed."""
    scene = STICKING_SCENES[name]
    assert distances(scene, EXACT, 0.0023).max() <= 10.0 * 0.0023
    assert np.median(distances(scene, EXACT, 0.005)) < 2e-6
    later = replace(scene, gamma1=1.01 * scene.gamma1)
    assert name != "one stage" or np.median(distances(scene, EXACT, 0.005, later)) > 1e-4


def test_a_mesh_that_never_opens_again_has_no_moments():
    scene = Scene(alpha=0.5, epsilon=0.5, beta1=0.0, gamma1=2.0, stages=1, sigma=1e-3)
    run = simulate(scene, impacts=10_000, paths=8, sampling=Sampling(horizon=60.0))
    assert run.unfinished == 8
    assert run.sticking_steps > 1000


def test_a_path_that_has_had_its_impacts_is_not_followed_through_the_chatter_after_them():
    """The same impacts bit for bit as where states at later times are asked for; there, sticking
    steps are counted."""
    scene = Scene(alpha=1.0, epsilon=0.3, beta1=0.05, gamma1=0.8, stages=1, sigma=1e-3)
    short, whole = (
        simulate(scene, paths=64, impacts=8, dt=0.02, rng=3, record=Record(raw=True, times=times))
        for times in ((), (20.0,))
    )
    assert np.array_equal(short.raw, whole.raw, equal_nan=True)
    assert short.sticking_steps == 0 < whole.sticking_steps


@pytest.mark.parametrize("drag", [5.0, 20.0])
def test_wheels_that_press_each_other_come_to_rest_with_noise(drag):
    """A stage that falls onto its wall beside a closed mesh gains nothing beyond it: it kept them
    moving for good."""
    scene = Scene(
        alpha=1.5, epsilon=0.9, beta1=0.0, gamma1=drag, gamma2=0.5 * drag, mu=0.6, sigma=0.01
    )
    assert stationary(scene, periods=64, paths=16, rng=1).kind == "rest"
