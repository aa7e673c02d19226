"""One source, one set of bits on every x86-64 with AVX2 and FMA: code for other processors runs
here, where it can."""

import json
import platform
from pathlib import Path

import llvmlite.binding
import pytest
from programs import python

pytestmark = pytest.mark.slow

CASE = "euler-maruyama, driven"
CASES = Path(__file__).parents[1] / "interpreted" / "cases.py"
LEVEL_3 = ("avx2", "fma", "bmi", "bmi2", "lzcnt", "popcnt", "f16c", "movbe")
LEVEL_4 = ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")
PROCESSORS = {
    "haswell": (LEVEL_3, "Haswell"),
    "skylake-avx512": (LEVEL_3 + LEVEL_4, "SkylakeX"),
}
"""Name of a processor: the instructions that code for it may use, and OpenBLAS's name of it."""


def has(features):
    """Whether this processor can execute such instructions."""
    here = llvmlite.binding.get_host_cpu_features()
    return platform.machine() == "x86_64" and all(here.get(feature) for feature in features)


def as_on(processor):
    """Environment in which numba, numpy, the C library and OpenBLAS choose as they would on a
    processor."""
    features, core = PROCESSORS[processor]
    newer = (
        ["AVX512_ICL", "AVX512_SPR"]
        if "avx512f" in features
        else ["X86_V4", "AVX512_ICL", "AVX512_SPR"]
    )
    without = [] if "avx512f" in features else [f"-{name.upper()}" for name in LEVEL_4]
    return {
        "NUMBA_CPU_NAME": processor,
        "NUMBA_CPU_FEATURES": ",".join(f"+{name}" for name in features),
        "NPY_DISABLE_CPU_FEATURES": " ".join(newer),
        "OPENBLAS_CORETYPE": core,
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=" + ",".join(without),
    }


def numbers_of(case, **environment):
    """The numbers of a case of the tests of interpreted code, as another process makes them."""
    return json.loads(python(CASES, case, **environment).stdout)


@pytest.fixture(scope="module")
def here():
    return numbers_of(CASE)


@pytest.mark.parametrize("processor", PROCESSORS)
def test_code_for_another_processor_gives_the_same_bits(processor, here, tmp_path):
    """No more than one sampler, for each process compiles all for itself."""
    if processor == llvmlite.binding.get_host_cpu_name() or not has(PROCESSORS[processor][0]):
        pytest.skip(f"this processor is {processor}, or cannot execute code for it")
    environment = {"NUMBA_CACHE_DIR": str(tmp_path)} | as_on(processor)
    assert numbers_of(CASE, **environment) == here
