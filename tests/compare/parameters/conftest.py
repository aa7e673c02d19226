"""Results that the tests of this folder share."""

from functools import partial

import pytest
from searches import run

from rattle import Scene, sensitivity


@pytest.fixture(scope="session")
def folder_of_map(tmp_path_factory):
    return tmp_path_factory.mktemp("map")


@pytest.fixture(scope="session")
def results(folder_of_map):
    """By the name of the search, each done when it is first asked for; `balance` is an effect in
    the long run."""
    # Noise alone drives this stage: in the long run all that it supplies,
    # sigma^2 (1 + beta1^2) / 4, is lost in impacts.
    alone = Scene(alpha=0.0, epsilon=0.5, beta1=0.0, gamma1=0.0, sigma=1.0, stages=1)
    asked = {
        "boundary": partial(run, "boundary"),
        "crossing": partial(run, "crossing"),
        "map": partial(run, "map", folder=folder_of_map),
        "balance": partial(sensitivity, alone, quantities=["power"], accuracy=0.004, rng=3),
    }

    class Results(dict):
        def __missing__(self, name):
            self[name] = asked[name]()
            return self[name]

    return Results()
