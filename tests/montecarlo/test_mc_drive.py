"""Several orders and noise with a memory, against an independent sampler in plain numpy and against
exact laws."""

import math
from dataclasses import replace

import numpy as np
import pytest
from oracle import two_stages
from scenes import ORDERS, THREE

from rattle import DAT21, Order, Record, Sampling, Scene, Start, mean_map, simulate
from rattle.montecarlo import SCHEMES
from rattle.montecarlo.long_run.run import long_run
from rattle.scene import STATE

IMPACTS = 4


def reference(scene, paths, impacts, rng, h=5e-4):
    """Section states ``tau, x1, y1, x2, y2`` by steps with a constant rate of the noise, and
    parabolas to the walls."""
    box = two_stages(scene.constants, scene.drive)
    theta = scene.correlation_time
    start = scene.start
    first = box.restitution(1) @ (start.x1, start.y1, start.x2, start.y2)
    x = np.tile(first[::2, None], paths)
    y = np.tile(first[1::2, None], paths)
    eta = rng.normal(size=paths) / math.sqrt(2.0 * theta) if theta else np.zeros(paths)
    section = np.full((impacts, 5, paths), np.nan)
    seen = np.zeros(paths, int)
    tau = 0.0
    while seen.min() < impacts and tau < 30.0:
        if theta:
            last = eta
            e = math.exp(-h / theta)
            eta = e * eta + math.sqrt((1.0 - e * e) / (2.0 * theta)) * rng.normal(size=paths)
            push = 0.5 * scene.sigma * (last + eta)
        else:
            push = scene.sigma * rng.normal(size=paths) / math.sqrt(h)
        left = np.full(paths, h)
        for _ in range(8):
            now = tau + h - left
            excitation = scene.alpha + push
            half = 0.5 * left
            middle = y + half * box.acceleration(now, y, excitation)
            a = box.acceleration(now + half, middle, excitation)
            share, mesh = first_wall(box, x, y, a, left)
            x = x + share * (y + 0.5 * share * a)
            y = y + share * a
            for i, gap in enumerate(box.gaps):
                struck = np.flatnonzero(mesh == i)
                x[i, struck] = np.sign(x[i, struck]) * gap
                new = struck[seen[struck] < impacts]
                row = [(now + share)[new], x[0, new], y[0, new], x[1, new], y[1, new]]
                section[seen[new], :, new] = np.array(row).T
                seen[struck] += 1
                jump = (1.0 + scene.epsilon) * y[i, struck]
                y[:, struck] -= np.multiply.outer(box.effect[:, i], jump)
            left = left - share
            if not (mesh >= 0).any():
                break
        tau += h
    return section


def first_wall(box, x, y, a, left):
    """Time until the parabola of each path meets a wall, at most what is left, and the mesh met or
    -1."""
    share = left.copy()
    mesh = np.full(len(left), -1)
    ends = x + left * (y + 0.5 * left * a)
    for i, gap in enumerate(box.gaps):
        for side in (1.0, -1.0):
            away = gap - side * x[i]
            speed = side * y[i]
            discriminant = speed**2 + 2.0 * side * a[i] * away
            root = speed + np.sqrt(np.maximum(discriminant, 0.0))
            hit = (side * ends[i] > gap) & (away > -1e-9) & (root > 0.0)
            positive = np.where(root > 0.0, root, 1.0)
            t = np.where(hit, 2.0 * np.maximum(away, 0.0) / positive, np.inf)
            mesh = np.where(t < share, i, mesh)
            share = np.minimum(share, t)
    return share, mesh


def farthest(scene, sampled, exact_paths=40_000):
    """Largest difference of a mean or an sd, in combined standard errors."""
    run = simulate(scene, paths=exact_paths, impacts=IMPACTS, rng=11).section
    worst = 0.0
    for i, name in enumerate(("tau", "x1", "y1", "x2", "y2")):
        values = sampled[:, i]
        mean = values.mean(axis=1)
        sd = values.std(axis=1)
        n = values.shape[1]
        fourth = ((values - mean[:, None]) ** 4).mean(axis=1)
        free = sd > 1e-9
        se_sd = np.sqrt(np.maximum(fourth - sd**4, 0.0) / n)[free] / (2.0 * sd[free])
        z_mean = (run[name] - mean)[free] / np.hypot(
            run["se_" + name][free], sd[free] / math.sqrt(n)
        )
        z_sd = (run["sd_" + name] - sd)[free] / np.hypot(run["se_sd_" + name][free], se_sd)
        worst = max(worst, np.abs(z_mean).max(), np.abs(z_sd).max())
    return worst


PLANTED = {
    "three orders": (THREE, {"drive": (ORDERS[0], Order(2, 0.4, 0.35), ORDERS[2])}),
    "theta 0.1": (
        Scene.from_gears(DAT21, sigma=0.1, correlation_time=0.1),
        {"correlation_time": 0.13},
    ),
    "theta 1": (
        Scene.from_gears(DAT21, sigma=0.1, correlation_time=1.0),
        {"correlation_time": 1.2},
    ),
    "theta 10": (replace(THREE, correlation_time=10.0), {"correlation_time": 12.0}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANTED)
def test_moments_are_those_of_an_independent_sampler_and_a_planted_error_is_found(name):
    scene, wrong = PLANTED[name]
    sampled = reference(scene, 10_000, IMPACTS, np.random.default_rng(3))
    assert farthest(scene, sampled) < 5.0  # of 36 comparisons
    assert farthest(replace(scene, **wrong), sampled) > 5.0


@pytest.mark.parametrize(
    "scheme",
    [
        pytest.param(name, marks=pytest.mark.slow) if SCHEMES[name].has_step_bias else name
        for name in SCHEMES
    ],
)
@pytest.mark.parametrize("theta", [0.05, 1.0])
def test_without_walls_the_covariance_is_that_of_the_linear_system(scheme, theta):
    start = Start(0.0, 0.0, 1.0, 0.0, 1.0)
    wide = {"gap1": 1e5, "gap2": 1e5}
    numbers = {
        "alpha": 1.0,
        "epsilon": 0.9,
        "beta1": 0.1,
        "beta2": 0.4,
        "gamma1": 0.05,
        "mu": 0.6,
        "sigma": 0.5,
    }
    scene = Scene(**numbers, **wide, correlation_time=theta, drive=ORDERS, start=start)
    dt = 5e-3
    paths = 20_480
    until = 1.0
    settings = {"record": Record(times=[until]), "sampling": Sampling(horizon=1.1), "rng": 5}
    run = simulate(scene, paths=paths, impacts=1, dt=dt, scheme=scheme, **settings)
    names = [f"cov_{a}_{b}" for i, a in enumerate(STATE) for b in STATE[i:]]
    upper = np.triu_indices(4)
    found = run.at_times()[names].to_numpy()[0]
    exact = _covariance(scene, until)
    se = np.sqrt((np.outer(np.diag(exact), np.diag(exact)) + exact**2) / paths)[upper]
    bias = 0.0 if scheme == "exact-flight" else 0.02 * np.abs(exact)[upper]  # of the Euler step
    assert (np.abs(found - exact[upper]) - bias < 5.0 * se).all()
    longer = _covariance(replace(scene, correlation_time=3.0 * theta), until)
    assert (np.abs(found - longer[upper]) > 5.0 * se).any()


def _covariance(scene, t):
    box = two_stages(scene.constants, scene.drive)
    return box.covariance(0.0, np.zeros((4, 4)), t, scene.correlation_time)


@pytest.mark.parametrize("drive", [(Order(1),), ORDERS])
@pytest.mark.parametrize("theta", [0.0, 0.1, 1.0, 10.0])
def test_saltation_is_the_limit_of_small_noise(drive, theta):
    scene = Scene.from_gears(DAT21, sigma=3e-3, drive=drive, correlation_time=theta)
    predicted = mean_map(scene, impacts=4).section
    run = simulate(scene, paths=20_000, impacts=4, rng=2).section
    for name in ("tau", "flight", "y1", "y2"):
        assert (abs(predicted["sd_" + name] - run["sd_" + name]) < 5.0 * run["se_sd_" + name]).all()
        assert (abs(predicted[name] - run[name]) < 5.0 * run["se_" + name]).all()
        assert (
            abs(predicted["skew_" + name] - run["skew_" + name]) < 5.0 * run["se_skew_" + name]
        ).all()
    other = replace(scene, correlation_time=theta + 0.1 + 0.2 * theta)
    wrong = mean_map(other, impacts=4).section
    assert (abs(wrong["sd_tau"] - run["sd_tau"]) > 5.0 * run["se_sd_tau"]).any()


def test_at_fixed_times_saltation_with_a_memory_is_the_sample():
    scene = Scene.from_gears(DAT21, sigma=3e-3, drive=ORDERS, correlation_time=0.5)
    orbit = mean_map(scene, impacts=4)
    tau = orbit.section["tau"].to_numpy()
    times = 0.5 * (tau[1:] + tau[:-1])
    found = simulate(scene, paths=20_000, impacts=4, rng=2, record=Record(times=times)).at_times(
        times
    )
    predicted = orbit.at_times(found.index)  # whole steps
    for name in ("cov_x1_x1", "cov_y1_y1", "cov_x2_y2", "cov_y2_y2"):
        off = abs(predicted[name].to_numpy() - found[name].to_numpy())
        assert (off < 5.0 * found["se_" + name].to_numpy()).all()


def test_moments_go_to_those_of_white_noise_as_the_memory_does():
    white = mean_map(Scene.from_gears(DAT21, sigma=0.01), impacts=3).section
    thetas = np.array([0.001, 0.0005, 0.00025])
    coloured = [
        mean_map(Scene.from_gears(DAT21, sigma=0.01, correlation_time=t), impacts=3).section
        for t in thetas
    ]
    for name in ("sd_tau", "sd_y1"):
        off = np.array([abs(one[name] - white[name]).to_numpy() for one in coloured])
        slopes = np.polyfit(np.log(thetas), np.log(off), 1)[0]
        assert slopes == pytest.approx(1.0, abs=0.03)  # no sampling error


def test_the_start_of_the_memory_is_stationary_and_of_each_path_alone():
    scene = Scene.from_gears(DAT21, sigma=0.3, correlation_time=0.5)
    few, many = (
        simulate(scene, paths=n, impacts=2, rng=4, record=Record(raw=True)) for n in (100, 1500)
    )
    assert (few.raw == many.raw[:100]).all()


def test_closed_teeth_stay_closed_while_noise_with_a_memory_presses_them():
    """With white noise they open in every step; here no force pulls them apart once their chatter
    is complete."""
    scene = Scene(
        alpha=1.0, epsilon=0.3, beta1=0.1, gamma1=3.0, stages=1, sigma=0.1, correlation_time=1.0
    )
    settings = {
        "paths": 32,
        "impacts": 400,
        "rng": 1,
        "record": Record(raw=True),
        "sampling": Sampling(horizon=12.0),
    }
    tau, pulled, white = (
        simulate(replace(scene, **change), **settings).raw[:, :, 0]
        for change in ({}, {"sigma": 2.0}, {"correlation_time": 0.0})
    )
    assert np.nanmax(tau) < 1.0
    assert np.isnan(tau[:, 100:]).all()
    assert np.nanmax(pulled) > 4.0  # negative control: a force that does pull
    assert not np.isnan(white).any()


@pytest.mark.slow
def test_a_long_run_of_one_order_written_as_several_is_the_same():
    base = Scene.from_gears(DAT21, sigma=0.3)
    nearly = replace(base, drive=(Order(1), Order(2, 1e-12)))
    one, other = (long_run(scene, periods=64, paths=32, rng=1) for scene in (base, nearly))
    values = {
        name: (e.value, other.estimates[name].value, e.se) for name, e in one.estimates.items()
    }
    for name, (a, b, se) in values.items():
        assert abs(a - b) < 6.0 * se + 1e-9, name
