"""The saltation closure against simulation, at the impacts and between them."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scenes import FOUR, ORDERS, OSCILLATOR, chain, dat21, tree

from rattle import Record, Scene, Start, Tolerance, follow, mean_map, simulate
from rattle.scene import Restitution, section_names, state_names

TOLERANCES = {
    "path, uniform": Tolerance(1e-3, 1e-3),
    "contact, normal": Tolerance(2e-3, 1e-3, distribution="normal", draw="contact"),
    "fixed": Tolerance(1e-2, 2e-2, distribution="fixed"),
}


PLAIN_SCENES = {
    "one stage": dat21(stages=1),
    "noisy wheel 2": replace(tree((0, 1)), noise=2).phase_reduced,
    "driven oscillator": OSCILLATOR,
}
REMEMBERING_SCENES = {
    "orders": dat21(drive=ORDERS),
    "orders and memory": dat21(drive=ORDERS, correlation_time=1.0),
    "long memory": dat21(correlation_time=10.0),
    "a body's own memory": replace(OSCILLATOR, correlation_time=0.5),
}
FALLING_ROWS = [(0.2, 0.9), (1.0, 0.8), (2.5, 0.7)]
LAWS = {
    "restitution falls": (Restitution(speed=4.0), None),
    "random restitution": (Restitution(sd=0.003, speed=4.0), Restitution(speed=4.0)),
    "measured restitution": (
        Restitution(sd=0.003, table=FALLING_ROWS),
        Restitution(table=FALLING_ROWS),
    ),
}
QUIET_SCENES = (
    {name: (s.with_sigma(0.002), s.with_sigma(0.0022)) for name, s in PLAIN_SCENES.items()}
    | {name: (dat21(0.002, tolerance=t), dat21(0.002)) for name, t in TOLERANCES.items()}
    | {
        name: (
            s.with_sigma(0.002),
            replace(s, sigma=0.002, correlation_time=0.1 + 1.2 * s.correlation_time),
        )
        for name, s in REMEMBERING_SCENES.items()
    }
    | {name: (chain(law, 0.002), chain(other, 0.002)) for name, (law, other) in LAWS.items()}
)
"""Each with a planted error: other noise, no tolerance, another memory, or another restitution."""
SLOW_IMPACT = 0.2  # speed of an impact after which first order in the noise is not enough
# sds of the impact times that must fit between a fixed time and the impacts around it
CLEARANCE = 6.0
SHORT = 0.1  # a fixed time is a whole number of steps, and lies beside the middle of a flight
LIMIT = 4.0  # standard errors; of at most 72 moments of a scene, Bonferroni at 0.5 %


def middles(scene):
    """Middles of the orbit's flights, at a distance from impacts and as long as none is slow."""
    orbit = follow(scene, 12)
    sd = mean_map(scene, impacts=12).section["sd_tau"]
    times = []
    for k in range(1, orbit.found + 1):
        half = 0.5 * (orbit.tau[k] - orbit.tau[k - 1])
        if half < CLEARANCE * sd.loc[max(k - 1, 1) : k].max():
            break
        if 2.0 * half > SHORT:
            times.append(orbit.tau[k] - half)
        if np.abs(orbit.before[k, 2 * orbit.mesh[k] - 1]) < SLOW_IMPACT:
            break
    return times


@pytest.fixture(scope="module", params=QUIET_SCENES)
def case(request):
    """Exact flights at sigma = 0.002, with their moments in the middle of flights."""
    scene, wrong = QUIET_SCENES[request.param]
    sampled = simulate(scene, paths=40_000, rng=5, record=Record(times=middles(scene)))
    return sampled, wrong


def standard_errors(scene, run, prefixes, order=4):
    """By how many standard errors a prediction is off the sample in what varies, as far as all
    paths follow the orbit; by column, one row an impact."""
    section = run.section
    before = section[[f"y{mesh}" for mesh in range(1, scene.stages + 1)]].to_numpy()
    speed = np.abs(before[range(len(section)), section["mesh"] - 1])
    # the noise is small until times spread, or an impact all but grazes
    small = (section["agreement"] == 1.0) & (section["sd_tau"] < 0.04) & (speed > SLOW_IMPACT)
    section = section[small.cummin()]
    predicted = mean_map(scene, impacts=12, order=order).section.loc[section.index]
    off = {}
    for quantity in section_names(scene.stages):
        for name in (prefix + quantity for prefix in prefixes):
            z = (predicted[name] - section[name]).abs() / section[f"se_{name}"]
            off[name] = z[section[f"sd_{quantity}"] > 1e-9]
    return pd.DataFrame(off)


def test_small_noise_section_moments(case):
    """Means and sds of tau, flights and states within 4 standard errors."""
    run, wrong = case
    off = standard_errors(run.scene, run, ("", "sd_"))
    assert len(off) >= 6
    assert (off > 4.0).sum(axis=None) <= 1
    assert not (off > 6.0).any(axis=None)
    assert (standard_errors(wrong, run, ("", "sd_")) > 6.0).any(axis=None)


def excess(run, scale=1.0):
    """Standard errors by which variances times `scale` are off at fixed times until which all paths
    have followed the orbit."""
    fixed = run.at_times()
    fixed = fixed[fixed.index < run.section["tau"][run.section["agreement"] == 1.0].max()]
    assert len(fixed) >= 3
    predicted = mean_map(run.scene, impacts=12).at_times(fixed.index)
    worst = []
    for name in (f"cov_{q}_{q}" for q in state_names(run.scene.stages)):
        off = (scale * predicted[name] - fixed[name]).abs() / fixed[f"se_{name}"]
        worst.append(off.where(fixed[name] > 1e-15, 0.0))  # before the noise has reached it
    return np.array(worst)


def test_sds_between_impacts(case):
    """Negative control: variances 5 % too large."""
    run, _ = case
    assert (excess(run) < LIMIT).all()
    assert (excess(run, scale=1.05) > LIMIT).any()


OF_SECOND_ORDER = {
    "noise": FOUR.with_sigma(0.02),
    "flanks": dat21(tolerance=Tolerance(2e-3, 2e-3, distribution="normal")),
}
"""Noise and flanks for which second order exceeds the sampling error of paths of one itinerary."""


@pytest.mark.parametrize("name", OF_SECOND_ORDER)
def test_mean_shift_and_skewness_are_of_second_order(name):
    """Of about 60 values, Bonferroni at 0.5 %; negative control: first order has neither."""
    scene = OF_SECOND_ORDER[name]
    run = simulate(scene, paths=100_000, rng=11)
    assert standard_errors(scene, run, [""], order=3).max(axis=None) < 4.0
    assert standard_errors(scene, run, [""], order=2).max(axis=None) > 7.5
    if name == "noise":  # a flank is no Gaussian
        assert standard_errors(scene, run, ["skew_"], order=3).max(axis=None) < 4.0
        assert (run.section["skew_tau"] / run.section["se_skew_tau"]).abs().max() > 7.5


def test_a_graze_is_reported_and_ends_the_closure():
    """Thrown against a constant pull with just the speed that reaches the wall: no derivative
    exists there."""
    for excess, grazes in ((1e-14, True), (1e-6, False)):
        start = Start(0.0, 0.0, -1.0 - excess)
        scene = Scene(
            alpha=0.0, epsilon=0.9, beta1=0.0, gamma1=1.0, stages=1, sigma=0.01, start=start
        )
        m = mean_map(scene, impacts=2)
        assert ("impact 1 grazes" in m.stopped) == grazes
        assert (m.trace.found == 0) == grazes
        assert m.section["tau"].isna().all() == grazes


def test_a_covariance_that_overflows_ends_the_closure():
    """The variance of a chaotic ball grows exponentially; numpy warns of nothing."""
    chaotic = Scene.load("examples/ball.toml")
    m = mean_map(chaotic, impacts=400, order=4)
    assert m.stopped == f"the covariance of impact {m.trace.found + 1} is larger than any number"
    sd = m.section["sd_y1"]
    assert sd.loc[m.trace.found] > 1e140
    assert np.isfinite(sd.loc[: m.trace.found]).all()
    assert sd.loc[m.trace.found + 1 :].isna().all()
    assert m.breakdown is None or m.breakdown.impact <= m.trace.found
