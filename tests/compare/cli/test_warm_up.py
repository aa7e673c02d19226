"""What is compiled, when, and what is said of it."""

import sys

import pytest
from commands import rattle

from rattle.closure import CLOSURES, mean_map
from rattle.compare.cli.check import tasks
from rattle.montecarlo import SCHEMES, simulate, simulate_rare
from rattle.montecarlo.long_run import long_run
from rattle.scene import DAT21, Scene, Tolerance, compiled


def test_after_warming_up_nothing_is_compiled():
    found = tasks()
    assert {f"closure {name}" for name in CLOSURES} | {f"scheme {name}" for name in SCHEMES} < set(found)
    for task in found.values():
        task()
    before = compiled.count_compiled()
    for scene in (
        Scene.from_gears(DAT21, sigma=0.3),
        Scene.from_gears(DAT21, sigma=0.3, stages=1),
        Scene.from_gears(DAT21, sigma=0.02, tolerance=Tolerance(1e-3, 2e-3)),
    ):
        for name in CLOSURES:
            mean_map(scene, impacts=3, closure=name)
        for name in SCHEMES:
            assert simulate(scene, paths=40, impacts=3, scheme=name).diagnostics is not None
        long_run(scene, paths=16, periods=64)
    simulate_rare(Scene.from_gears(DAT21, sigma=0.1), paths=32_768, impacts=3)
    assert compiled.count_compiled() == before


@pytest.mark.parametrize("terminal", [True, False])
def test_compiling_is_announced_once_and_only_on_a_terminal(terminal, monkeypatch, capsys):
    monkeypatch.setattr(compiled, "_compiled", 0)
    monkeypatch.setattr(compiled, "_warnings", [])
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    compiled._count()
    compiled._count()
    assert capsys.readouterr().err.count("compiling for this processor") == (1 if terminal else 0)


def test_warming_up_without_a_folder_says_what_to_do(monkeypatch):
    monkeypatch.setattr(compiled, "_folder", None)
    assert "NUMBA_CACHE_DIR" in rattle("warm-up", code=2).output
