"""Random backlash in the branching closure: against exact flights, the saltation closure, and
differences."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from limits import LEEWAY
from scenes import SECTION, dat21

from rattle import Scene, Tolerance, mean_map, simulate

SDS = [f"sd_{q}" for q in SECTION]
RANDOM_WALLS = {  # and the impacts that are followed
    "no noise, path, uniform": (dat21(0.0, tolerance=Tolerance(0.01, 0.02)), 12),
    "contact, normal": (
        dat21(0.1, tolerance=Tolerance(0.01, 0.02, distribution="normal", draw="contact")),
        6,
    ),
    "one stage, path, uniform": (dat21(0.1, tolerance=Tolerance(0.05, 0.05), stages=1), 5),
    "another pair": (
        Scene(
            alpha=1.019,
            epsilon=0.7,
            beta1=0.128,
            beta2=0.028,
            gamma1=0.015,
            gamma2=0.093,
            mu=0.328,
            gap2=0.365,
            sigma=0.01,
            tolerance=Tolerance(0.05, 0.05, distribution="normal", draw="contact"),
        ),
        8,
    ),
}


def outside(scene, run):
    """How many means and sds, except of the struck displacement, and shares of the itinerary are
    off by more than allowed."""
    predicted = mean_map(scene, impacts=run.impacts, closure="branching").section
    sampled = run.section
    count = (abs(predicted["agreement"] - sampled["agreement"]) > 0.02).sum()
    for q in SECTION[: 2 + 2 * scene.stages]:
        unit = sampled[f"sd_{q}"]
        free = sampled["mesh"].map("x{}".format) != q
        for within, name in ((0.05, q), (0.10, f"sd_{q}")):  # what a validation calls accurate
            error = abs(predicted[name] - sampled[name]) / unit
            count += (error > within + LEEWAY * sampled[f"se_{name}"] / unit)[free].sum()
    return count


@pytest.mark.parametrize("name", RANDOM_WALLS)
def test_section_moments_and_itinerary_probabilities_against_exact_flights(name):
    """Negative controls: a draw that is not renewed (or is), and flanks that do not vary."""
    scene, impacts = RANDOM_WALLS[name]
    run = simulate(scene, paths=60_000, impacts=impacts, rng=5, workers=2)
    assert outside(scene, run) == 0
    other = "path" if scene.tolerance.draw == "contact" else "contact"
    for tolerance in (replace(scene.tolerance, draw=other), None):
        assert outside(replace(scene, tolerance=tolerance), run)


@pytest.mark.parametrize("draw", ["path", "contact"])
@pytest.mark.parametrize("distribution", ["uniform", "normal"])
def test_small_tolerance_is_the_saltation_closure(distribution, draw):
    scene = dat21(0.001, tolerance=Tolerance(5e-4, 1e-3, distribution=distribution, draw=draw))
    b, s = (mean_map(scene, impacts=5, closure=name).section for name in ("branching", "saltation"))
    without = mean_map(replace(scene, tolerance=None), impacts=5, closure="branching").section
    np.testing.assert_allclose(b[SDS], s[SDS], rtol=2e-3)
    assert (abs(b[SECTION] - s[SECTION]) < 2e-3 * s[SDS].to_numpy() + 1e-12).all(axis=None)
    assert (without["sd_tau"] < 0.8 * b["sd_tau"]).any()  # negative control: no tolerance


@pytest.mark.parametrize("name", ["contact, normal", "another pair"])
def test_rounding_does_not_choose_the_splits(name):
    """Rounding would choose sign and plane of the principal axes of decoupled blocks of a
    covariance."""
    scene, impacts = RANDOM_WALLS[name]
    other = replace(scene, alpha=scene.alpha * (1.0 + 4e-16), sigma=scene.sigma * (1.0 + 4e-16))
    one, two = (
        mean_map(s, impacts=impacts, closure="branching").section[[*SECTION, *SDS, "agreement"]]
        for s in (scene, other)
    )
    np.testing.assert_allclose(one, two, rtol=1e-9, atol=1e-9)


def test_walls_that_do_not_vary_are_walls_without_tolerance():
    """To the last bit, and at no cost: what does not vary is no component of the section state."""
    plain = dat21(0.1, stages=1)
    absent = Tolerance(0.0, 0.1, draw="contact")  # of the absent mesh
    b, other, none = (
        mean_map(replace(plain, tolerance=t), impacts=4, closure="branching").section
        for t in (Tolerance(0.0, 0.0), absent, None)
    )
    pd.testing.assert_frame_equal(b, none, check_exact=True)
    pd.testing.assert_frame_equal(other, none, check_exact=True)
