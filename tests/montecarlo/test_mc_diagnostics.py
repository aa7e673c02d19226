"""What a run says by itself of its numbers."""

import math
import re
from dataclasses import replace

import pytest
from mc_checks import stepped
from scenes import dat21
from settings import EULER, EXACT, LOCATED

import rattle
from rattle import Record, Sampling, simulate
from rattle.closure import CLOSURES


def run(sigma=0.1, **settings):
    return stepped(dat21(sigma), **({"paths": 1000, "impacts": 4, "rng": 3} | settings))


def test_run_without_a_fault_says_nothing():
    assert run(sigma=0.5).diagnostics == ()
    assert run(sigma=0.02, scheme=EXACT).diagnostics == ()


def test_a_rare_branch_that_was_not_sampled_is_named():
    """About 520 in a million paths strike mesh 2 first; twenty thousand paths see them."""
    (said,) = run(scheme=EXACT).diagnostics
    assert said.startswith("A rare branch (about 5")
    assert said.endswith("20,000 paths would settle it (sd of y2 at impact 3).")
    assert run(scheme=EXACT, paths=20_000).diagnostics == ()


def test_step_that_moves_the_orbit_is_diagnosed_in_sds_of_the_run():
    shifts = []
    for dt in (0.02, 0.01):
        (said,) = re.findall(r"by ([\d.]+) sd \(", " ".join(run(dt=dt).diagnostics))
        shifts.append(float(said))
    assert shifts[0] == pytest.approx(2.0 * shifts[1], rel=0.3)


def test_measured_bias_of_the_step_is_said_where_it_matters():
    given = {"paths": 4096, "rng": 3, "scheme": LOCATED}
    said, *_ = simulate(dat21(0.003), impacts=4, dt=0.004, **given).diagnostics
    assert said.startswith("The step biases the mean of ")
    assert not simulate(dat21(0.5), impacts=2, dt=0.001, **given).diagnostics


def test_strong_noise_is_diagnosed_where_the_step_cannot_follow_it():
    said, *_ = run(sigma=30.0, scheme=LOCATED).diagnostics
    limit = 0.05 * (1.8 / (30.0 * math.hypot(1.0, dat21().beta1))) ** 2
    assert said.endswith(f"; dt = {limit:.2g} would do.")


def test_sticking_after_the_last_impact_is_no_fault_of_the_section():
    scene = replace(dat21(1.0), epsilon=0.05)
    settings = {"paths": 64, "impacts": 2, "scheme": EXACT, "sampling": Sampling(horizon=3.0)}
    quick = simulate(scene, **settings)
    timed = simulate(scene, **settings, record=Record(times=[2.0]))
    assert quick.diagnostics[0].startswith("Noise at a restitution below 0.163")
    assert not any("stayed closed" in said for said in quick.diagnostics)
    assert timed.sticking_steps > 0
    assert any("a mesh stayed closed" in said for said in timed.diagnostics)


DIAGNOSED = dat21(0.1)
MADE = {
    "Ensemble": lambda: rattle.simulate(DIAGNOSED, paths=64, impacts=2, scheme=EULER),
    "Validation": lambda: rattle.validate(DIAGNOSED, paths=64, impacts=2),
    "MeanMap": lambda: rattle.mean_map(DIAGNOSED, impacts=2, closure="branching", tolerance=0.1),
    "Stationary": lambda: rattle.stationary(DIAGNOSED.with_sigma(0.5), periods=64, paths=16),
}


def forbid(monkeypatch):
    """Let whatever follows paths, searches branches or evaluates a closure end the test."""

    def fail(*_, **__):
        pytest.fail("a repr computes")

    for name in (
        "kernel.block.sample",
        "kernel.block.run",
        "diagnostics.diagnostics.noise_free_path",
        "diagnostics.accuracy.unseen",
        "branches.search.BranchSearch.until",
    ):
        monkeypatch.setattr(f"rattle.montecarlo.{name}", fail)
    monkeypatch.setattr(type(CLOSURES["saltation"]), "trace", fail)


@pytest.mark.parametrize("kind", MADE)
def test_a_repr_computes_nothing(kind, monkeypatch):
    """The negative control: what is forbidden is what the diagnostics need."""
    shown = MADE[kind]()
    forbid(monkeypatch)
    assert kind in repr(shown)
    assert "<table" in shown._repr_html_()
    if kind == "Ensemble":
        with pytest.raises(pytest.fail.Exception, match="a repr computes"):
            _ = shown.diagnostics


def test_a_repr_says_what_was_counted():
    run = rattle.simulate(DIAGNOSED, paths=64, impacts=3, sampling=Sampling(horizon=0.6))
    assert any("did not finish before the time limit" in line for line in repr(run).splitlines())
