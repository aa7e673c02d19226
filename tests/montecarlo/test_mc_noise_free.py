"""Where nothing is random one path is the answer, to any accuracy; where a backlash is drawn, it is not."""

import numpy as np
import pytest
from mc_checks import dat21

from rattle.montecarlo import SCHEMES, Record, simulate, simulate_to
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.settings import Sampling
from rattle.scene import Tolerance
from rattle.scene.types import SECTION

STILL = {"no noise": dat21(0.0), "fixed backlash": dat21(0.0, tolerance=Tolerance(0.02, 0.02, distribution="fixed"))}


@pytest.mark.parametrize("name", STILL)
@pytest.mark.parametrize("scheme", [None, *SCHEMES])
def test_an_accuracy_without_noise_is_one_path(name, scheme):
    run = simulate_to(STILL[name], 0.01, impacts=3, scheme=scheme, record=Record(batches=True, energy=True))
    assert (run.paths, run.plan.paths) == (1, 1)
    assert (run.section["paths"] == 1).all()
    assert (run.section["agreement"] == 1.0).all()
    assert (run.section[["se_" + q for q in SECTION]] == 0.0).all(axis=None)
    assert run.batches.n.sum() == 3 * 6
    assert run.reach.reached
    assert run.reach.expected.paths == 1
    assert run.reach.worst == "nothing varies: one path is the answer"


@pytest.mark.parametrize("scheme", [name for name, kind in SCHEMES.items() if kind.has_step_bias])
def test_the_step_is_shortened_until_its_bias_is_within_the_accuracy(scheme):
    truth = simulate(dat21(0.0), paths=1, impacts=4, scheme="exact-flight").section[list(SECTION)]
    steps = []
    for accuracy in (0.05, 1e-3, 2e-5):
        run = simulate_to(dat21(0.0), accuracy, impacts=4, scheme=scheme)
        assert (run.section[list(SECTION)] - truth).abs().max(axis=None) < accuracy
        assert run.reach.step <= accuracy
        steps.append(run.dt)
    assert steps == sorted(steps, reverse=True)
    assert steps[-1] < 1e-3 * steps[0]


@pytest.mark.parametrize("distribution", ["uniform", "normal"])
def test_a_drawn_backlash_without_noise_is_random(distribution):
    scene = dat21(0.0, tolerance=Tolerance(0.02, 0.02, distribution=distribution))
    run = simulate_to(scene, 0.05, impacts=2)
    assert run.paths >= 32 * BLOCK
    assert run.plan.paths == run.paths
    assert (run.section["paths"] == run.paths).all()
    assert run.section["agreement"].between(0.0, 1.0).all()
    assert 0.0 < run.section.loc[2, "se_tau"] <= 0.05 * run.section.loc[2, "sd_tau"]
    whole = simulate(scene, paths=run.paths, dt=run.dt, impacts=2, scheme=run.scheme, sampling=Sampling(control=True))
    np.testing.assert_array_equal(whole.section, run.section)
