"""The saltation closure: its derivative against the orbit, its moments against simulation."""

from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest
from common_scenes import SCENES

from rattle.closure import follow, mean_map
from rattle.closure.section_map import derivatives, linearise_flight
from rattle.montecarlo import simulate
from rattle.scene import DAT21, SECTION, Scene, Start, Tolerance
from rattle.scene.flight import flow, jacobian
from rattle.scene.impact import contact_matrix, next_impact, struck
from rattle.scene.tangent import saltation_matrix

dat21 = partial(Scene.from_gears, DAT21)
TOLERANCES = {
    "path, uniform": Tolerance(1e-3, 1e-3),
    "path, normal": Tolerance(1e-3, 2e-3, distribution="normal"),
    "contact, uniform": Tolerance(1e-3, 1e-3, draw="contact"),
    "contact, normal": Tolerance(2e-3, 1e-3, distribution="normal", draw="contact"),
    "fixed": Tolerance(1e-2, 2e-2, distribution="fixed"),
}


def state_from(c, tau, state, end):
    """State of the orbit at the time `end`, through all impacts on the way."""
    while True:
        t, mesh, _, *before = next_impact(c, tau, *state, end - tau)
        if mesh <= 0:
            return np.array(before)
        y1, y2 = struck(c, mesh, before[1], before[3])
        tau = tau + t
        state = (before[0], y1, before[2], y2)


ORBITS = {name: SCENES[name](0.0) for name in ("DAT21", "unequal gaps", "restitution 0.5")}
ORBITS |= {
    f"alpha {alpha}": replace(ORBITS["DAT21"], alpha=alpha, start=None) for alpha in (0.6, 2.2)
}


@pytest.mark.parametrize("name", ORBITS)
def test_the_saltation_matrix_is_the_derivative_through_an_impact(name):
    c = ORBITS[name].constants
    orbit = follow(ORBITS[name], 12)
    h = 1e-6
    for k in range(1, 12):
        early, late = 0.3 * np.diff(orbit.tau)[k - 1 : k + 1]
        tau = orbit.tau[k] - early
        state = orbit.state(orbit.tau[k] - early)
        end = orbit.tau[k] + late
        moved = [
            (state_from(c, tau, state + h * e, end) - state_from(c, tau, state - h * e, end))
            / (2.0 * h)
            for e in np.eye(4)
        ]
        xi = saltation_matrix(c, orbit.mesh[k], orbit.tau[k], *orbit.before[k, 1::2])
        right, wrong = (
            jacobian(c, late) @ m @ jacobian(c, early)
            for m in (xi, contact_matrix(c, orbit.mesh[k]))
        )
        off = np.abs(np.transpose(moved) - right).max()
        assert (
            off < (1e-8 if k < 7 else 1e-6) * np.abs(right).max()
        )  # differences lose digits as the orbit expands
        assert (
            np.abs(np.transpose(moved) - wrong).max() > 0.5
        )  # the restitution map alone is not the derivative


def section_map(c, mesh, side, t, u, d):
    """The section map at ``u = (s, n)``, by Newton on the flow."""
    x1, y1, x2, y2 = np.array(flow(c, *u[:5], t)) + u[d:]
    wall = side * (c.wall1 if mesh == 1 else c.wall2)
    if d > 5:
        wall += side * u[5 + 2 * (mesh - 1) + (side < 0)]
    late = 0.0
    state = (x1, y1, x2, y2)
    for _ in range(10):
        late += (wall - state[2 * mesh - 2]) / state[2 * mesh - 1]
        state = flow(c, u[0] + t, x1, y1, x2, y2, late)
    return np.array([u[0] + t + late, *state, *u[5:d]])


@pytest.mark.parametrize("d", [5, 9])
@pytest.mark.parametrize("name", ["DAT21", "unequal gaps", "restitution 0.5", "single stage"])
def test_derivatives_of_the_section_map(name, d):
    scene = SCENES[name](0.0)
    c = scene.constants
    orbit = follow(scene, 6)
    live = [0, 1, 2, 3, 4] if scene.stages == 2 else [0, 1, 2]
    for k in range(1, 7):
        mesh = int(orbit.mesh[k])
        side = int(orbit.side[k])
        t = orbit.tau[k] - orbit.tau[k - 1]
        parts = linearise_flight(c, orbit.tau[k - 1], orbit.after[k - 1], t, orbit.before[k])
        first, second = derivatives(parts, mesh, side, d)
        base = np.zeros(d + 4)
        base[:5] = orbit.tau[k - 1], *orbit.after[k - 1]

        def at(u, mesh=mesh, side=side, t=t, base=base):
            return section_map(c, mesh, side, t, base + u, d)

        np.testing.assert_allclose(
            at(0 * base)[live], np.array([orbit.tau[k], *orbit.before[k]])[live], atol=1e-12
        )
        speed = abs(orbit.before[k][2 * mesh - 1])
        step = 1e-4 * min(1.0, speed**2)  # the map is nonlinear on the scale speed^2
        units = step * np.eye(d + 4)
        varied = [i for i in range(d + 4) if scene.stages == 2 or i not in (3, 4, d + 2, d + 3)]
        for i in varied:
            slope = (at(units[i]) - at(-units[i])) / (2 * step)
            np.testing.assert_allclose(
                slope[live], first[live, i], atol=1e-5 * max(1.0, np.abs(first[live]).max())
            )
            for j in varied:
                bend = at(units[i] + units[j]) - at(units[i] - units[j]) - at(units[j] - units[i])
                bend = (bend + at(-units[i] - units[j])) / (4 * step**2)
                scale = max(1.0, np.abs(second).max())
                np.testing.assert_allclose(
                    bend[live], second[live, i, j], atol=1e-15 / step**2 + 1e-4 * scale
                )


def standard_errors(scene, run, prefixes, order=4):
    """By how many standard errors a prediction is off the sample in what varies, as far as all
    paths follow the orbit; by column, one row an impact."""
    section = run.section
    speed = section["y1"].where(section["mesh"] == 1, section["y2"]).abs()
    # the noise is small until times spread, or an impact all but grazes
    small = (section["agreement"] == 1.0) & (section["sd_tau"] < 0.04) & (speed > 0.2)
    section = section[small.cummin()]
    predicted = mean_map(scene, impacts=12, order=order).section.loc[section.index]
    off = {}
    for quantity in SECTION[: 2 + 2 * scene.stages]:
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


@pytest.fixture(scope="module")
def second_order():
    """A noise at which second order exceeds the sampling error, and all paths share one
    itinerary."""
    scene = dat21(sigma=0.02)
    return scene, simulate(scene, paths=400_000, scheme="exact-flight", rng=11, workers=2)


@pytest.mark.parametrize(("prefix", "least"), [("", 15.0), ("skew_", 15.0)])
def test_mean_shift_and_skewness_are_of_second_order(second_order, prefix, least):
    """Of about 60 values, Bonferroni at 0.5 %; negative control: first order has neither."""
    assert standard_errors(*second_order, [prefix], order=3).max(axis=None) < 4.0
    first = standard_errors(*second_order, [prefix], order=2)
    none = second_order[1].section["skew_tau"] / second_order[1].section["se_skew_tau"]
    assert (none.abs() if prefix else first).max(axis=None) > least


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
