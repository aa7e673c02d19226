"""The parameters of a scene that can be changed one at a time: of its gears, or of the model where it has none."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from rattle.compare.chaos.sweep import FIELDS, with_field
from rattle.scene.gears import Gears
from rattle.scene.parts import Start
from rattle.scene.scene import Scene

CHANGE = 0.01  # the change of a parameter that effects are stated for
STEPS = (0.02, 0.04)  # relative changes of a parameter at which the motion is simulated, up and down
SECOND = ("beta2", "gamma2", "mu", "gap2")  # what a single stage does not have
UNITS = {
    "amplitude": "mm",
    "omega": "rad/s",
    "inertia": "kg mm^2",
    "radius": "mm",
    "backlash": "mm",
    "damping": "N mm s",
    "torque": "N mm",
}
WORDS = {
    "amplitude": "amplitude of the drive",
    "omega": "frequency of the drive",
    "epsilon": "restitution",
    "inertia": "inertia of wheel {}",
    "radius": "radius of wheel {}",
    "backlash": "backlash at mesh {}",
    "damping": "damping of wheel {}",
    "torque": "drag torque on wheel {}",
    "sigma": "noise intensity",
}


class Parameter(NamedTuple):
    """A parameter of a scene with its value, and the scenes in which it alone is another."""

    name: str
    value: float
    unit: str  # empty for one without a dimension
    scene_at: Callable[[float], Scene]  # from the value; raises InputError where a scene cannot have it

    @property
    def words(self) -> str:
        """What it is, in words."""
        kind = self.name.rstrip("12")
        return WORDS[kind].format(self.name[-1]) if kind in WORDS else f"`{self.name}`"


def find_parameters(scene: Scene, absent: bool = False) -> dict[str, Parameter]:
    """All parameters of a scene that are not 0, by name; with `absent` also those that are 0.

    Those of gears are the values in physical units; the drive is its amplitude in mm, which stays as it is while a
    backlash is changed, and so do tolerances in mm.  The noise intensity `sigma` is one of them and stays as it is
    while the others are changed.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> found = find_parameters(Scene.from_gears(DAT21, sigma=0.1))
    >>> list(found)[:4], found["torque1"].scene_at(110.0).gears.torque1
    (['amplitude', 'epsilon', 'omega', 'inertia1'], 110.0)
    """
    gears = scene.gears
    if gears is None:
        values = {name: getattr(scene, name) for name in FIELDS if scene.stages == 2 or name not in SECOND}
    else:
        values = {"amplitude": gears.amplitude} | {k: v for k, v in gears.values.items() if k != "alpha"}
        if scene.stages == 1:
            values = {name: value for name, value in values.items() if name[-1] != "2"}
    values["sigma"] = scene.sigma
    return {
        name: Parameter(name, value, "" if gears is None else UNITS.get(name.rstrip("12"), ""), _at(scene, name))
        for name, value in values.items()
        if absent or value != 0.0
    }


def _at(scene: Scene, name: str) -> Callable[[float], Scene]:
    """The scene as a function of one of its parameters."""

    own_start = scene.start != Start(0.0, scene.gap1, 2.0, scene.gap2, 2.0, mesh=1)

    def changed(value: float) -> Scene:
        if scene.gears is None or name == "sigma":
            return with_field(scene, name, value)
        gears = _with_value(scene.gears, name, value)
        unit = scene.gears.backlash1 / gears.backlash1  # old unit of length over the new one
        tolerance = scene.tolerance and replace(
            scene.tolerance, c1_max=unit * scene.tolerance.c1_max, c2_max=unit * scene.tolerance.c2_max
        )
        return Scene.from_gears(
            gears, sigma=scene.sigma, tolerance=tolerance, stages=scene.stages, start=scene.start if own_start else None
        )

    return changed


def _with_value(gears: Gears, name: str, value: float) -> Gears:
    """Gears with another value, driven with the same amplitude in mm."""
    if name == "amplitude":
        return replace(gears, alpha=value / gears.backlash1)
    found = replace(gears, **{name: value})
    return replace(found, alpha=gears.amplitude / found.backlash1)
