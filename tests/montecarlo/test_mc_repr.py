"""A repr shows what is there: no path is followed, no branch searched and no closure evaluated for it."""

import pytest

import rattle
from rattle.montecarlo.branches import search as branches
from rattle.montecarlo.diagnostics import accuracy, diagnostics
from rattle.montecarlo.kernel import block
from rattle.montecarlo.settings import Sampling

SCENE = rattle.Scene.from_gears(rattle.DAT21, sigma=0.1)
STEPPED = {"scheme": "euler-maruyama-located", "dt": 0.01, "record": rattle.Record(step_bias=False)}
MADE = {
    "Ensemble": lambda: rattle.simulate(SCENE, paths=64, impacts=2, **STEPPED),
    "Ensemble with step bias": lambda: rattle.simulate(SCENE, paths=64, impacts=2, scheme="euler-maruyama"),
    "Ensemble to an accuracy": lambda: rattle.simulate_to(SCENE.with_sigma(0.01), 0.1, impacts=1),
    "Reach": lambda: rattle.simulate_to(SCENE.with_sigma(0.01), 0.1, impacts=1).reach,
    "Validation": lambda: rattle.validate(SCENE, paths=64, impacts=2),
    "MeanMap": lambda: rattle.mean_map(SCENE, impacts=2, closure="branching", tolerance=0.1),
    "Stationary": lambda: rattle.stationary(SCENE.with_sigma(0.5), periods=64, paths=16),
}


def forbid(monkeypatch):
    """Let whatever follows paths, searches branches or evaluates a closure end the test."""

    def fail(*_, **__):
        pytest.fail("a repr computes")

    for owner, name in ((block, "sample"), (block, "run"), (diagnostics, "noise_free_path"), (accuracy, "unseen")):
        monkeypatch.setattr(owner, name, fail)
    monkeypatch.setattr(branches.BranchSearch, "until", fail)
    monkeypatch.setattr(type(rattle.CLOSURES["saltation"]), "trace", fail)


@pytest.mark.parametrize("kind", MADE)
def test_a_repr_computes_nothing(kind, monkeypatch):
    shown = MADE[kind]()
    forbid(monkeypatch)
    assert kind.split()[0] in repr(shown)
    if kind != "Reach":
        assert "<table" in shown._repr_html_()


def test_diagnostics_do_compute(monkeypatch):
    """The negative control: what is forbidden above is what the diagnostics need."""
    run = MADE["Ensemble"]()
    forbid(monkeypatch)
    with pytest.raises(pytest.fail.Exception, match="a repr computes"):
        run.diagnostics  # noqa: B018


def test_a_repr_says_what_was_counted():
    run = rattle.simulate(SCENE, paths=64, impacts=3, sampling=Sampling(horizon=0.6))
    assert any("did not finish before the time limit" in line for line in repr(run).splitlines())
