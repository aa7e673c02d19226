"""Random backlash in the branching closure: against exact flights, the saltation closure, and differences."""

from dataclasses import fields, replace

import numpy as np
import pandas as pd
import pytest

from rattle.closure import mean_map, section_map
from rattle.closure.branching.propagate import _derivatives, event
from rattle.closure.section_map import column, start_covariance, start_pieces
from rattle.montecarlo import Record, simulate
from rattle.scene import DAT21, Scene, Start, Tolerance

QUANTITIES = ("tau", "flight", "x1", "y1", "x2", "y2")
WITHIN = {"mean": 0.05, "sd": 0.10}  # what a validation calls accurate, in sds
LEEWAY = 4.5  # standard errors: the largest of 500 rows is that far off once in 300 tables
PAIR = {"alpha": 1.019, "epsilon": 0.7, "beta1": 0.128, "beta2": 0.028, "gamma1": 0.015, "gamma2": 0.093, "mu": 0.328}
OTHER = {"alpha": 1.226, "epsilon": 0.879, "beta1": 0.054, "beta2": 0.07, "gamma1": 0.035, "gamma2": 0.023, "mu": 0.568}


def dat21(sigma, tolerance, **settings):
    return Scene.from_gears(DAT21, sigma=sigma, tolerance=tolerance, **settings)


SCENES = {  # and the impacts that are followed
    "no noise, path, uniform": (dat21(0.0, Tolerance(0.01, 0.02)), 12),
    "no noise, contact, uniform": (dat21(0.0, Tolerance(0.03, 0.03, draw="contact")), 6),
    "contact, normal": (dat21(0.1, Tolerance(0.01, 0.02, distribution="normal", draw="contact")), 6),
    "path, normal": (dat21(0.5, Tolerance(0.05, 0.1, distribution="normal")), 6),
    "one stage, path, uniform": (dat21(0.1, Tolerance(0.05, 0.05), stages=1), 5),
    "another pair": (
        Scene(**PAIR, gap2=0.365, sigma=0.01, tolerance=Tolerance(0.05, 0.05, distribution="normal", draw="contact")),
        8,
    ),
    "a third pair": (Scene(**OTHER, gap2=0.358, sigma=0.0, tolerance=Tolerance(0.05, 0.05)), 6),
}


def outside(scene, impacts, run):
    """Rows of a prediction that are off by more than allowed: all means and sds except of the struck displacement."""
    predicted, found = mean_map(scene, impacts=impacts, closure="branching").section, run.section
    rows = []
    for q in QUANTITIES[: 2 + 2 * scene.stages]:
        unit = found[f"sd_{q}"]
        free = found["mesh"].map("x{}".format) != q
        for moment, name in (("mean", q), ("sd", f"sd_{q}")):
            error = (predicted[name] - found[name]).abs() / unit
            allowed = WITHIN[moment] + LEEWAY * found[f"se_{name}"] / unit
            rows += [(k, moment, q, error[k]) for k in found.index[free & (error > allowed)]]
    return rows


def flown(scene, impacts):
    follows = tuple(mean_map(scene, impacts=impacts, closure="corrected").itinerary)
    return simulate(
        scene,
        paths=60_000,
        impacts=impacts,
        rng=5,
        workers=2,
        scheme="exact-flight",
        record=Record(itineraries={"orbit": follows}),
    )


@pytest.fixture(scope="module", params=SCENES)
def case(request):
    scene, impacts = SCENES[request.param]
    return scene, impacts, flown(scene, impacts)


@pytest.mark.slow
def test_section_moments_against_exact_flights(case):
    assert outside(*case) == []


def test_itinerary_probabilities_against_exact_flights(case):
    scene, impacts, run = case
    expected = mean_map(scene, impacts=impacts, closure="branching").section["agreement"]
    np.testing.assert_allclose(expected, run.agreement["orbit"], atol=0.02)


def test_negative_controls_are_detected(case, monkeypatch):
    """A draw that is not renewed (or is), flanks that do not vary, and a start on the wrong side of its flank."""
    scene, impacts, run = case
    other = {"path": "contact", "contact": "path"}[scene.tolerance.draw]
    assert outside(replace(scene, tolerance=replace(scene.tolerance, draw=other)), impacts, run)
    assert outside(replace(scene, tolerance=None), impacts, run)
    if scene.tolerance.draw == "path":  # else the side has no effect
        right = section_map._place(scene)
        monkeypatch.setattr(section_map, "_place", lambda scene: np.vstack([-right[:5], right[5:]]))
        assert outside(scene, impacts, run)


def test_one_gaussian_in_place_of_the_distribution_is_detected(monkeypatch):
    """Its tails reach walls that no gear has."""
    scene, impacts = SCENES["no noise, path, uniform"]
    run = flown(scene, impacts)
    monkeypatch.setattr(section_map, "PIECES", 1)
    assert outside(scene, impacts, run)


@pytest.mark.parametrize("stages", [1, 2])
@pytest.mark.parametrize("draw", ["path", "contact"])
@pytest.mark.parametrize("distribution", ["uniform", "normal"])
def test_small_tolerance_is_the_saltation_closure(distribution, draw, stages):
    scene = dat21(0.001, Tolerance(5e-4, 1e-3, distribution=distribution, draw=draw), stages=stages)
    b, s = (mean_map(scene, impacts=5, closure=name).section for name in ("branching", "saltation"))
    without = mean_map(replace(scene, tolerance=None), impacts=5, closure="branching").section
    for q in QUANTITIES[: 2 + 2 * stages]:
        sd = s[f"sd_{q}"]
        assert ((b[q] - s[q]).abs() < 2e-3 * sd + 1e-12).all()
        np.testing.assert_allclose(b[f"sd_{q}"], sd, rtol=2e-3)
    assert (without["sd_tau"] < 0.8 * b["sd_tau"]).any()  # negative control: no tolerance


@pytest.mark.parametrize("name", ["contact, normal", "path, normal", "another pair"])
def test_rounding_does_not_choose_the_splits(name):
    """Rounding would choose sign and plane of the principal axes of decoupled blocks of a covariance."""
    scene, impacts = SCENES[name]
    scene = Scene(**{f.name: getattr(scene, f.name) for f in fields(scene) if f.init})
    other = replace(scene, alpha=scene.alpha * (1.0 + 4e-16), sigma=scene.sigma * (1.0 + 4e-16))
    one, two = (mean_map(s, impacts=impacts, closure="branching").section for s in (scene, other))
    quantities = [*QUANTITIES, *(f"sd_{q}" for q in QUANTITIES), "agreement"]
    np.testing.assert_allclose(one[quantities], two[quantities], rtol=1e-9, atol=1e-9)


def test_walls_that_do_not_vary_are_walls_without_tolerance():
    """To the last bit, and at no cost: what does not vary is no component of the section state."""
    plain = dat21(0.1, None, stages=1)
    for tolerance in (Tolerance(0.0, 0.0), Tolerance(0.0, 0.1, draw="contact")):  # of the absent mesh
        b, none = (mean_map(s, impacts=4, closure="branching") for s in (replace(plain, tolerance=tolerance), plain))
        pd.testing.assert_frame_equal(b.section, none.section, check_exact=True)


@pytest.mark.parametrize("y", [(-1.0, -1.2), (1.5, 0.3), (0.5, 2.0), (-0.5, -2.0)])
def test_derivatives_with_respect_to_flanks(y):
    """Of all nine columns, against differences; the four starts end on four flanks."""
    c = dat21(0.1, None).constants
    centre = np.array([0.2, 0.1, y[0], 0.05, y[1], 0.02, -0.01, 0.03, 0.01])
    before, away = np.empty(4), np.empty(4)
    t, code = event(c, centre, before)
    linear = 1e9 * _derivatives(c, code, centre, 1e-9 * np.eye(9), t, before)[0]  # so narrow that nothing grazes
    h, found = 1e-6, np.zeros((5, 9))
    for k in range(9):
        for sign in (1.0, -1.0):
            there = centre + sign * h * np.eye(9)[k]
            flight, met = event(c, there, away)
            assert met == code
            found[:, k] += sign * np.array([there[0] + flight, *away]) / (2.0 * h)
    np.testing.assert_allclose(linear[:5], found, atol=1e-7)
    np.testing.assert_allclose(linear[5:], np.eye(9)[5:])
    assert abs(found[:, column(abs(code), code)]).max() > 0.1  # the wall that is struck matters


@pytest.mark.parametrize("draw", ["path", "contact"])
@pytest.mark.parametrize("start", [None, Start(0.0, -0.5, -2.0, 0.2, 1.0, mesh=1), Start(0.3, 0.1, 1.0, -0.5, 1.0)])
def test_the_start_as_a_mixture_has_the_covariance_of_the_whole(draw, start):
    scene = dat21(0.0, Tolerance(0.03, 0.06, distribution="normal", draw=draw), start=start)
    parts = start_pieces(scene)
    assert len(parts.weight) == {"path": 36, "contact": 1}[draw]
    second = np.einsum("p,pab->ab", parts.weight, parts.variance + parts.mean[:, :, None] * parts.mean[:, None, :])
    np.testing.assert_allclose(parts.weight @ parts.mean, 0.0, atol=1e-15)
    np.testing.assert_allclose(second, start_covariance(scene), atol=1e-15)
