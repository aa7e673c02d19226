"""What `rng` may be: a seed, a SeedSequence or a generator of numpy, in every public function that
draws numbers."""

import inspect

import numpy as np
import pytest

import rattle
from rattle import DAT21, InputError, Scene, boundary, simulate, simulate_rare, validate
from rattle.compare import closure_sensitivity
from rattle.montecarlo.seed import Rng, read_seed, read_whole_seed

SCENE = Scene.from_gears(DAT21, sigma=0.01)


def moments(rng):
    return simulate(SCENE, paths=100, impacts=2, rng=rng).section[["tau", "y1"]].to_numpy().tolist()


def test_a_generator_gives_the_same_results_where_it_is_as_new():
    generator = np.random.default_rng(7)
    other = np.random.default_rng(7)
    first = moments(generator)
    other.normal(size=10)  # what was drawn from it decides nothing
    assert moments(other) == first
    assert moments(np.random.PCG64(7)) == first
    assert moments(np.random.SeedSequence(7).spawn(1)[0]) == first


def test_a_generator_passed_twice_gives_other_results_and_a_seed_the_same():
    generator = np.random.default_rng(7)
    sequence = np.random.SeedSequence(7)
    assert moments(generator) != moments(generator)
    assert moments(sequence) == moments(sequence) == moments(7)


def test_nothing_is_drawn_from_a_generator():
    generator = np.random.default_rng(7)
    moments(generator)
    assert generator.integers(2**63) == np.random.default_rng(7).integers(2**63)


@pytest.mark.parametrize("rng", [np.random.RandomState(7), -1, 0.5, "7", None])
def test_anything_else_is_refused(rng):
    for read in (read_seed, read_whole_seed, moments):
        with pytest.raises(InputError, match="rng = "):
            read(rng)


def test_every_function_with_rng_takes_a_generator():
    """By its annotation; and by a call of some of each kind."""
    annotated = {
        name: parameters["rng"].annotation
        for name in rattle.__all__
        if callable(named := getattr(rattle, name))
        and not isinstance(named, type)
        and "rng" in (parameters := inspect.signature(named).parameters)
    }
    assert len(annotated) >= 9
    assert {name for name, kind in annotated.items() if kind not in (Rng, "Rng")} == set()
    rng = np.random.default_rng
    v = [
        validate(SCENE, impacts=1, closures=["saltation"], paths=1000, rng=rng(7)).table
        for _ in range(2)
    ]
    assert v[0].equals(v[1])
    simulate_rare(SCENE, paths=1024, impacts=1, rng=rng(7))
    closure_sensitivity(SCENE, parameters=["amplitude"], impacts=1, paths=1024, rng=rng(7))
    some = {"between": (0.01, 0.02), "impacts": 1, "points": 2}
    found = [boundary(SCENE, rng=rng(7), **some).points for _ in range(2)]
    assert found[0].equals(found[1])
