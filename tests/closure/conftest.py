import sys
from pathlib import Path

import pytest

from scene import DAT21, Scene

sys.path.insert(0, str(Path(__file__).parents[1] / "scene"))  # reference_dynamics serves both suites


@pytest.fixture
def dat21():
    return Scene.from_gears(DAT21, sigma=0.05)


@pytest.fixture
def paper():
    """DAT21 at the noise intensity of the paper's section 4."""
    return Scene.from_gears(DAT21, sigma=1.5**0.5)
