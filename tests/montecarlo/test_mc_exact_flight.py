"""The exact flight: its Gaussian distribution, its orbit, and no step bias, against truths and
other schemes."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from mc_checks import (
    DAMPED,
    TOLERANT,
    UNEQUAL_GAPS,
    agrees,
    by_steps,
    dat21,
    limit,
    open_space,
    orbit_of,
)
from scipy.integrate import quad_vec

from rattle import Sampling
from rattle.montecarlo import SCHEMES, Record, largest_step, simulate, simulate_to
from rattle.montecarlo.diagnostics.diagnostics import diagnose_short_step
from rattle.montecarlo.schemes.crossing import CLOSE_TO_WALL
from rattle.montecarlo.schemes.exact_flight import flight_forcing
from rattle.montecarlo.schemes.step_size import neglected_noise
from rattle.scene import Scene, Start, Tolerance
from rattle.scene.flight import jacobian, noise_covariance, noise_rate

EXACT = "exact-flight"
QUANTITIES = ("tau", "flight", "x1", "y1", "x2", "y2")


def exact_step(scene, tau, h, across=1.0):
    """Matrix, shift and kicks of one step; `across` plants a wrong share of the area."""
    f = flight_forcing(scene.constants, tau, h)
    matrix = np.diag([1.0, 0.0, 1.0, 0.0])
    matrix[[0, 1, 2, 2, 3, 3], [1, 1, 1, 3, 1, 3]] = f.carry
    return matrix, f.drift, np.array([f.along, across * np.array(f.across)])


OPEN = {
    "DAT21": open_space(0.4),
    "unequal damping": open_space(0.4, beta2=0.9),
    "undamped": open_space(0.4, beta1=0.0),
}
FLIGHT = 1.6


def left_out(scene):
    """What increment and area miss of the covariance, per h^4: sigma^2 int k k' dr / 720, k the
    kernel's second rate.

    A function's part beyond its line over a short h has the square ``h^5 k^2 / 720`` to leading
    order.
    """
    tau = scene.start.tau + FLIGHT
    d = 1e-3

    def kernel(lag):
        return jacobian(scene.constants, lag)[:, [1, 3]] @ np.array(
            noise_rate(scene.constants, tau - lag)
        )

    def integrand(lag):
        bend = (kernel(lag + d) - 2.0 * kernel(lag) + kernel(lag - d)) / d**2
        return np.outer(bend, bend)

    return scene.sigma**2 / 720.0 * quad_vec(integrand, 0.0, FLIGHT, epsabs=1e-9)[0]


def missing(scene, across=1.0):
    """Covariance that the scheme lacks after a flight of 8, 16 and 32 steps, over the largest of
    what theory says."""
    exact = noise_covariance(scene.constants, scene.start.tau, FLIGHT)
    scale = np.abs(left_out(scene)).max()
    step = partial(exact_step, across=across)
    return [
        (exact - by_steps(scene, FLIGHT, FLIGHT / n, step)[1]) / ((FLIGHT / n) ** 4 * scale)
        for n in (8, 16, 32)
    ]


@pytest.mark.parametrize("case", OPEN)
def test_covariance_of_a_flight_lacks_only_what_is_said_to_be_left_out(case):
    """It falls as h^4, by 16 at each halving, and has the size that the second derivative of the
    kernel gives it."""
    rough, fine, finest = missing(OPEN[case])
    truth = left_out(OPEN[case]) / np.abs(left_out(OPEN[case])).max()
    assert np.abs(finest - truth).max() < 0.003
    assert np.abs(fine - truth).max() < 0.012
    assert np.abs(rough - truth).max() < 0.05


def test_check_of_the_covariance_sees_a_wrong_area():
    truth = left_out(OPEN["DAT21"]) / np.abs(left_out(OPEN["DAT21"])).max()
    assert np.abs(missing(OPEN["DAT21"], across=0.9999)[-1] - truth).max() > 0.05


ORBITS = {
    "DAT21": dat21(),
    "unequal gaps": UNEQUAL_GAPS,
    "damped": DAMPED,
    "single": dat21(stages=1),
    "wider": dat21(tolerance=Tolerance(0.04, 0.02, distribution="fixed")),
    "plastic": replace(UNEQUAL_GAPS, epsilon=0.05),
    "slow": replace(dat21(), alpha=0.3),
    "in flight": replace(dat21(), start=Start(0.4, 0.1, -0.3, -0.2, 0.6)),
}


def orbit_error(scene, dt, impacts=8, **changes):
    """Largest difference of impact times and states from the orbit by flight and restitution map
    alone."""
    rows = orbit_of(replace(scene, **changes), impacts)
    raw = simulate(
        scene, paths=1, impacts=impacts, dt=dt, scheme=EXACT, record=Record(raw=True)
    ).raw[0]
    if (raw[:, 6] != rows[:, 5]).any():
        return math.inf
    columns = slice(0, 5 if scene.stages == 2 else 3)
    return np.abs(raw[:, [0, 2, 3, 4, 5]] - rows[:, :5])[:, columns].max()


@pytest.mark.parametrize("case", ORBITS)
def test_noise_free_path_is_the_orbit_at_any_step(case):
    """Impacts are placed to 1e-10 of the half gap, and orbits expand."""
    scene = ORBITS[case]
    largest = largest_step(scene, EXACT)[0]
    for dt in (largest, 0.37 * largest, math.pi / 128.0, 1e-3):
        assert orbit_error(scene, dt, impacts=5) < 1e-9
        assert orbit_error(scene, dt, impacts=8) < 1e-8


def test_orbit_check_sees_another_restitution():
    assert orbit_error(dat21(), math.pi / 32.0, epsilon=dat21().epsilon + 1e-8) > 1e-9


def moments(run, prefixes=("", "sd_"), least=1e-9):
    """Section means and sds of what varies, with standard errors, flat."""
    table = run.section
    names = [p + q for p in prefixes for q in QUANTITIES if q[-1] != "2" or run.scene.stages == 2]
    values = table[names].to_numpy().ravel()
    se = table[[f"se_{n}" for n in names]].to_numpy().ravel()
    return values, se, se > least


def same_moments(a, b, slack=0.0):
    u, se_u, varies = moments(a)
    v, se_v, _ = moments(b)
    return agrees(u[varies], v[varies], np.hypot(se_u, se_v)[varies], slack)


NOISE = (0.05, 0.5, math.sqrt(1.5))
WALLED = {"DAT21": dat21(), "unequal gaps": UNEQUAL_GAPS, "redrawn walls": TOLERANT}


def sampled(scene, dt, paths=10_000, impacts=6, rng=1, **settings):
    return simulate(scene, paths=paths, impacts=impacts, dt=dt, scheme=EXACT, rng=rng, **settings)


@pytest.mark.parametrize("sigma", NOISE)
@pytest.mark.parametrize("case", WALLED)
def test_section_does_not_depend_on_the_step(case, sigma):
    scene = replace(WALLED[case], sigma=sigma)
    assert same_moments(sampled(scene, math.pi / 32.0), sampled(scene, math.pi / 128.0, rng=2))


@pytest.mark.parametrize("change", [{"sigma": 1.1 * 0.5}, {"epsilon": 0.9 + 0.03}, {"gap1": 0.51}])
def test_comparison_of_steps_sees_another_scene(change):
    scene = dat21(0.5)
    start = replace(scene.start, x1=change.get("gap1", 0.5))
    other = sampled(replace(scene, start=start, **change), math.pi / 128.0, rng=2)
    assert not same_moments(sampled(scene, math.pi / 32.0), other)


FROM_NOTHING = {
    "mesh 1": Scene(
        alpha=1.5,
        epsilon=0.9,
        beta1=0.083,
        gamma1=0.057,
        stages=1,
        sigma=0.1,
        start=Start(math.atan(0.083) - 0.011, 0.5, 35.0, 0.0, 0.0, mesh=1),
    ),
    "mesh 2": Scene(
        alpha=1.5,
        epsilon=0.9,
        mu=0.5,
        beta1=0.3,
        gamma1=0.057,
        beta2=0.05,
        gamma2=0.02,
        sigma=0.1,
        start=Start(0.5 * math.pi - 0.015, 0.1, 0.1, -0.45, 31.7),
    ),
}


@pytest.mark.parametrize("mesh", [1, 2])
def test_first_flight_of_a_step_in_which_the_modulation_crosses_zero(mesh):
    """The default step is shortened until the sd of the first impact's time is the exact one; the
    usual one is not."""
    scene = FROM_NOTHING[f"mesh {mesh}"]
    tau, speed = orbit_of(scene, 1)[0, [0, 2 * mesh]]
    spread = noise_covariance(scene.constants, scene.start.tau, tau - scene.start.tau)
    truth = math.sqrt(spread[2 * mesh - 2, 2 * mesh - 2]) / abs(speed)

    def z(dt):
        columns = simulate(scene, paths=100_000, impacts=1, rng=7, dt=dt).columns
        return float((columns["sd_tau"][0] - truth) / columns["se_sd_tau"][0])

    usual = min(SCHEMES[EXACT].step, largest_step(scene, EXACT)[0])
    assert abs(z(None)) < limit(1)
    assert z(usual) < -10.0
    run = simulate_to(scene, 0.02, impacts=1)
    assert (
        0.0
        < run.reach.step
        == neglected_noise(scene, run.dt)
        < 2e-4
        < 0.01
        < neglected_noise(scene, usual)
    )
    assert "leaves out noise" in diagnose_short_step(simulate(scene, paths=100, impacts=1))


def test_coarse_levels_of_one_noise_differ_by_no_bias():
    """Means at dt, 2 dt and 4 dt on the same noise: differences far below the spread, and within
    their errors."""
    table = sampled(dat21(0.05), math.pi / 64.0, 20_000, 4, record=Record(step_bias=True)).step_bias
    seen = table[table.se_bias > 1e-9]
    assert len(seen) > 20
    assert agrees(seen.bias, 0.0, seen.se_bias)


@pytest.mark.parametrize("scene", [UNEQUAL_GAPS, TOLERANT], ids=["fixed walls", "redrawn walls"])
def test_paths_that_stick_where_the_noise_vanishes_stay_within_the_gap(scene):
    """Around tau = 2 pi the noise of stage 1 goes through zero while the chatter of both stages
    dies out.

    A path that creeps along a wall there must not use up its cuts, nor pass the wall if it does.
    """
    c1, c2 = (scene.tolerance.c1_max, scene.tolerance.c2_max) if scene.tolerance else (0.0, 0.0)
    run = sampled(
        replace(scene, sigma=0.5),
        math.pi / 64.0,
        4000,
        60,
        rng=2,
        sampling=Sampling(horizon=7.0),
        record=Record(raw=True),
    )
    raw = run.raw[np.isfinite(run.raw[:, :, 0])]
    assert len(raw) > 50_000
    assert np.isfinite(raw).all()
    assert np.abs(raw[:, 2]).max() <= scene.gap1 * (1.0 + 2.0 * CLOSE_TO_WALL) + c1
    assert np.abs(raw[:, 4]).max() <= scene.gap2 * (1.0 + 2.0 * CLOSE_TO_WALL) + c2
