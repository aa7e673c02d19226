"""The saltation closure: its derivative against the orbit, its moments against simulation."""

from dataclasses import replace

import numpy as np
import pytest
from common_scenes import SCENES

from rattle import Tolerances
from rattle.closure import follow, mean_map
from rattle.closure.section_map import derivatives, linearise_flight
from rattle.compare.validation.errors import section_errors
from rattle.montecarlo import Record, simulate
from rattle.montecarlo.statistics.intervals import ABSOLUTE
from rattle.scene import DAT21, SECTION, Scene, Start, Tolerance
from rattle.scene.flight import flow, jacobian, noise_covariance
from rattle.scene.impact import contact_matrix, next_impact, struck
from rattle.scene.tangent import saltation_matrix

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


@pytest.mark.parametrize("name", SCENES)
def test_covariance_is_propagated_by_the_saltation_matrix(name):
    """Section to section, at the impact times of the orbit: the recursion ``C -> Phi Xi C Xi' Phi'
    + Q``."""
    scene = SCENES[name](0.01)
    c = scene.constants
    orbit = follow(scene, 8)
    m = mean_map(scene, impacts=8)
    stage = slice(0, 2 * scene.stages)
    covariance = np.zeros((4, 4))
    for k in range(1, 9):
        t = orbit.tau[k] - orbit.tau[k - 1]
        j = jacobian(c, t)
        if k > 1:
            j = j @ saltation_matrix(
                c, orbit.mesh[k - 1], orbit.tau[k - 1], *orbit.before[k - 1, 1::2]
            )
        covariance = j @ covariance @ j.T + noise_covariance(c, orbit.tau[k - 1], t)
        found = m.trace.covariance[k]
        np.testing.assert_allclose(
            found[stage, stage], covariance[stage, stage], rtol=1e-6, atol=1e-9 * covariance.max()
        )


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


def some_first(names, *first):
    """All names, those of the second tier marked."""
    return [name if name in first else pytest.param(name, marks=pytest.mark.slow) for name in names]


def compared_with(scene, paths, z=4.0, seed=5, scheme="euler-maruyama-located", dt=1e-3):
    """Section errors of the rows that vary and that all paths reach along the closure's
    itinerary."""
    m = mean_map(scene, impacts=12)
    record = Record(step_bias=dt is not None, itineraries={"saltation": m.itinerary})
    run = simulate(scene, paths=paths, dt=dt, scheme=scheme, rng=seed, workers=2, record=record)
    table = section_errors([m], run, z, Tolerances())
    table["scale"] = table["noise"] / z
    return table[(table["unit"] > ABSOLUTE) & (table["agreement"] == 1.0)], run


@pytest.mark.parametrize("name", some_first(SCENES, "DAT21"))
def test_small_noise_section_moments(name):
    """Means and sds of tau, flights and states within 4 standard errors at sigma = 0.002, step bias
    accounted for."""
    table, _ = compared_with(SCENES[name](0.002), 40_000)
    assert table["impact"].nunique() >= 7
    outside = table[(table["low"] > 0.0) | (table["high"] < 0.0)]
    assert len(outside) <= 1, outside[["impact", "quantity", "moment", "error", "low", "high"]]
    assert (table["error"].abs() < 6.0 * table["scale"] + table["rest"]).all()


@pytest.mark.parametrize("name", some_first(TOLERANCES, "path, uniform", "contact, normal"))
def test_tolerances_as_components_of_the_section_state(name):
    scene = Scene.from_gears(DAT21, sigma=0.002, tolerance=TOLERANCES[name])
    table, _ = compared_with(scene, 40_000)
    outside = table[(table["low"] > 0.0) | (table["high"] < 0.0)]
    assert len(outside) <= 1, outside[["impact", "quantity", "moment", "error", "low", "high"]]
    if (
        scene.tolerance.distribution != "fixed"
    ):  # negative control: leaving the tolerance out is detected
        without = mean_map(Scene.from_gears(DAT21, sigma=0.002), impacts=12).section["sd_tau"]
        having = mean_map(scene, impacts=12).section["sd_tau"]
        assert (np.abs(without - having) > 0.02 * having).any()


@pytest.fixture(scope="module")
def second_order():
    """A noise at which second order exceeds the sampling error, and all paths share one
    itinerary."""
    scene = Scene.from_gears(DAT21, sigma=0.02)
    return scene, simulate(scene, paths=400_000, scheme="exact-flight", rng=11, workers=2)


def test_mean_shift(second_order):
    scene, run = second_order
    first, second = (mean_map(scene, impacts=12, order=order).section for order in (2, 3))
    z_first = []
    z_second = []
    for quantity in SECTION:
        varies = run.section[f"sd_{quantity}"] > ABSOLUTE
        se = run.section[f"se_{quantity}"][varies]
        simulated = run.section[quantity][varies]
        z_first += list(((first[quantity][varies] - simulated) / se).abs())
        z_second += list(((second[quantity][varies] - simulated) / se).abs())
    assert max(z_second) < 4.0  # of about 60 values, Bonferroni at 0.5 %
    assert max(z_first) > 15.0  # negative control: first order only


def test_skewness(second_order):
    scene, run = second_order
    predicted = mean_map(scene, impacts=12, order=3).section
    z = []
    z_none = {}
    for quantity in SECTION:
        varies = run.section[f"sd_{quantity}"] > ABSOLUTE
        se = run.section[f"se_skew_{quantity}"][varies]
        z += list(
            ((predicted[f"skew_{quantity}"] - run.section[f"skew_{quantity}"])[varies] / se).abs()
        )
        z_none[quantity] = (run.section[f"skew_{quantity}"][varies] / se).abs().max()
    assert max(z) < 4.0
    assert (
        min(z_none["tau"], z_none["flight"], z_none["y1"]) > 15.0
    )  # negative control: no skewness


def test_the_first_flight_is_skew_as_its_end_is():
    m = mean_map(Scene.from_gears(DAT21, sigma=0.02), impacts=12).section
    assert m["skew_flight"].iloc[0] == pytest.approx(m["skew_tau"].iloc[0], rel=1e-12)
    assert (m["skew_flight"].iloc[1:] - m["skew_tau"].iloc[1:]).abs().min() > 1e-3


@pytest.mark.slow
def test_what_remains_grows_as_sigma_squared():
    """Relative errors of the sds at three noise intensities: a multiple of sigma^2 fits, a constant
    does not."""
    sigmas = np.array([0.01, 0.02, 0.03])
    errors = []
    scales = []
    for sigma in sigmas:
        table, _ = compared_with(
            Scene.from_gears(DAT21, sigma=sigma), 200_000, scheme="exact-flight", dt=None
        )
        row = table[
            (table["quantity"] == "x1") & (table["moment"] == "sd") & (table["impact"] == 11)
        ]
        if row.empty:  # an off-itinerary path at the largest sigma
            pytest.fail("itineraries differ at a noise where they were measured to agree")
        errors.append((row["error"] / row["unit"]).item())
        scales.append((row["scale"] / row["unit"]).item())
    weight = 1.0 / np.array(scales) ** 2
    chi2 = {}
    for power in (0, 2):
        shape = sigmas**power
        slope = (weight * shape * errors).sum() / (weight * shape**2).sum()
        chi2[power] = (weight * (errors - slope * shape) ** 2).sum()
    assert chi2[2] < 13.8  # chi-square with 2 degrees of freedom at 0.1 %
    assert chi2[0] > 13.8


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
