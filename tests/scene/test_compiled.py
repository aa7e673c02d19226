"""Functions compiled here beside a user's own functions of numba."""

import threading
from contextlib import nullcontext
from pathlib import Path

import numba
import numpy as np
import pytest
from needs import COMPILED
from scenes import dat21

from rattle import Scene, simulate
from rattle.montecarlo import SCHEMES
from rattle.montecarlo.kernel.kernel import block_kernel, kernel_of
from rattle.montecarlo.long_run.walk import Walk
from rattle.montecarlo.schemes.exact_flight import EXACT
from rattle.scene import compiled
from rattle.scene.compiled import as_argument, jit, lean, vector_memory
from rattle.scene.flight import flow


@numba.njit
def users(c):
    """A user's function of numba, which calls one of ours and numba's own."""
    return flow(c, 0.0, np.array([0.1, 0.2]), 0.0)[0] + np.zeros(3)[1]


@numba.njit
def halved(i):
    """Another function of a user, which one of ours calls, and which raises."""
    if i < 0:
        raise ValueError("below zero", i)
    return i // 2


@jit
def below(i):
    """A function of ours that raises by way of a user's, with an argument that only numba's
    environment holds."""
    return halved(i) + 1


@jit
def counted(n):
    """A function of ours that calls itself and others."""
    return 0 if n == 0 else counted(n - 1) + below(2)


@numba.njit
def above(i):
    """A user's function above ours."""
    return below(i) + counted(i)


@COMPILED
def test_a_users_function_calls_ours():
    assert users(Scene(alpha=0.5, epsilon=0.3, beta1=0.0, gamma1=1.0, stages=1).constants) == 0.1


@COMPILED
@pytest.mark.parametrize("function", [above, below])
def test_errors_pass_between_a_users_functions_and_ours(function):
    assert below(8) == 5
    assert above(3) == 2 + 3 * 2
    for _ in range(2):
        with pytest.raises(ValueError, match="below zero") as raised:
            function(-4)
        assert raised.value.args == ("below zero", -4)


@COMPILED
@pytest.mark.parametrize("locked", [True, False])
def test_threads_that_decorate_at_once_keep_in_the_folder(monkeypatch, locked):
    """Not where the process runs; and a user's own functions are kept where they were.  Without the
    lock one of both goes wrong."""
    kept = compiled.Kept
    inside = threading.Event()
    finished = threading.Event()
    made = []
    other = threading.Thread(target=lambda: made.append(jit(lambda x: x + 2.0)))

    def keep_late(function):
        if threading.current_thread() is other:
            inside.set()
            finished.wait()
        else:
            other.start()
            inside.wait(0.1 if locked else None)  # with the lock it does not come in
        return kept(function)

    monkeypatch.setattr(compiled, "Kept", keep_late)
    monkeypatch.setattr(compiled.CONFIG, "CACHE_DIR", "")
    if not locked:
        monkeypatch.setattr(compiled, "_choosing", nullcontext())
    made.append(jit(lambda x: x + 1.0))
    finished.set()
    other.join()
    places = {Path(function._cache.cache_path).parent for function in made}
    right = places == {compiled.folder()} and compiled.CONFIG.CACHE_DIR == ""
    assert right == locked


def test_kernels_have_names_of_their_own():
    """Machine code of one name and types, compiled first in two processes, is one for the linker:
    exact flights were Euler's steps then."""
    kernels = [block_kernel(scheme, n) for scheme in SCHEMES.values() for n in (0, 1, 2)]
    names = {getattr(kernel, "py_func", kernel).__qualname__ for kernel in kernels}
    assert len(names) == len(kernels)


@jit
def applied(run, x):
    """A function of ours that takes another one as an argument."""
    return run(x, 1) + 1.0


@COMPILED
def test_functions_are_called_by_their_address():
    double = lean(lambda x, power: x * 2.0**power, by_address=True)
    assert applied(as_argument(double, 1.0, 1), 3.0) == 7.0
    assert len(double.signatures) == 1


@COMPILED
def test_a_long_run_takes_the_kernel_that_simulate_compiles(monkeypatch):
    taken = []

    def take(function, *arguments):
        taken.append(function)
        return as_argument(function, *arguments)

    monkeypatch.setattr("rattle.montecarlo.long_run.walk.as_argument", take)
    scene = dat21(0.1)
    simulate(scene, paths=8, impacts=1, rng=1)
    kernel = kernel_of(scene.constants, EXACT)
    known = list(kernel.signatures)
    Walk(scene, np.random.SeedSequence(1), 0, 2)
    assert taken == [kernel]
    assert kernel.signatures == known


def test_memory_for_vectors_begins_at_a_line_of_the_cache():
    for shape in [(), (3,), (5, 8), (2, 0, 4), (3, 1, 4, 1280)]:
        held = [vector_memory(shape, 0.5) for _ in range(20)]
        assert {array.ctypes.data % 64 for array in held} == {0}
        np.testing.assert_array_equal(held[0], np.full(shape, 0.5), strict=True)
