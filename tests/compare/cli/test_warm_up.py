"""What is compiled, when, and what is said of it."""

import subprocess
import sys

import pytest
from click.testing import CliRunner

from rattle.closure import CLOSURES, mean_map
from rattle.compare.cli.check import tasks
from rattle.compare.cli.main import main
from rattle.montecarlo import SCHEMES, simulate, simulate_rare
from rattle.montecarlo.long_run import long_run
from rattle.scene import DAT21, Scene, Tolerance, compiled
from rattle.scene.compiled import jit


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


def test_a_function_that_is_not_in_the_cache_counts(monkeypatch):
    monkeypatch.setattr(compiled.NUMBAS_CACHE, "_load_overload", lambda *given: None)

    @jit
    def fresh(x):
        return x + 1.0

    before = compiled.count_compiled()
    fresh(1.0)
    fresh(2.0)
    assert compiled.count_compiled() == before + 1


@pytest.mark.parametrize("terminal", [True, False])
def test_compiling_is_announced_once_and_only_on_a_terminal(terminal, monkeypatch, capsys):
    monkeypatch.setattr(compiled, "_compiled", 0)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    compiled._count()
    compiled._count()
    assert capsys.readouterr().err.count("compiling for this processor") == (1 if terminal else 0)


def test_a_processor_without_avx2_is_told_once_that_it_is_slower(monkeypatch, capsys):
    monkeypatch.setattr(compiled.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(compiled.numba.config, "CPU_FEATURES", "+sse4.2,+popcnt")
    compiled._check_processor.cache_clear()
    compiled._warn()
    compiled._warn()
    assert capsys.readouterr().err.count("no AVX2") == 1
    monkeypatch.setattr(compiled.numba.config, "CPU_FEATURES", "+avx2,+fma")
    compiled._check_processor.cache_clear()
    compiled._warn()
    assert capsys.readouterr().err == ""


@pytest.mark.slow
def test_a_warm_process_does_not_describe_what_numba_can_compile():
    code = """
import sys
from rattle.montecarlo import simulate
from rattle.scene import DAT21, Scene
from rattle.scene.compiled import count_compiled
for _ in range(2):
    simulate(Scene.from_gears(DAT21, sigma=0.1), paths=8, impacts=2, scheme="exact-flight")
print(count_compiled(), "numba.typed.typeddict" in sys.modules)
"""
    command = [sys.executable, "-c", code]
    subprocess.run(command, check=True, capture_output=True)  # fills the cache
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert done.stdout.split() == ["0", "False"]


def test_warming_up_without_a_folder_says_what_to_do(monkeypatch):
    monkeypatch.setattr(compiled, "_folder", None)
    done = CliRunner().invoke(main, ["warm-up"])
    assert (done.exit_code, "NUMBA_CACHE_DIR" in done.output) == (2, True)


@pytest.mark.slow
def test_compiled_code_loads_no_blas_and_leaves_it_to_others():
    code = """
import sys, numba, numpy as np
from rattle.closure import mean_map
from rattle.scene import DAT21, Scene
mean_map(Scene.from_gears(DAT21, sigma=0.1), impacts=2, closure="saltation")
assert "scipy.linalg" not in sys.modules
assert numba.njit(lambda a: a @ a)(np.eye(2)).tolist() == np.eye(2).tolist()
assert "scipy.linalg" in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True)
