"""What the compiler makes of the source is what the source says: both are run, and give the same
numbers."""

import json
import math
from pathlib import Path

import numba
import numpy as np
import pytest
from cases import CASES, USEFUL_STEP, parts
from programs import python

INTERPRETED_ROUNDING = {"rtol": 5e-13, "atol": 5e-13}
"""Where sums may be taken in another order; found: 2e-14 at most."""


def same(one, other, exact=False):
    """Whether two lists hold the same numbers: to the last bit, or to rounding."""
    close = {"rtol": 0.0, "atol": 0.0} if exact else INTERPRETED_ROUNDING
    return len(one) == len(other) and np.allclose(one, other, equal_nan=True, **close)


@pytest.fixture(scope="module")
def other():
    """The numbers of every case as a process makes them whose compiler is off, or on where it is
    off here."""
    off = "0" if numba.config.DISABLE_JIT else "1"
    read = json.loads(python(Path(__file__).with_name("cases.py"), NUMBA_DISABLE_JIT=off).stdout)
    return {
        case: [[float.fromhex(x) for x in part] for part in found] for case, found in read.items()
    }


@pytest.mark.parametrize("case", CASES)
def test_the_interpreter_gives_what_the_compiler_gives(case, other):
    """Every impact of every path of every scheme to the last bit, all else to rounding."""
    found = parts(case)
    finite = np.isfinite(np.concatenate(found))
    assert finite.size > 20
    assert finite.mean() > 0.3
    for number, (here, there) in enumerate(zip(found, other[case], strict=True)):
        assert same(here, there, exact=number == 0 and case.startswith(tuple(USEFUL_STEP)))


def test_another_last_bit_is_seen():
    wrong = [math.nextafter(1.0, 9.0)]
    assert same([1.0], wrong)
    assert not same([1.0], wrong, exact=True)
    assert not same([1.0], [1.0 + 1e-11])
    assert not same([1.0], [math.nan])
