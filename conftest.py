"""Plugins of the project's own tests; its plugin for accuracy thresholds is named in case it has not been installed."""

import os
from pathlib import Path

import pytest

pytest_plugins = ["pytester", "rattle.compare.thresholds.plugin"]
os.environ.setdefault("RATTLE_COMPILERS", "1")  # no test starts processes that compile unless it says so

SECOND_TIER = [Path(__file__).parent / "tests" / folder for folder in ("faults", "interpreted", "page", "security")]
"""Folders whose tests are all slow, or look for faults that are rare."""
EMPTY = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"></svg>\n'


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark what lies in a folder of the second tier."""
    for item in items:
        if any(folder in item.path.parents for folder in SECOND_TIER):
            item.add_marker(pytest.mark.slow)


@pytest.fixture(autouse=True)
def unhurried(monkeypatch):
    """What a command says while it works depends on how fast the machine is: tests of its answer do without it."""
    monkeypatch.setattr("rattle.scene.progress.FIRST", 1e6)


@pytest.fixture
def undrawn(monkeypatch):
    """Figures are made but not drawn, which takes most of a report's time: for tests of what stands beside them."""
    from matplotlib.figure import Figure

    def savefig(figure, file, **settings):
        file.write(EMPTY.encode())

    monkeypatch.setattr(Figure, "savefig", savefig)
