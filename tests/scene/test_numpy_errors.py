"""``np.seterr(all="raise")`` in a user's program ends nothing of the package, and holds in his own
functions."""

import inspect

import numpy as np
import pytest
from scenes import dat21

import rattle
from rattle import Closure, Record, mean_map, simulate, validate
from rattle.montecarlo import simulate_rare

SOFT = dat21(0.01)
ALL_RECORDS = Record(histogram=True, energy=True, on_itinerary=True, times=[0.3, 0.8])
COMPUTE = {
    "mean_map": lambda scene: mean_map(scene, impacts=3, closure="branching"),
    "simulate": lambda scene: simulate(scene, paths=2000, impacts=3, record=ALL_RECORDS),
    "simulate_rare": lambda scene: simulate_rare(scene, impacts=3, paths=4096),
    "validate": lambda scene: validate(scene, impacts=3, paths=2000),
}


@pytest.mark.parametrize("name", COMPUTE)
def test_what_underflows_is_no_exception(name):
    with np.errstate(all="raise"):
        answer = COMPUTE[name](SOFT)
        assert answer.section is not None if name != "validate" else len(answer.table)
        assert repr(answer)
        assert np.geterr()["under"] == "raise"


def test_a_function_of_ones_own_has_the_settings_of_its_program():
    seen = []

    def own(scene, impacts):
        section = mean_map(scene, impacts=impacts).section
        seen.append(np.geterr())
        return section

    with np.errstate(all="raise", over="ignore"):
        mean_map(
            SOFT,
            impacts=2,
            closure=Closure("mine", own, at_times=lambda scene, times: own(scene, 2) and None),
        )
        expected = np.geterr()
    assert seen == [expected]
    with np.errstate(all="raise"), pytest.raises(FloatingPointError):
        mean_map(SOFT, impacts=2, closure=lambda scene, impacts: {"tau": np.exp(np.full(2, -1e4))})


def test_every_public_function_computes_under_the_defaults_of_numpy():
    functions = [
        named for name in rattle.__all__ if inspect.isfunction(named := getattr(rattle, name))
    ]
    assert [f.__name__ for f in functions if not hasattr(f, "__wrapped__")] == []
