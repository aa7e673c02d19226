"""The model (parameters, start, noise, tolerances) and the physics that closures and simulation share."""

from rattle.scene.errors import FileError, InputError, OutputError, RattleError
from rattle.scene.gears import DAT21, Gears
from rattle.scene.parts import Order, Start, Tolerance
from rattle.scene.scene import Scene
from rattle.scene.types import Constants

__all__ = [
    "DAT21",
    "Constants",
    "FileError",
    "Gears",
    "InputError",
    "Order",
    "OutputError",
    "RattleError",
    "Scene",
    "Start",
    "Tolerance",
]
