"""The scene of a command: from a file, or the paper's example."""

from pathlib import Path
from typing import TYPE_CHECKING

from rattle.compare.cli.console import say

if TYPE_CHECKING:
    from rattle.scene import Scene

PAPER_SIGMA = 1.5**0.5  # sqrt(alpha) of DAT21


def load_scene(path: Path | None, sigma: float | None, otherwise: float = PAPER_SIGMA) -> "Scene":
    """Load a scene file, or DAT21 at the noise intensity `otherwise`; `sigma` replaces either's noise."""
    from rattle.scene import DAT21, Scene

    scene = Scene.load(path) if path else Scene.from_gears(DAT21, sigma=otherwise)
    if sigma is not None:
        return scene.with_sigma(sigma)
    if path and scene.sigma == 0.0:
        say(f"{path}: no sigma, so there is no noise", err=True)
    return scene
