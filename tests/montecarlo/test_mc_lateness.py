"""Impacts detected late where noise does not smooth it: bounds that cover, verdicts that wait."""

import numpy as np

import rattle as rt
from rattle import DAT21, Scene

QUIET = Scene.from_gears(DAT21, sigma=0.01)


def test_the_rest_covers_what_late_detection_does():
    """All 24 means, within four standard errors beside the bound; without the bound some are far
    outside."""
    run = rt.simulate(QUIET, paths=20_000, impacts=4, dt=1.8e-3, scheme="euler-maruyama", rng=1)
    exact = rt.simulate(QUIET, paths=20_000, impacts=4, rng=1)
    rows, truth = (one.step_bias.query("moment == 'mean'") for one in (run, exact))
    error = np.abs(rows["corrected"] - truth["corrected"])
    by_chance = 4.0 * np.hypot(rows["se_corrected"], truth["se_corrected"]) + 1e-12
    assert (error <= rows["rest"] + by_chance).all()
    late = run.lateness.T.ravel()  # the rows go quantity by quantity
    extrapolated = rows["rest"] - late - np.abs(rows["bias"])
    assert (error > extrapolated + by_chance).any()


def test_closures_are_not_judged_by_late_detection():
    """By exact flights `saltation` is accurate here; by steps longer than the spread of impact
    times nothing is shown."""
    settings = {"impacts": 2, "paths": 20_000, "closures": ("saltation",), "rng": 1}
    by_steps = rt.validate(QUIET, scheme="euler-maruyama", dt=2e-3, **settings).table
    assert not (by_steps["verdict"] == "inaccurate").any()
    assert by_steps["remark"].str.contains("step").any()
    assert (rt.validate(QUIET, **settings).table["verdict"] == "accurate").any()


def test_much_noise_smooths_it():
    loud = QUIET.with_sigma(0.5)
    run = rt.simulate(loud, paths=2_000, impacts=2, dt=2e-3, scheme="euler-maruyama", rng=1)
    assert not run.lateness.any()
