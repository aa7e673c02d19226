"""What the sessions within a session share."""

import pytest

from closure import mean_map
from compare.thresholds import figure, fixture, summary  # noqa: F401
from montecarlo import simulate
from scene import DAT21, Scene


@pytest.fixture(scope="session", autouse=True)
def loaded():
    """An inner session forgets the modules that it has loaded itself, and compiled code can be loaded only once."""
    scene = Scene.from_gears(DAT21, sigma=0.02)
    mean_map(scene, impacts=1, reading="branching")
    simulate(scene, paths=2, impacts=1, scheme="exact-flight", control=True, batches=True, energy=True)


@pytest.fixture(autouse=True)
def alone(monkeypatch):
    """Inner sessions load no slow plugin of others, and print as on a terminal: pytest cuts no line in a CI."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.setenv("COLUMNS", "80")
    for name in ("CI", "BUILD_NUMBER"):
        monkeypatch.delenv(name, raising=False)
