"""What the tests of several folders share."""

import pytest
from commands import rattle


@pytest.fixture(scope="session")
def small_report(tmp_path_factory):
    """A small report of ``rattle validate``, with its figures, and what the command printed."""
    out = tmp_path_factory.mktemp("reports") / "small"
    done = rattle(
        "validate --sigma 0.1 --sigma 1.0 --seed 5 --paths 600 --impacts 2 --dt 0.01"
        f" --over sigma=0.01:1:3 --validity-paths 600 --out {out}"
    )
    return out, done.stdout


@pytest.fixture(scope="session")
def validated(small_report):
    return small_report[0]
