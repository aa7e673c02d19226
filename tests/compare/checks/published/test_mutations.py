"""Errors in the code itself, not in a scene or in a truth, are rejected by the self-test of the impacts."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from mutations import MUTATIONS

pytestmark = pytest.mark.published


@pytest.fixture(scope="module")
def rejected():
    """Whether the self-test fails with each error in the code, which the interpreter runs."""
    program = [sys.executable, str(Path(__file__).with_name("mutations.py"))]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    return json.loads(subprocess.run(program, env=environment, capture_output=True, text=True, check=True).stdout)


@pytest.mark.parametrize("error", MUTATIONS)
def test_an_error_in_the_code_is_rejected(error, rejected):
    assert rejected[error] is (error != "nothing")
