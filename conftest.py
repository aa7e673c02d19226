"""Plugins of the project's own tests; its plugin for accuracy thresholds is named in case it has
not been installed."""

import os
import threading
from pathlib import Path

import pytest

pytest_plugins = ["pytester", "rattle.compare.thresholds.plugin"]
# no test starts processes that compile unless it says so
os.environ.setdefault("RATTLE_COMPILERS", "1")

SECOND_TIER = [
    Path(__file__).parent / "tests" / folder
    for folder in ("faults", "interpreted", "page", "security")
]
"""Folders whose tests are all slow, or look for faults that are rare."""
LONGEST = {"test_docs_site.py"}
"""Files of the second tier whose few tests take minutes: begun last, they would be waited for."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark what lies in a folder of the second tier; begin with the files that one process needs
    minutes for."""
    for item in items:
        if any(folder in item.path.parents for folder in SECOND_TIER):
            item.add_marker(pytest.mark.slow)
    items.sort(key=lambda item: item.path.name not in LONGEST)


@pytest.fixture(autouse=True, scope="session")
def silent():
    """No command says that it takes long: whether it does depends on the machine."""
    from rattle.scene import progress

    progress.QUIET = threading.TIMEOUT_MAX


@pytest.fixture
def undrawn(monkeypatch):
    """Figures are made but not drawn: for tests of what stands beside them."""
    from figures import leave_undrawn

    leave_undrawn(monkeypatch)
