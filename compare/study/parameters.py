"""The parameters of a scene that can be changed one at a time: of its gears, or of the model where
it has none."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rattle.scene import InputError, Scene, positive
from rattle.scene.changes import (
    change,
    find_value,
    parameter_names,
    spell,
    unit_of_value,
    words_of_value,
)
from rattle.scene.parts import SINE_ALONE
from rattle.scene.text import percent

SIGMA_RANGE = (1e-3, 2.0)  # where the noise intensity is searched by default
AROUND = 4.0  # other parameters: from a fourth of their value to four times it
CHANGE = 0.01  # the change of a parameter that effects are stated for
PERCENT = percent(CHANGE)
# relative changes of a parameter at which the motion is simulated, up and down
RELATIVE_CHANGES = (0.02, 0.04)


@dataclass(frozen=True)
class Parameter:
    """A parameter of a scene with its value, and the scenes in which it alone is another."""

    scene: Scene
    name: str
    value: float

    @property
    def unit(self) -> str:
        """Its unit; empty for one without a dimension."""
        return unit_of_value(self.name)

    @property
    def words(self) -> str:
        """What it is, in words."""
        return words_of_value(self.name) or f"`{self.name}`"

    def scene_at(self, value: float) -> Scene:
        """The scene with another value of it; refused where a scene cannot have it."""
        return change(self.scene, {self.name: value})


def find_parameters(scene: Scene) -> dict[str, Parameter]:
    """All parameters of a scene that are not 0, by name.

    Those of gears are the values in physical units; the drive is its amplitude in mm, which stays
    as it is while a backlash is changed, and so do tolerances in mm.  The amplitudes of several
    orders are relative to it.  The noise intensity `sigma` is one of them and stays as it is while
    the others are changed.
    """
    names = parameter_names(scene)
    if scene.drive != SINE_ALONE:
        names += [f"drive.{one.order}.amplitude" for one in scene.drive]
    known = (find_parameter(scene, name) for name in names)
    return {parameter.name: parameter for parameter in known if parameter.value != 0.0}


def choose_parameters(scene: Scene, names: Iterable[str] | None) -> dict[str, Parameter]:
    """The parameters of some names, all that are not 0 by default."""
    if names is None:
        return find_parameters(scene)
    chosen = {name: find_parameter(scene, name, "parameters") for name in names}
    for name, parameter in chosen.items():
        if parameter.value == 0.0:
            why = f"is 0 in this scene, so {PERCENT} more of it changes nothing"
            raise InputError("parameters", name, why)
    return chosen


def find_parameter(scene: Scene, name: str, asked: str = "over") -> Parameter:
    """A parameter, or any other number of the scene, such as ``correlation_time``, ``start.y1``,
    ``drive.2.phase``."""
    return Parameter(scene, spell(scene, name), find_value(scene, name, asked))


def find_range(
    parameter: Parameter, between: Sequence[float] | None, around: float = AROUND
) -> tuple[float, float]:
    """The range of a search; both ends are values that a scene can have."""
    over = parameter.name
    value = parameter.value
    ends = between or (SIGMA_RANGE if over == "sigma" else (value / around, value * around))
    if between is None and over != "sigma" and not value > 0.0:
        raise InputError(over, value, "is not above 0 in this scene: give a range")
    low, high = ends
    if not positive(f"{over} LOW", low) < positive(f"{over} HIGH", high):
        raise InputError(f"{over} HIGH", high, f"must be greater than LOW = {low:g}")
    possible = []
    for end in ends:
        try:
            parameter.scene_at(end)
        except InputError as error:
            if between is not None:
                raise InputError(over, end, f"no scene can have it ({error})") from None
            end = value
        possible.append(end)
    return possible[0], possible[1]
