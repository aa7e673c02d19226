"""``device="cuda"``: on a simulated GPU the paths and sums of the processor; without a GPU, a helpful error."""

import inspect
import json
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from mc_checks import dat21

from rattle.montecarlo import settings, simulate
from rattle.montecarlo.cuda import bench
from rattle.montecarlo.cuda import launch as gpu
from rattle.montecarlo.settings import Sampling
from rattle.scene import InputError

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent

needs_package = pytest.mark.skipif(find_spec("numba_cuda") is None, reason="the package numba-cuda is not installed")


needs_compiler = pytest.mark.skipif(
    any(find_spec(name) is None for name in ("numba_cuda", "nvidia")) or find_spec("nvidia.cuda_nvcc") is None,
    reason="CUDA's compiler (extra gpu) is not installed",
)


def python(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join((str(ROOT), str(HERE)))
    return subprocess.run(
        [sys.executable, *arguments], env=os.environ | {"PYTHONPATH": path} | variables, cwd=ROOT, text=True,
        capture_output=True, check=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def simulated() -> dict:
    done = python("-W", "error::RuntimeWarning", str(HERE / "simulated_gpu.py"))
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout)


@pytest.mark.slow
@needs_package
def test_a_gpu_follows_the_same_paths_and_takes_the_same_sums(simulated):
    assert len(simulated["cases"]) == 15
    for case, found in simulated["cases"].items():
        assert found["work"][0] == found["work"][1], case
        for name in ("rows", "covariance", "fixed", "agreement", "histograms"):
            assert found[name] < 1e-9, (case, name)
        assert found["section"] < 1e-8  # the error of the kurtosis of two values is the square root of rounding
    assert 0 < simulated["cases"]["plain, some unfinished"]["work"][1][2] < 10
    assert simulated["speed"] > 0.0


@pytest.mark.slow
@needs_package
def test_another_key_would_be_seen(simulated):
    found = simulated["another key"]
    assert found["rows"] > 1e-3
    assert found["section"] > 1e-3


@needs_package
def test_a_gpu_has_the_attributes_that_are_asked_of_it():
    from cuda.bindings.driver import CUdevice_attribute

    asked = re.findall(r"device\.([A-Z_]+)", inspect.getsource(gpu) + inspect.getsource(bench))
    assert len(asked) >= 3
    for name in asked:
        assert hasattr(CUdevice_attribute, f"CU_DEVICE_ATTRIBUTE_{name}"), name


@needs_compiler
def test_all_kernels_compile_for_a_gpu():
    done = python(str(HERE / "compiled_gpu.py"), NUMBA_ENABLE_CUDASIM="0")
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout.split() == ["sm_90"] * 6


def test_nothing_of_cuda_is_imported_before_a_gpu_is_asked_for():
    done = python("-c", "import sys, montecarlo, compare; print(*sys.modules, sep='\\n')")
    assert done.returncode == 0, done.stderr
    loaded = done.stdout.split()
    assert "numba" in loaded
    assert not [name for name in loaded if name.startswith(("numba.cuda", "rattle.montecarlo.cuda.launch"))]


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setattr(settings, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"device = 'cuda': needs the package numba-cuda.*rattle\[gpu\]"):
        simulate(dat21(0.1), paths=10, sampling=Sampling(device="cuda"))


@needs_package
def test_a_missing_gpu_is_named():
    done = python("-m", "rattle.montecarlo.cuda.bench", CUDA_VISIBLE_DEVICES="-1", NUMBA_ENABLE_CUDASIM="0")
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.startswith("sampling.device = 'cuda': needs")
    assert "Traceback" not in done.stderr
