"""Errors in the code itself, not in a scene or in a truth, are rejected by the self-test of the
impacts.

As a program, one error at a time is put into the code, and what is rejected is printed.  With
NUMBA_DISABLE_JIT=1 a function is a plain one, and its code can be exchanged in place: every module
that has imported it runs the wrong one.
"""

import inspect
import json
import types

import pytest
from programs import python

from rattle import Gears
from rattle.compare.checks.check import run_checks
from rattle.compare.checks.published import RESULTS
from rattle.scene import impact, wheel

pytestmark = pytest.mark.published

STRIKE = impact.reflect
MUTATIONS = {
    "nothing": (STRIKE, "", ""),
    "share of the parent into that of the wheel": (
        STRIKE,
        "(1.0 - wheel.share) * change",
        "wheel.share * change",
    ),
    "1 + epsilon into epsilon, mesh 2": (
        STRIKE,
        "-(1.0 + epsilon) * rate",
        "-(epsilon + (mesh == 1)) * rate",
    ),
    "an impact does not kick the gaps behind": (STRIKE, "other.ratio * moved", "0.0"),
    "mesh 2 does not kick y1": (STRIKE, "other.sign * others", "0.0"),
    "no restitution at mesh 1": (
        STRIKE,
        "-epsilon * rate",
        "-(epsilon ** (mesh - 1)) * rate",
    ),
    "energy lost at mesh 2 without its mass": (impact.energy_loss, "reduced * y", "y"),
    "a share of mass without the parent's": (
        wheel.complete_wheels,
        "(carried + parent.mass)",
        "carried",
    ),
    "inertias interchanged in mu": (
        Gears.mu.fget,
        "first.inertia * second.radius",
        "second.inertia * second.radius",
    ),
}


def mutated(function, old, new):
    """The code of a function in whose source `new` stands for `old`."""
    source = inspect.cleandoc(inspect.getsource(function))
    assert old in source, (function, old)
    module = compile(source.replace(old, new), "mutated", "exec")
    return next(
        c
        for c in module.co_consts
        if isinstance(c, types.CodeType) and c.co_name == function.__name__
    )


def is_rejected(function, old, new):
    """Whether the self-test fails with this error in the code."""
    right = function.__code__
    function.__code__ = mutated(function, old, new)
    try:
        return not run_checks(RESULTS, ["impact-laws"], workers=1)[0].holds
    except Exception as error:  # a program that breaks down is noticed too
        return f"{type(error).__name__}: {error}"
    finally:
        function.__code__ = right


@pytest.fixture(scope="module")
def rejected():
    """Whether the self-test fails with each error in the code, which the interpreter runs."""
    return json.loads(python(__file__, NUMBA_DISABLE_JIT="1").stdout)


@pytest.mark.parametrize("error", MUTATIONS)
def test_an_error_in_the_code_is_rejected(error, rejected):
    assert rejected[error] is (error != "nothing")


if __name__ == "__main__":
    print(json.dumps({name: is_rejected(*mutation) for name, mutation in MUTATIONS.items()}))
