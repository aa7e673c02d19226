"""Marks of tests that need what is not always there."""

import numba
import pytest

COMPILED = pytest.mark.skipif(
    bool(getattr(numba.config, "DISABLE_JIT", False)), reason="the compiler is off"
)
