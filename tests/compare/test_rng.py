"""What `rng` may be: a seed, a SeedSequence or a generator of numpy, in every public function that
draws numbers."""

import inspect

import numpy as np
import pytest
from refusals import refusal
from scenes import dat21

import rattle
from rattle import simulate, validate

SEEDED = dat21(0.01)


def moments(rng):
    return simulate(SEEDED, paths=100, impacts=2, rng=rng).section["tau"].tolist()


def test_a_generator_gives_the_same_results_where_it_is_as_new_and_others_when_passed_again():
    generator, drawn = (np.random.default_rng(7) for _ in range(2))
    drawn.normal(size=10)  # what was drawn from it decides nothing
    first = moments(generator)
    (child,) = np.random.SeedSequence(7).spawn(1)
    assert moments(drawn) == moments(np.random.PCG64(7)) == moments(child) == first
    assert moments(generator) != first
    assert generator.integers(2**63) == np.random.default_rng(7).integers(2**63)  # none is drawn
    sequence = np.random.SeedSequence(7)
    assert moments(sequence) == moments(sequence) == moments(7)


@pytest.mark.parametrize("rng", [np.random.RandomState(7), -1, 0.5])
def test_anything_else_is_refused(rng):
    with refusal("rng = "):
        moments(rng)


def test_every_function_with_rng_takes_a_generator():
    """By its annotation; and by a call of one."""
    functions = filter(inspect.isfunction, (getattr(rattle, name) for name in rattle.__all__))
    annotations = {
        str(parameters["rng"].annotation).rpartition(".")[2]
        for function in functions
        if "rng" in (parameters := inspect.signature(function).parameters)
    }
    assert annotations == {"BitGenerator", "Rng"}
    one, two = (
        validate(
            SEEDED, rng=np.random.default_rng(7), impacts=1, closures=["saltation"], paths=1000
        )
        for _ in range(2)
    )
    assert one.table.equals(two.table)
