"""Asked for accuracy: it is reached, or the answer says what is missing; the settings are found,
not given."""

import numpy as np
import pytest
from refusals import refusal
from scenes import SECTION, dat21

from rattle import Record, Sampling, Scene, Tolerance, simulate, simulate_to
from rattle.montecarlo import SCHEMES


@pytest.mark.parametrize(
    ("sigma", "accuracy", "scheme"),
    [(0.01, 2e-3, None), (0.5, 0.03, None), (0.5, 0.1, "euler-maruyama")],
)
def test_answer_lies_as_close_to_the_truth_as_asked(sigma, accuracy, scheme):
    run = simulate_to(dat21(sigma), accuracy, impacts=3, scheme=scheme, rng=5, workers=2)
    assert run.reach.reached
    assert run.reach.asked == accuracy
    assert run.reach.sampling <= accuracy
    control = Sampling(control=True)
    truth = simulate(dat21(sigma), paths=100_000, impacts=3, sampling=control, rng=77, workers=2)
    assert scheme in (None, run.scheme)
    names = ["tau", "flight", "y1", "y2"]
    sds = truth.section[["sd_" + name for name in names]].to_numpy()
    for prefix in ("", "sd_"):
        columns = [prefix + name for name in names]
        away = (run.section[columns] - truth.section[columns]).abs().to_numpy()
        # 24 errors, each with a standard error of at most the accuracy: none beyond 4 of them
        assert (away / sds).max() < 4.0 * accuracy


@pytest.mark.parametrize(("sigma", "control"), [(0.5, False), (0.05, True)])
def test_a_run_that_goes_on_is_the_run_that_began_with_all_its_paths(sigma, control):
    run = simulate_to(dat21(sigma), 0.02, impacts=3, scheme="exact-flight", rng=5)
    settings = {"paths": run.paths, "dt": run.dt, "sampling": Sampling(control=control), "rng": 5}
    assert run.section.equals(simulate(dat21(sigma), impacts=3, **settings).section)


def test_other_schemes_are_tried_only_where_exact_flights_take_long(monkeypatch):
    """The choice does not depend on the clock."""
    ask = {"scene": dat21(0.5), "impacts": 3, "accuracy": 0.05, "rng": 5}
    assert list(simulate_to(**ask).reach.schemes.index) == ["exact-flight"]
    monkeypatch.setattr("rattle.montecarlo.accuracy.pilots.CHEAP_SECONDS", 0.0)
    run = simulate_to(**ask)
    assert set(run.reach.schemes.index) == set(SCHEMES)
    assert run.scheme == run.reach.schemes["core_seconds"].idxmin()
    ticks = iter(np.arange(1e6) ** 1.1)
    monkeypatch.setattr("rattle.montecarlo.kernel.blocks.time.process_time", lambda: next(ticks))
    assert run.reach.schemes.equals(simulate_to(**ask).reach.schemes)


@pytest.mark.parametrize("scheme", ["euler-maruyama", "euler-maruyama-located"])
def test_a_path_without_noise_is_compared_with_the_exact_orbit(scheme):
    """Meshes are struck within a hair of each other; a step of 0.01 strikes the wrong one first, as
    do 2 and 4 dt."""
    rates = {"beta1": 0.0265, "gamma1": 0.1517, "beta2": 0.0173, "gamma2": 0.1973}
    scene = Scene(alpha=1.2179, epsilon=0.8944, mu=0.2996, **rates)
    exact = simulate(scene, paths=1, impacts=4)
    coarse = simulate(scene, paths=1, impacts=4, dt=0.01, scheme="euler-maruyama-located")
    assert (coarse.columns["mesh"] != exact.columns["mesh"]).any()
    assert coarse.columns["agreement"][-1] == 0.0
    run = simulate_to(scene, 0.01, impacts=4, scheme=scheme)
    assert run.reach.reached
    assert (run.columns["agreement"] == 1.0).all()
    off = max(np.abs(run.columns[q] - exact.columns[q]).max() for q in SECTION)
    assert off == pytest.approx(run.reach.bound, abs=1e-6)
    assert off <= 0.01


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"accuracy": 0.0}, r"accuracy = 0.0: must be greater than 0"),
        ({"record": Record(step_bias=True)}, r"record.step_bias = True: cannot be recorded"),
        ({"record": Record(times=[1.0])}, r"record.times = \[1.0\]: cannot be recorded"),
        ({"scheme": "exact"}, r"scheme = 'exact'"),
        ({"budget": -1.0}, r"budget = -1.0: must be greater than 0"),
    ],
)
def test_bad_input_is_refused_by_name(settings, message):
    with refusal(message):
        simulate_to(dat21(0.1), **({"accuracy": 0.1} | settings))


def test_an_accuracy_without_noise_is_one_path():
    scene = dat21(0.0, tolerance=Tolerance(0.02, 0.02, distribution="fixed"))
    record = Record(batches=True, energy=True)
    run = simulate_to(scene, 0.01, impacts=3, record=record)
    assert (run.paths, run.plan.paths, run.reach.expected.paths) == (1, 1, 1)
    assert (run.section[["se_" + q for q in SECTION]] == 0.0).all(axis=None)
    assert (run.batches.n.sum(axis=0) == 1).all()
    assert run.reach.reached
    assert run.reach.worst == "nothing varies: one path is the answer"


def test_a_drawn_backlash_without_noise_is_random():
    run = simulate_to(dat21(0.0, tolerance=Tolerance(0.02, 0.02)), 0.05, impacts=2)
    assert run.plan.paths == run.paths >= 32_768
    assert 0.0 < run.section.loc[2, "se_tau"] <= 0.05 * run.section.loc[2, "sd_tau"]
