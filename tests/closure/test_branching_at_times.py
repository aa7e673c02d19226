"""The branching closure at fixed times: against the saltation closure at small noise, and exact
flights at larger."""

from dataclasses import replace

import numpy as np
import pytest
from random_gears import gear_sets, noisy

from rattle.closure import follow, mean_map
from rattle.closure.branching import RESOLUTIONS
from rattle.closure.branching.fixed_times import FixedTimes
from rattle.montecarlo import Record, simulate
from rattle.scene import DAT21, STATE, InputError, Scene, Tolerance

IMPACTS = 6
LEEWAY = 4.5  # standard errors: the largest of 500 rows is that far off once in 300 tables
DAT = Scene.from_gears(DAT21)
LONE, PAIR = (gear_sets()[i].phase_reduced for i in (4, 5))  # one stage, two stages
SCENES = {  # and what is allowed besides sampling, in sds
    "DAT21": (noisy(DAT, 0.1), 0.04),
    "DAT21, strong": (noisy(DAT, 0.3), 0.05),
    "one stage": (noisy(LONE, 0.03), 0.03),
    "two stages": (noisy(PAIR, 0.03), 0.05),
    "flanks of each contact": (
        replace(noisy(DAT, 0.05), tolerance=Tolerance(0.02, 0.02, draw="contact")),
        0.05,
    ),
    "flanks of each path": (
        replace(noisy(PAIR, 0.03), tolerance=Tolerance(0.02, 0.02, distribution="normal")),
        0.05,
    ),
}


def moments_of(scene):
    return FixedTimes(scene, follow(scene, IMPACTS).until_sticking, RESOLUTIONS[-1], IMPACTS)


def times_of(scene):
    """Middles of the orbit's flights, and its impacts: there a part of the paths has had the
    impact, a part not."""
    tau = follow(replace(scene, sigma=0.0), IMPACTS).tau
    return np.sort(np.concatenate([0.5 * (tau[1:] + tau[:-1]), tau[1:-1]]))


def flown(name):
    """A scene, what is allowed, and its moments at fixed times."""
    scene, allowed = SCENES[name]
    record = Record(times=times_of(scene))
    run = simulate(
        scene, paths=40_000, impacts=1, scheme="exact-flight", rng=11, workers=1, record=record
    )
    return scene, allowed, run.at_times()


@pytest.fixture(scope="module", params=SCENES)
def case(request):
    scene, allowed, fixed = flown(request.param)
    return scene, allowed, fixed, moments_of(scene)


def outside(scene, allowed, fixed, at):
    """How many means and sds are off by more than allowed, of how many."""
    count = 0
    rows = 0
    for time, row in fixed.iterrows():
        mean, covariance = at(time)
        for i, name in enumerate(STATE[: 2 * scene.stages]):
            variance = row[f"cov_{name}_{name}"]
            sd = variance**0.5
            se = 0.5 * row[f"se_cov_{name}_{name}"] / variance
            count += not abs(mean[i] - row[name]) < (allowed + LEEWAY * row[f"se_{name}"] / sd) * sd
            count += not abs(covariance[i, i] ** 0.5 / sd - 1.0) < 2.0 * allowed + LEEWAY * se
            rows += 2
    return count, rows


def test_against_exact_flights(case):
    assert outside(*case)[0] == 0


PLANTED = {
    "no cut at the next impact": lambda f: f._replace(end=f.end + np.array([np.inf, 0.0])),
    "its time does not depend on the state": lambda f: f._replace(crossing=0.0 * f.crossing),
    "all noise at the start": lambda f: f._replace(time=0.0 * f.time),
    "later noise not conditioned on the state": lambda f: f._replace(regression=0.0 * f.regression),
}


@pytest.mark.parametrize("error", PLANTED)
def test_planted_errors_are_detected(error):
    scene, allowed, fixed = flown("DAT21")
    at = moments_of(scene)
    at(fixed.index[-1])
    at.flights = [PLANTED[error](f) for f in at.flights]
    at.__class__ = type("Planted", (FixedTimes,), {"_follow": lambda self: False})
    assert outside(scene, allowed, fixed, at)[0] > 0


def test_one_orbit_alone_is_wrong(case):
    """Negative control: the saltation closure, which has no paths on different flights."""
    scene, allowed, fixed, _ = case
    m = mean_map(scene, impacts=IMPACTS)
    reached = fixed[fixed.index < m.trace.span[1]]
    count, rows = outside(scene, allowed, reached, m.trace.at)
    assert count > 0.3 * rows


@pytest.mark.parametrize("scene", [DAT, LONE, PAIR], ids=["DAT21", "one stage", "two stages"])
def test_in_flight_at_small_noise_it_is_the_saltation_closure(scene):
    """To first order: means differ by O(sigma) of an sd, which saltation leaves out there, sds by
    O(sigma^2)."""
    tau = follow(scene, IMPACTS).tau
    times = 0.5 * (tau[1:] + tau[:-1])
    off = {}
    for noise in (1e-4, 1e-5):
        b, s = (
            mean_map(noisy(scene, noise), impacts=IMPACTS, closure=name)
            for name in ("branching", "saltation")
        )
        b = b.at_times(times)
        s = s.at_times(times)
        names = STATE[: 2 * scene.stages]
        sd = np.column_stack([s[f"cov_{q}_{q}"] ** 0.5 for q in names])
        own = np.column_stack([b[f"cov_{q}_{q}"] ** 0.5 for q in names])
        off[noise] = abs(b[[*names]].to_numpy() - s[[*names]].to_numpy()) / sd, abs(own / sd - 1.0)
        np.testing.assert_allclose(b["rho1"], s["rho1"], atol=1e4 * noise**2)
    for i, power in enumerate((1, 2)):
        coarse = off[1e-4][i].max()
        fine = off[1e-5][i].max()
        assert fine < 5e-3
        assert np.log10(coarse / fine) == pytest.approx(power, abs=0.1)


def test_as_many_flights_are_followed_as_the_time_asks_for():
    """At the mean time of the last impact some paths are beyond it, and all are counted."""
    scene, _ = SCENES["DAT21, strong"]
    m, further = (mean_map(scene, impacts=k, closure="branching") for k in (3, 6))
    time = m.section["tau"].loc[3]
    assert moments_of(scene).gaussians(time)[0].sum() == pytest.approx(1.0, abs=0.02)
    # the label "on the orbit" ends with the orbit that is asked for, so components merge a little
    # differently
    np.testing.assert_allclose(m.at_times([time]), further.at_times([time]), rtol=5e-3, atol=1e-3)
    few = moments_of(scene)
    few.most = 3
    assert np.isnan(
        few(time)[0]
    ).all()  # negative control: a part of the paths is on the fourth flight
    with pytest.raises(InputError, match="lies outside the times followed"):
        m.at_times([time + 0.1])
