"""What the tests of faults share."""

import pytest

from rattle.compare.study.figures import STUDY_FIGURES


@pytest.fixture(scope="session", autouse=True)
def few_figures():
    """Draw one figure of a study instead of seven: drawing takes most of a small study's time."""
    first = dict([*STUDY_FIGURES.items()][:1])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rattle.compare.study.impacts_page.STUDY_FIGURES", first)
        yield


@pytest.fixture
def no_work(monkeypatch):
    """No command gets so far that it simulates."""

    def fail(*_):
        pytest.fail("paths were followed")

    monkeypatch.setattr("rattle.montecarlo.kernel.blocks.run", fail)
