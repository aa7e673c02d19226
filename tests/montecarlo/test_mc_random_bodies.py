"""Balls, oscillators and pairs drawn at random, over orders of magnitude: exact flights against the
closure for small noise, against Euler's steps, and against the energy that drive and noise
supply."""

import math

import numpy as np
import pytest
from limits import agrees

from rattle import mean_map, simulate
from rattle.montecarlo.long_run import long_run
from rattle.scene import Scene, Start, Wheel

KINDS_OF_BODIES = ("ball", "oscillator with one wall", "oscillator with two walls", "pair")
SETS = 3  # of each kind
FAINT_SHARE = 1e-9  # noise over the speed, in which a chaotic ball too is linear for three impacts


def draw(kind, number, most_stiffness=300.0):
    """A body at the same random place of its ranges whatever the most that a spring may have; its
    noise, of the drive, its own or both, adds a speed of 3 to 100 % of that of its start in a unit
    of time."""
    rng = np.random.default_rng([7, KINDS_OF_BODIES.index(kind), number])

    def size(least, most):
        return 10.0 ** rng.uniform(math.log10(least), math.log10(most))

    alpha = size(0.1, 10.0) * (rng.random() < 0.8)
    gap = size(0.1, 3.0)
    stiffness = size(0.03, most_stiffness)
    body = Wheel(
        beta=size(0.03, 3.0),
        gamma=size(0.1, 10.0) if kind == "ball" else size(1e-3, 0.3),
        stiffness=stiffness if "oscillator" in kind else 0.0,
        one_sided="ball" in kind or "one wall" in kind,
        gap=0.0 if kind == "ball" or (rng.random() < 0.3 and "one wall" in kind) else gap,
        epsilon=rng.uniform(0.3, 1.0),
        name="body",
    )
    x = body.gap - rng.uniform(0.1, 1.5) * gap
    speed = alpha + gap * math.sqrt(1.0 + body.stiffness) + math.sqrt(body.gamma * gap)
    start = Start(rng.uniform(0.0, 6.0), x, rng.choice([-1.0, 1.0]) * speed)
    share = rng.random()
    noise = "body" if share < 1 / 3 or not alpha else "drive"
    if alpha and share > 2 / 3:
        noise = {"drive": 1.0, "body": 3.0 * share - 1.5}
    sigma = size(0.03, 1.0) * speed
    return Scene(alpha=alpha, sigma=sigma, noise=noise, wheels=[body], start=start)


def scenes(**ranges):
    """All sets of all kinds."""
    return [draw(kind, number, **ranges) for kind in KINDS_OF_BODIES for number in range(SETS)]


def test_every_kind_of_noise_is_drawn():
    noises = [scene.noise for scene in scenes()]
    assert {"drive", "body"} < set(noises)
    assert sum(isinstance(noise, tuple) for noise in noises) >= 3


def test_sampling_agrees_with_the_closure_at_small_noise():
    """Means and sds of as many of three impacts as all paths have; 10 % more noise is seen."""
    found = []
    for scene in scenes():
        faint = scene.with_sigma(FAINT_SHARE * abs(scene.start.y1))
        predicted = mean_map(faint, impacts=3, order=2).section
        sampled = simulate(faint, paths=4096, impacts=3, rng=11).section
        for k in sampled.index[sampled["agreement"] == 1.0]:
            for name in ("tau", "y1", "sd_tau", "sd_y1"):
                found.append([table.at[k, name] for table in (sampled, predicted)])
                found[-1] += [sampled.at[k, f"se_{name}"], name.startswith("sd_")]
    value, truth, se, is_sd = np.transpose(found)
    assert len(found) > 8 * len(KINDS_OF_BODIES) * SETS
    assert agrees(value, truth, se)
    assert not agrees(value, truth * (1.0 + 0.1 * is_sd), se)


@pytest.mark.parametrize("kind", KINDS_OF_BODIES)
def test_exact_flights_agree_with_fine_steps(kind):
    """Means and sds of flights and impact speeds, extrapolated to steps of length 0; a fifth more
    noise is seen.  Springs are soft: a stiff one gains energy by explicit steps."""
    gaps = []
    for number in range(SETS):
        scene = draw(kind, number, most_stiffness=3.0)
        exact, noisier, *stepped = (
            corrected_moments(scene.with_sigma(factor * scene.sigma), scheme, seed)
            for factor, scheme, seed in (
                (1.0, "exact-flight", 1),
                (1.2, "exact-flight", 1),
                (1.0, "euler-maruyama", 2),
                (1.0, "euler-maruyama-located", 2),
            )
        )
        for steps in stepped:
            se = np.hypot(exact["se_corrected"], steps["se_corrected"])
            for one in (exact, noisier):
                gaps.append([one["corrected"], steps["corrected"], se, steps["rest"]])
    assert agrees(*np.hstack(gaps[::2]))
    assert not agrees(*np.hstack(gaps[1::2]))


def corrected_moments(scene, scheme, seed):
    """Those of three impacts, less the bias of the step."""
    table = simulate(scene, paths=4096, impacts=3, scheme=scheme, rng=seed).step_bias
    return table[table["quantity"].isin(["flight", "y1"])]


def test_impacts_lose_what_drive_and_noise_supply():
    """Strong noise, so that no contact stays closed; 5 % less supply is seen."""
    found = []
    for number, scene in enumerate(scenes()):
        strong = scene.with_sigma(abs(scene.start.y1))
        run = long_run(strong, periods=64, paths=64, rng=number)
        lost, supplied = run.energy_balance()
        se = (lost - supplied).std(ddof=1) / math.sqrt(run.paths)
        found.append((lost.mean(), supplied.mean(), se))
        assert run.estimates["contact_share_mesh1"].value == 0.0
    lost, supplied, se = np.transpose(found)
    assert agrees(lost, supplied, se)
    assert not agrees(lost, 0.95 * supplied, se)
