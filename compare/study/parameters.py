"""The parameters of a scene that can be changed one at a time: of its gears, or of the model where
it has none."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, NamedTuple

from rattle.compare.study.design import ORDER_FIELD, SCENE_FIELDS, make_scene, table_of
from rattle.scene import Scene, choice
from rattle.scene.gear_values import has_own_start, is_value, scene_with, values_of
from rattle.scene.gears_input import UNIT
from rattle.scene.parts import SINE_ALONE
from rattle.scene.scene import SWEPT
from rattle.scene.text import percent

CHANGE = 0.01  # the change of a parameter that effects are stated for
PERCENT = percent(CHANGE)
# relative changes of a parameter at which the motion is simulated, up and down
RELATIVE_CHANGES = (0.02, 0.04)
# not of a single stage
SECOND = ("beta2", "gamma2", "mu", "gap2", "start.x2", "start.y2", "tolerance.c2_max")
NOT_REAL = ("stages", "start.mesh", "tolerance.distribution", "tolerance.draw")
PARAMETER_WORDS = {
    "amplitude": "amplitude of the drive",
    "omega": "frequency of the drive",
    "epsilon": "restitution",
    "inertia": "inertia of wheel {}",
    "radius": "radius of wheel {}",
    "backlash": "backlash at mesh {}",
    "damping": "damping of wheel {}",
    "torque": "drag torque on wheel {}",
    "driver_radius": "radius of the driver",
    "speed_rpm": "mean speed of the driver",
    "speed_rad_s": "mean speed of the driver",
    "sigma": "noise intensity",
    "correlation_time": "correlation time of the noise",
}


class Parameter(NamedTuple):
    """A parameter of a scene with its value, and the scenes in which it alone is another."""

    name: str
    value: float
    unit: str  # empty for one without a dimension
    # from the value; raises InputError where a scene cannot have it
    scene_at: Callable[[float], Scene]

    @property
    def words(self) -> str:
        """What it is, in words."""
        if self.name.startswith("drive."):
            return f"order {self.name.split('.')[1]} of the drive"
        words = PARAMETER_WORDS.get(self.name.rstrip("12"))
        return words.format(self.name[-1]) if words else f"`{self.name}`"


def find_parameters(scene: Scene, absent: bool = False) -> dict[str, Parameter]:
    """All parameters of a scene that are not 0, by name; with `absent` also those that are 0.

    Those of gears are the values in physical units; the drive is its amplitude in mm, which stays
    as it is while a backlash is changed, and so do tolerances in mm.  The amplitudes of several
    orders are relative to it.  The noise intensity `sigma` is one of them and stays as it is while
    the others are changed.
    """
    gears = scene.gears
    if gears is None:
        values = {
            name: getattr(scene, name) for name in SWEPT if scene.stages == 2 or name not in SECOND
        }
    else:
        values = values_of(gears)
        if scene.stages == 1:
            values = {name: value for name, value in values.items() if name[-1] != "2"}
    values |= {"sigma": scene.sigma, "correlation_time": scene.correlation_time}
    if absent or scene.drive != SINE_ALONE:
        values |= {f"drive.{one.order}.amplitude": one.amplitude for one in scene.drive}
    return {
        name: Parameter(
            name, value, "" if gears is None else UNIT.get(name.rstrip("12"), ""), _at(scene, name)
        )
        for name, value in values.items()
        if absent or value != 0.0
    }


def choose_parameters(scene: Scene, names: Iterable[str] | None) -> dict[str, Parameter]:
    """The parameters of some names, all that are not 0 by default."""
    known = find_parameters(scene)
    chosen = known if names is None else names
    return {name: known[choice("parameters", name, known)] for name in chosen}


def find_parameter(scene: Scene, name: str, asked: str = "over") -> Parameter:
    """A parameter, or any other number of the scene, such as ``correlation_time``, ``start.y1``,
    ``drive.2.phase``."""
    known = find_parameters(scene, absent=True)
    if name in known:
        return known[name]
    if not ORDER_FIELD.fullmatch(name):
        missing = (*known, *NOT_REAL, *(SECOND if scene.stages == 1 else ()))
        choice(asked, name, [*known, *(other for other in SCENE_FIELDS if other not in missing)])
    value: Any = scene
    for field in name.split("."):
        value = getattr(value, field, 0.0)
    phases = {f"drive.{one.order}.phase": one.phase for one in scene.drive}
    return Parameter(name, phases.get(name, value), "", _at(scene, name))


def _at(scene: Scene, name: str) -> Callable[[float], Scene]:
    """The scene as a function of one of its parameters."""
    base = table_of(scene, own_start=not name.startswith("gap") or has_own_start(scene))

    def changed(value: float) -> Scene:
        """The scene with this value of the parameter."""
        if is_value(name, scene.gears):
            return scene_with(scene, {name: value})
        return replace(make_scene(base, {name: value}), gears=scene.gears)

    return changed
