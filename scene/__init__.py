"""The model (parameters, start, noise, tolerances) and the physics that closures and simulation share."""

from rattle.scene.errors import (
    FileError,
    InputError,
    OutputError,
    RattleError,
    check_keys,
    choice,
    count,
    finite,
    nearest,
    positive,
)
from rattle.scene.gears import DAT21, Gears
from rattle.scene.parts import Order, Start, Tolerance
from rattle.scene.scene import Scene, check_scene
from rattle.scene.text import as_html, duration_text, harmless, line
from rattle.scene.types import SECTION, STATE, Bools, Constants, Floats, Ints

__all__ = [
    "DAT21",
    "SECTION",
    "STATE",
    "Bools",
    "Constants",
    "FileError",
    "Floats",
    "Gears",
    "InputError",
    "Ints",
    "Order",
    "OutputError",
    "RattleError",
    "Scene",
    "Start",
    "Tolerance",
    "as_html",
    "check_keys",
    "check_scene",
    "choice",
    "count",
    "duration_text",
    "finite",
    "harmless",
    "line",
    "nearest",
    "positive",
]
