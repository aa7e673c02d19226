"""Functions optimised once, with all below them, beside a user's own functions of numba and under another numba."""

import math
import os
import subprocess
import sys

import numba
import numpy as np
import pytest
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.registry import cpu_target

from rattle.scene.compiled import SHARED, TESTED, jit
from rattle.scene.small_vectors import norm

V = np.array([0.1, 0.7, 1.3])
COMPILED = pytest.mark.skipif(bool(getattr(numba.config, "DISABLE_JIT", False)), reason="the compiler is off")


@numba.njit
def users(v):
    """A user's function of numba, which calls one of ours and numba's own."""
    return norm(v) + np.zeros(3)[1]


@numba.njit
def halved(i):
    """Another function of a user, which one of ours calls, and which raises."""
    if i < 0:
        raise ValueError("below zero", i)
    return i // 2


@jit
def below(i):
    """A function of ours that raises by way of a user's, with an argument that only numba's environment holds."""
    return halved(i) + 1


@jit
def counted(n):
    """A function of ours that calls itself and others."""
    return 0 if n == 0 else counted(n - 1) + below(2)


@numba.njit
def above(i):
    """A user's function above ours."""
    return below(i) + counted(i)


def libraries(function):
    """Classes of the libraries that a compiled function is in."""
    return {type(made.library) for made in function.overloads.values()}


@COMPILED
def test_the_tested_numba_is_the_one_in_use():
    """Where this fails, functions are compiled in numba's plain way: test the new version and state it."""
    assert numba.__version__.startswith(TESTED)
    assert SHARED is not None


@COMPILED
def test_a_users_function_calls_ours_and_is_compiled_as_ever():
    assert users(V) == norm(V) == pytest.approx(math.hypot(*V), rel=1e-15)
    assert libraries(users) == {JITCodeLibrary}
    assert type(cpu_target.target_context.codegen()) is JITCPUCodegen


@COMPILED
@pytest.mark.parametrize("function", [above, below])
def test_errors_pass_between_a_users_functions_and_ours(function):
    assert below(8) == 5
    assert above(3) == 2 + 3 * 2
    for _ in range(2):
        with pytest.raises(ValueError, match="below zero") as raised:
            function(-4)
        assert raised.value.args == ("below zero", -4)


CODE = (
    "import numpy as np, rattle.scene.compiled as c; from rattle.scene.small_vectors import norm as f;"
    "print(f(np.array([0.1, 0.7, 1.3])).hex(), c.SHARED is not None, sum(f.stats.cache_hits.values()))"
)
FAULTS = {
    "another version": "import numba; numba.__version__ = '0.99.0'; ",
    "a name is gone": "import numba.core.codegen as c, numba; from numba import njit; del c.JITCodeLibrary; ",
}


def computed(code, folder):
    """Bits of a product, and whether functions are optimised once, in a process of its own."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@COMPILED
@pytest.mark.parametrize("fault", FAULTS)
def test_another_numba_compiles_in_its_plain_way_to_the_same_bits(fault, tmp_path):
    expected = [norm(V).hex(), "False"]
    assert computed(FAULTS[fault] + CODE, tmp_path) == [*expected, "0"]
    assert computed(FAULTS[fault] + CODE, tmp_path) == [*expected, "1"]


@COMPILED
def test_two_processes_fill_one_cache(tmp_path):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    both = [
        subprocess.Popen([sys.executable, "-c", CODE], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        for _ in range(2)
    ]
    said = [process.communicate() for process in both]
    assert [process.returncode for process in both] == [0, 0], said
    for out, _ in said:  # the later one may have found the machine code of the earlier
        assert out.split()[:2] == [norm(V).hex().encode(), b"True"]
    assert computed(CODE, tmp_path) == [norm(V).hex(), "True", "1"]
