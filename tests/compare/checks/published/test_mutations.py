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

from rattle.compare.checks.check import run_checks
from rattle.compare.checks.published import RESULTS
from rattle.scene import Gears, impact

pytestmark = pytest.mark.published

STRUCK = impact.struck
LOSS = impact.energy_loss
MU = Gears.mu.fget
MUTATIONS = {
    "nothing": (STRUCK, "", ""),
    "mu into 1 - mu": (STRUCK, "(1.0 + c.epsilon) * c.mu", "(1.0 + c.epsilon) * (1.0 - c.mu)"),
    "1 + epsilon into epsilon, mesh 2": (STRUCK, "(1.0 + c.epsilon) * c.mu", "c.epsilon * c.mu"),
    "mesh 1 does not kick y2": (STRUCK, "y2 - (1.0 + c.epsilon) * y1", "y2"),
    "mesh 2 does not kick y1": (STRUCK, "y1 - (1.0 + c.epsilon) * c.mu * y2", "y1"),
    "restitution of mesh 2 squared": (STRUCK, "-c.epsilon * y2", "-(c.epsilon**2) * y2"),
    "no restitution at mesh 1": (STRUCK, "return -c.epsilon * y1", "return -y1"),
    "energy lost at mesh 2 without its mass": (LOSS, "c.mu", "1.0"),
    "inertias interchanged in mu": (MU, "self.inertia2", "self.inertia1"),
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
