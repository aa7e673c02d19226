"""The saltation closure: its derivative against the orbit, its moments against simulation."""

from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest
from common_scenes import SCENES

from rattle.closure import follow, mean_map
from rattle.montecarlo import simulate
from rattle.scene import DAT21, Scene, Start, Tolerance, section_names
from rattle.scene.flight import jacobian
from rattle.scene.impact import contact_matrix
from rattle.scene.tangent import saltation_matrix

dat21 = partial(Scene.from_gears, DAT21)
TOLERANCES = {
    "path, uniform": Tolerance(1e-3, 1e-3),
    "path, normal": Tolerance(1e-3, 2e-3, distribution="normal"),
    "contact, uniform": Tolerance(1e-3, 1e-3, draw="contact"),
    "contact, normal": Tolerance(2e-3, 1e-3, distribution="normal", draw="contact"),
    "fixed": Tolerance(1e-2, 2e-2, distribution="fixed"),
}


def state_after(scene, tau, state, later):
    """State of the orbit some time after another start in flight."""
    shifted = replace(scene, start=Start(tau, *state))
    return follow(shifted, 3).state(shifted.phase + later)


ORBITS = {name: SCENES[name](0.0) for name in ("DAT21", "unequal gaps", "restitution 0.5")}
ORBITS |= {
    f"alpha {alpha}": replace(ORBITS["DAT21"], alpha=alpha, start=None) for alpha in (0.6, 2.2)
}


@pytest.mark.parametrize("name", ORBITS)
def test_the_saltation_matrix_is_the_derivative_through_an_impact(name):
    scene = ORBITS[name]
    c = scene.constants
    orbit = follow(scene, 12)
    h = 1e-6
    for k in range(1, 12):
        early, late = 0.3 * np.diff(orbit.tau)[k - 1 : k + 1]
        tau = orbit.tau[k] - early
        state = orbit.state(tau)
        ends = [
            [state_after(scene, tau, state + step * e, early + late) for step in (h, -h)]
            for e in np.eye(4)
        ]
        moved = np.transpose([(one - other) / (2.0 * h) for one, other in ends])
        xi = saltation_matrix(c, orbit.mesh[k], orbit.tau[k], orbit.before[k])
        right, wrong = (
            jacobian(c, late) @ m @ jacobian(c, early)
            for m in (xi, contact_matrix(c, orbit.mesh[k]))
        )
        off = np.abs(moved - right).max()
        assert (
            off < (1e-8 if k < 7 else 1e-6) * np.abs(right).max()
        )  # differences lose digits as the orbit expands
        assert np.abs(moved - wrong).max() > 0.5  # the restitution map alone is not the derivative


def standard_errors(scene, run, prefixes, order=4):
    """By how many standard errors a prediction is off the sample in what varies, as far as all
    paths follow the orbit; by column, one row an impact."""
    section = run.section
    speed = section["y1"].where(section["mesh"] == 1, section.get("y2")).abs()
    # the noise is small until times spread, or an impact all but grazes
    small = (section["agreement"] == 1.0) & (section["sd_tau"] < 0.04) & (speed > 0.2)
    section = section[small.cummin()]
    predicted = mean_map(scene, impacts=12, order=order).section.loc[section.index]
    off = {}
    for quantity in section_names(scene.stages):
        for name in (prefix + quantity for prefix in prefixes):
            z = (predicted[name] - section[name]).abs() / section[f"se_{name}"]
            off[name] = z[section[f"sd_{quantity}"] > 1e-9]
    return pd.DataFrame(off)


TOLERANT = {name: dat21(sigma=0.002, tolerance=tolerance) for name, tolerance in TOLERANCES.items()}
QUIET = {name: of_sigma(0.002) for name, of_sigma in SCENES.items()} | TOLERANT


@pytest.mark.parametrize("name", QUIET)
def test_small_noise_section_moments(name):
    """Means and sds of tau, flights and states within 4 standard errors at sigma = 0.002."""
    run = simulate(QUIET[name], paths=40_000, scheme="exact-flight", rng=5)
    off = standard_errors(QUIET[name], run, ("", "sd_"))
    assert len(off) >= 6
    assert (off > 4.0).sum(axis=None) <= 1
    assert not (off > 6.0).any(axis=None)
    # negative control: another noise, or none of the tolerance
    wrong = dat21(sigma=0.002) if name in TOLERANT else QUIET[name].with_sigma(0.0022)
    assert (standard_errors(wrong, run, ("", "sd_")) > 6.0).any(axis=None)


SECOND = {
    "noise": dat21(sigma=0.02),
    "flanks": dat21(tolerance=Tolerance(2e-3, 2e-3, distribution="normal")),
}
"""Noise and flanks for which second order exceeds the sampling error of paths of one itinerary."""


@pytest.mark.parametrize("name", SECOND)
def test_mean_shift_and_skewness_are_of_second_order(name):
    """Of about 60 values, Bonferroni at 0.5 %; negative control: first order has neither."""
    scene = SECOND[name]
    run = simulate(scene, paths=400_000, scheme="exact-flight", rng=11, workers=2)
    assert standard_errors(scene, run, [""], order=3).max(axis=None) < 4.0
    assert standard_errors(scene, run, [""], order=2).max(axis=None) > 15.0
    if name == "noise":  # a flank is no Gaussian
        assert standard_errors(scene, run, ["skew_"], order=3).max(axis=None) < 4.0
        assert (run.section["skew_tau"] / run.section["se_skew_tau"]).abs().max() > 15.0


def test_the_first_flight_is_skew_as_its_end_is():
    m = mean_map(dat21(sigma=0.02), impacts=12).section
    assert m["skew_flight"].iloc[0] == pytest.approx(m["skew_tau"].iloc[0], rel=1e-12)
    assert (m["skew_flight"].iloc[1:] - m["skew_tau"].iloc[1:]).abs().min() > 1e-3


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
