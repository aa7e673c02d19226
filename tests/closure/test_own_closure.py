"""A closure of one's own: what is read of its table, what is refused, and when its digest
changes."""

import functools
import pickle
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from refusals import refusal
from scenes import dat21

from rattle import Closure, mean_map, validate
from rattle.closure import CLOSURES

KNOWN_SCENE = dat21(0.02)
SALTATION = mean_map(KNOWN_SCENE, impacts=4, closure="saltation")


def copy(scene, impacts):
    """Saltation, as if it were one's own."""
    return mean_map(scene, impacts=impacts, closure="saltation").section


def table(**columns):
    return lambda scene, impacts: columns


def test_what_it_predicts_stands_in_the_columns_of_the_other_closures():
    own = mean_map(KNOWN_SCENE, impacts=4, closure=copy).section
    pd.testing.assert_frame_equal(own, SALTATION.section[own.columns])


def test_what_it_leaves_out_is_not_predicted_and_the_orbit_gives_its_impacts():
    found = mean_map(KNOWN_SCENE, impacts=2, closure=table(tau=[0.5, 0.9], sd_y1=[0.1, 0.2]))
    assert found.section["flight"].tolist() == pytest.approx([0.5, 0.4])
    assert found.section[["y1", "sd_tau", "rho1"]].isna().all(axis=None)
    assert found.itinerary == SALTATION.itinerary[:2]
    assert found.section["realizable"].all()
    assert found.at_times([0.3])["rho1"].isna().all()
    assert found.density(1, "y1", np.zeros(3)) is None


def test_what_it_changes_of_the_scene_is_its_own():
    def changes(scene, impacts):
        object.__setattr__(scene.start, "tau", 3.0)
        object.__setattr__(scene, "alpha", 99.0)
        return {"tau": np.arange(1.0, impacts + 1.0)}

    scene = dat21(0.02)
    mean_map(scene, impacts=2, closure=changes)
    assert scene == KNOWN_SCENE


@pytest.mark.parametrize(
    ("columns", "reason"),
    [
        ({"sd_y1": [-0.1, 0.1]}, "sd of y1 = -0.1 < 0"),
        ({"rho1": [1.2, 0.0]}, "|rho| = 1.2 > 1"),
    ],
)
def test_what_no_distribution_has_is_marked_and_not_refused(columns, reason):
    found = mean_map(KNOWN_SCENE, impacts=2, closure=table(tau=[0.5, 0.9], **columns))
    assert found.section["realizable"].tolist() == [False, True]
    assert found.breakdown.reason == reason


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (table(tau=[0.5]), "length of tau of .* = 1: return 2 values, one for each impact"),
        (table(tau=[0.5, 10**5000]), "tau of .* = <list>: must hold real numbers"),
        (table(tau=[0.5, 0.9], mesh=[1, 7]), "mesh of .* at impact 2 = 7: give 1 or 2"),
        (table(tau=[0.5, 0.9], side=[1, 0.5]), "side of .* at impact 2 = 0.5: give 1 or -1"),
        (
            lambda scene, impacts: pd.DataFrame([[1, 2]] * 2, columns=["tau", "tau"]),
            "columns of .*: holds a name twice",
        ),
        (table(tau=["a", "b"]), "tau of .* = .*: must hold real numbers"),
        (
            table(tau=[0.5, 0.9], sd_tua=[0.1, 0.1]),
            "columns of .* = 'sd_tua': did you mean 'sd_tau'?",
        ),
        (table(mesh=[1, 2]), "columns of .*: nothing is predicted; return tau or sd_y1, say"),
        (
            lambda scene, impacts: None,
            "result of .* = 'NoneType': return a DataFrame, a row for each impact",
        ),
        (
            lambda scene, impacts: pd.DataFrame({"tau": [0.5, 0.9]}),
            r"index of .* = \[0, 1\]: must hold each impact once",
        ),
    ],
)
def test_a_table_that_cannot_be_read_is_refused_by_field_value_and_remedy(function, message):
    with refusal(message):
        mean_map(KNOWN_SCENE, impacts=2, closure=function)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("saltation", copy),
            "closure.name = 'saltation': is a closure of this package; give yours another name",
        ),
        (("monte carlo", copy), "closure.name = 'monte carlo'"),
        (("two\nlines", copy), "closure.name = .*give a short text on one line"),
        (("mine", 3), "closure.function = 3: cannot be called"),
        (("mine", copy, 3), "closure.at_times = 3: cannot be called"),
        (("mine", copy, None, ("sd_tua",)), "closure.predicts = 'sd_tua': did you mean 'sd_tau'"),
        (("mine", copy, None, "tau"), "closure.predicts = 'tau': give a list of columns"),
        (("mine", copy, None, (), 33), "closure.stages = 33: must be at most 32"),
    ],
)
def test_what_cannot_be_a_closure_is_refused(arguments, message):
    with refusal(message):
        Closure(*arguments)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            "no_such_module:f",
            "cannot be imported .ModuleNotFoundError.*; run where its module is, or set PYTHONPATH",
        ),
        ("rattle.closure.mean_map:mean_mop", "has no 'mean_mop'; did you mean 'mean_map'?"),
        ("rattle.closure.mean_map:ORDER_RANGE", "is a tuple; name a function"),
        ("saltaton", "did you mean 'saltation'"),
        (3.0, "give the name of a closure, package.module:function, or a function"),
    ],
)
def test_what_names_no_closure_is_refused(given, message):
    with refusal(message):
        mean_map(KNOWN_SCENE, closure=given)


def test_two_closures_of_one_name_are_refused_and_one_given_twice_is_one():
    found = validate(
        KNOWN_SCENE, impacts=1, closures=["saltation", copy, copy, "saltation"], paths=64
    )
    assert list(found.predictions) == ["saltation", "copy"]
    with refusal("closures = 'copy': is the name of two closures"):
        validate(KNOWN_SCENE, closures=[copy, Closure("copy", table(tau=[0.5]))])


def test_missing_columns_and_stages_are_those_that_it_says():
    with refusal("'sd_tau' is missing; return it too"):
        mean_map(
            KNOWN_SCENE,
            impacts=2,
            closure=Closure("mine", table(tau=[0.5, 0.9]), predicts=["tau", "sd_tau"]),
        )
    with refusal(r"scene\.stages = 2: closure 'mine' is made for 1 wheel"):
        mean_map(KNOWN_SCENE, impacts=2, closure=Closure("mine", copy, stages=1))


def test_fixed_times_may_be_given_by_covariances():
    def at_times(scene, times):
        return {
            "cov_x1_x1": 4.0 + 0.0 * times,
            "cov_x1_y1": 1.0 + 0.0 * times,
            "cov_y1_y1": 1.0 + 0.0 * times,
        }

    found = mean_map(KNOWN_SCENE, impacts=2, closure=Closure("mine", copy, at_times)).at_times(
        [0.3, 0.4]
    )
    assert found["rho1"].tolist() == [0.5, 0.5]
    assert found["rho2"].isna().all()


def recurse(scene, impacts):
    return recurse(scene, impacts)


def leave(scene, impacts):
    raise SystemExit(3)


def fail(scene, impacts):
    raise ValueError("two\nlines")


def ask(scene, impacts):
    return mean_map(scene, impacts=0)


def test_an_exception_is_raised_by_mean_map_and_becomes_one_line_in_comparisons():
    with pytest.raises(ValueError, match="two"):
        mean_map(KNOWN_SCENE, impacts=2, closure=fail)
    found = validate(KNOWN_SCENE, impacts=2, closures=[fail, ask, leave, recurse], paths=64).failed
    said = {
        "fail": "ValueError: two lines",
        "ask": "InputError: impacts = 0",
        "leave": "SystemExit: 3",
        "recurse": "Recursion",
    }
    for name, words in said.items():
        assert found[name].startswith(f"raised {words}")
        assert "\n" not in found[name]


@pytest.mark.parametrize(
    "tau",
    [
        np.ma.array([0.5, 0.7, 0.9], mask=[False, True, False]),
        pd.array([0.5, pd.NA, 0.9], dtype="Float64"),
        [0.5, None, 0.9],
        [0.5, np.inf, 0.9],
    ],
    ids=["masked", "NA", "None", "infinite"],
)
def test_what_is_no_number_is_not_predicted(tau):
    found = mean_map(KNOWN_SCENE, impacts=3, closure=table(tau=tau))
    assert found.section["tau"].isna().tolist() == [False, True, False]


def test_its_times_are_those_of_the_scene_that_it_was_given():
    late = replace(KNOWN_SCENE, start=replace(KNOWN_SCENE.start, tau=-7.0))

    def constant(scene, impacts):
        return {"tau": scene.start.tau + np.array([0.6, 1.1])}

    def at_times(scene, times):
        return {"x1": times - scene.start.tau}

    own = mean_map(late, impacts=2, closure=Closure("mine", constant, at_times))
    assert own.section["tau"].tolist() == pytest.approx([-6.4, -5.9], abs=1e-12)
    local = own.phase_reduced.section["tau"].tolist()
    assert local == pytest.approx([late.phase + 0.6, late.phase + 1.1], abs=1e-12)
    assert own.at_times([-6.7])["x1"].tolist() == pytest.approx([0.3])


def test_its_digest_changes_with_the_values_that_it_is_made_with_and_with_nothing_else():
    def make(factor):
        return lambda scene, impacts: {"tau": factor * np.arange(impacts)}

    def scaled(scene, impacts, factor=1.0):
        return {"tau": factor * np.arange(impacts)}

    assert Closure("a", make(1.0)).digest != Closure("a", make(2.0)).digest
    assert Closure("a", make(1.0)).digest == Closure("a", make(1.0)).digest
    assert Closure("a", functools.partial(scaled, factor=2.0)).digest != Closure("a", scaled).digest
    assert all(closure.digest == closure.reference == "" for closure in CLOSURES.values())


def test_it_is_found_again_by_its_reference_and_when_pickled():
    reference = Closure("copy", copy).reference
    assert mean_map(KNOWN_SCENE, impacts=1, closure=reference).closure == "copy"
    assert Closure("mine", copy).reference == ""
    assert Closure("mine", lambda scene, impacts: None).reference == ""
    found = pickle.loads(pickle.dumps(mean_map(KNOWN_SCENE, impacts=2, closure=copy)))
    assert found.closure == "copy"
