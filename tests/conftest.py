"""What the tests of several folders share."""

import pytest
from commands import SMALL_VALIDATION, rattle


@pytest.fixture(scope="session")
def validated(tmp_path_factory):
    """A small report of ``rattle validate``, with its figures."""
    out = tmp_path_factory.mktemp("reports") / "small"
    rattle(f"{SMALL_VALIDATION} --out {out}")
    return out


@pytest.fixture
def few_beside(monkeypatch):
    """A scheme that is shown beside a simulation has few paths."""
    from figures import show_few_beside

    show_few_beside(monkeypatch)
