"""One source, one set of bits on every x86-64 with AVX2 and FMA: code for other processors runs
here, where it can."""

import json
import platform

import llvmlite.binding
import pytest
from places import ROOT
from programs import python

pytestmark = pytest.mark.slow

TIMED_CASES = "exact-flight, kernel alone", "corrected, driven"
"""No more than one sampler and one closure, for the process compiles all for itself."""
CASES_FILE = ROOT / "tests" / "interpreted" / "cases.py"
NEEDED = ("avx2", "fma", "bmi", "bmi2", "lzcnt", "popcnt", "f16c", "movbe")
NEWER = ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")
AS_ON_HASWELL = {
    "NUMBA_CPU_NAME": "haswell",
    "NUMBA_CPU_FEATURES": ",".join(f"+{name}" for name in NEEDED),
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    "OPENBLAS_CORETYPE": "Haswell",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=" + ",".join(f"-{name.upper()}" for name in NEWER),
}
"""Environment in which numba, numpy, the C library and OpenBLAS choose as on that processor."""


def numbers(**environment):
    """The numbers of cases of the tests of interpreted code, as another process makes them."""
    return json.loads(python(CASES_FILE, *TIMED_CASES, **environment).stdout)


def test_code_for_another_processor_gives_the_same_bits(tmp_path):
    here = llvmlite.binding.get_host_cpu_features()
    if platform.machine() != "x86_64" or not all(here.get(name) for name in NEEDED):
        pytest.skip("this processor cannot execute code for Haswell")
    assert numbers(NUMBA_CACHE_DIR=tmp_path, **AS_ON_HASWELL) == numbers()
