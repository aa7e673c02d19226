import pytest

from scene import DAT21, Scene


@pytest.fixture
def dat21():
    return Scene.from_gears(DAT21, sigma=0.1)


@pytest.fixture
def still():
    """A scene in which nothing accelerates, but for the changes asked for: flights are parabolas."""

    def build(**changes):
        values = {"alpha": 0.0, "epsilon": 0.9, "beta1": 0.0, "gamma1": 0.0, "mu": 0.5} | changes
        return Scene(**values)

    return build
