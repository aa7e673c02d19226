"""Impacts detected late where noise does not smooth it: bounds that cover, verdicts that wait."""

import numpy as np
from scenes import dat21

import rattle as rt
from rattle import Scene, Start, Wheel
from rattle.montecarlo.statistics.section_statistics import extrapolate

LATE_SCENE = dat21(0.01)


def errors(run, truth):
    """Rows of the means of a run; their errors, and what four standard errors explain of them."""
    rows, exact = (one.step_bias.query("moment == 'mean'") for one in (run, truth))
    by_chance = 4.0 * np.hypot(rows["se_corrected"], exact["se_corrected"]) + 1e-12
    return rows, np.abs(rows["corrected"] - exact["corrected"]), by_chance


def test_the_rest_covers_what_late_detection_does():
    """All 24 means, within four standard errors beside the bound; without the bound some are far
    outside."""
    given = {"paths": 20_000, "impacts": 4, "rng": 1}
    run = rt.simulate(LATE_SCENE, dt=1.8e-3, scheme="euler-maruyama", **given)
    rows, error, by_chance = errors(run, rt.simulate(LATE_SCENE, **given))
    assert (error <= rows["rest"] + by_chance).all()
    late = run.lateness.T.ravel()  # the rows go quantity by quantity
    extrapolated = rows["rest"] - late - np.abs(rows["bias"])
    assert (error > extrapolated + by_chance).any()


def test_closures_are_not_judged_by_late_detection():
    """By exact flights `saltation` is accurate here; by steps longer than the spread of impact
    times nothing is shown."""
    settings = {"impacts": 2, "paths": 20_000, "closures": ("saltation",), "rng": 1}
    by_steps = rt.validate(LATE_SCENE, scheme="euler-maruyama", dt=2e-3, **settings).table
    assert not (by_steps["verdict"] == "inaccurate").any()
    assert by_steps["remark"].str.contains("step").any()
    assert (rt.validate(LATE_SCENE, **settings).table["verdict"] == "accurate").any()


def test_much_noise_smooths_it():
    loud = LATE_SCENE.with_sigma(0.5)
    run = rt.simulate(loud, paths=2_000, impacts=2, dt=2e-3, scheme="euler-maruyama", rng=1)
    assert not run.lateness.any()


def test_the_rest_covers_what_extrapolation_misses_in_a_flight_of_few_steps():
    """Nearly no noise, and a first flight of about five steps, at 16 steps: the mean impacts within
    four standard errors and the rest; what three step sizes tell alone misses some."""
    body = Wheel(gamma=1.0, one_sided=True, gap=0.0)
    start = Start(0.5, -0.1, 1.0)
    scene = Scene(alpha=1.0, epsilon=0.8, sigma=1e-6, wheels=[body], noise=1, start=start)
    given = {"paths": 256, "impacts": 1, "rng": 1}
    truth = rt.simulate(scene, **given)
    missed = 0
    for dt in np.linspace(0.19, 0.205, 16) * truth.section["flight"][1]:
        run = rt.simulate(scene, dt=dt, scheme="euler-maruyama-located", **given)
        rows, error, by_chance = errors(run, truth)
        assert (error <= rows["rest"] * (1.0 + 1e-9) + by_chance).all()
        means = extrapolate(run.result.sums["fine_coarse"], run.result.sums["coarse_coarser"])
        missed += (error > means["mean"].rest[0] + by_chance).any()
    assert missed > 0
