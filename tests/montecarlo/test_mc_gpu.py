"""``device="cuda"``: on a simulated GPU the paths and sums of the processor; without a GPU, a helpful error."""

import inspect
import json
import re
from importlib.util import find_spec
from pathlib import Path

import pytest
from mc_checks import dat21
from programs import python

from rattle.montecarlo import settings, simulate
from rattle.montecarlo.cuda import bench
from rattle.montecarlo.cuda import launch as gpu
from rattle.montecarlo.settings import Sampling
from rattle.scene import InputError

HERE = Path(__file__).resolve().parent

needs_package = pytest.mark.skipif(find_spec("numba_cuda") is None, reason="the package numba-cuda is not installed")


needs_compiler = pytest.mark.skipif(
    any(find_spec(name) is None for name in ("numba_cuda", "nvidia")) or find_spec("nvidia.cuda_nvcc") is None,
    reason="CUDA's compiler (extra gpu) is not installed",
)


@pytest.fixture(scope="module")
def simulated() -> dict:
    return json.loads(python("-W", "error::RuntimeWarning", HERE / "simulated_gpu.py").stdout)


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
    assert python(HERE / "compiled_gpu.py", NUMBA_ENABLE_CUDASIM="0").stdout.split() == ["sm_90"] * 6


def test_nothing_of_cuda_is_imported_before_a_gpu_is_asked_for():
    loaded = python("-c", "import sys, montecarlo, compare; print(*sys.modules, sep='\\n')").stdout.split()
    assert "numba" in loaded
    assert not [name for name in loaded if name.startswith(("numba.cuda", "rattle.montecarlo.cuda.launch"))]


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setattr(settings, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"device = 'cuda': needs the package numba-cuda.*rattle\[gpu\]"):
        simulate(dat21(0.1), paths=10, sampling=Sampling(device="cuda"))


@needs_package
def test_a_missing_gpu_is_named():
    environment = {"CUDA_VISIBLE_DEVICES": "-1", "NUMBA_ENABLE_CUDASIM": "0"}
    done = python("-m", "rattle.montecarlo.cuda.bench", code=1, **environment)
    assert done.stdout == ""
    assert done.stderr.startswith("sampling.device = 'cuda': needs")
    assert "Traceback" not in done.stderr
