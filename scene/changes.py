"""A scene in which some values are others: what an axis of a study, a search and a sweep vary.

A value has the name of a field of the scene (``sigma``), of a part of it (``start.y1``), of an
order of the drive (``drive.2.amplitude``), of its gears (``backlash1``), or of a wheel by name or
number (``wheel.third.torque``, ``wheel.3.torque``, ``torque3``), which may be ``body.mass.gap``.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from rattle.scene.errors import InputError, nearest, non_negative
from rattle.scene.gears import DRIVES, NUMBERED, check_typed, values_of
from rattle.scene.gears_input import read_drive
from rattle.scene.loose_wheel import OF_MODEL, WHEEL_VALUE, kind_of_value, spell_value
from rattle.scene.noise import DRIVE_NOISE
from rattle.scene.parts import Start, Tolerance, Wheel, move_to_flanks
from rattle.scene.scene import Scene
from rattle.scene.types import Facts, state_names
from rattle.scene.words import TEXTS

ORDER_UNITS = TEXTS["order_units"]
ORDER_FIELD = re.compile(rf"drive\.([1-9][0-9]*)\.({'|'.join(ORDER_UNITS)})")
"""A value of one order of the drive, such as ``drive.2.amplitude``."""
DRAWN = {f"tolerance.backlash{mesh}": f"c{mesh}_max" for mesh in (1, 2)}
"""Tolerances of the backlashes as ``[gears.tolerance]`` has them, in mm, and their fields."""
SWEPT = ("alpha", "epsilon", "beta1", "beta2", "gamma1", "gamma2", "mu", "gap1", "gap2", "sigma")
"""Fields of one or two wheels in a row that are a number each, over which a sweep may go."""
# not of a single stage
SECOND = ("beta2", "gamma2", "mu", "gap2", "start.x2", "start.y2", "tolerance.c2_max")


def spell(scene: Scene, name: str) -> str:
    """The name of a value as the scene has it: of a wheel or body by its name, or ``torque2``."""
    return spell_value(name, scene.wheel_names, bool(scene.wheels), scene.words.wheel)


def is_unit(scene: Scene, name: str) -> bool:
    """Whether the units of time, length and speed of a scene depend on a value of its gears."""
    gears = scene.gears
    return gears is not None and spell(scene, name) in ("omega", gears.name_of(1, "backlash"))


def numbers_of(scene: Scene) -> dict[str, float]:
    """All numbers of a scene that can be others, by name: those of its gears as they were typed,
    and those of the model."""
    gears = scene.gears
    numbers = {} if gears is None else values_of(gears)
    if scene.wheels:
        names: Sequence[str] = ("alpha", "epsilon", "sigma")
        for number, wheel in enumerate(scene.tree, 1):
            for kind in OF_MODEL:
                numbers[spell(scene, f"{kind}{number}")] = getattr(wheel, kind)
    else:
        names = [name for name in SWEPT if scene.stages == 2 or name not in SECOND]
        for number, wheel in enumerate(scene.tree, 1):
            numbers[f"tolerance.c{number}_max"] = wheel.tolerance
            if gears is not None:
                drawn = 2.0 * wheel.tolerance * gears.units.length
                numbers[f"tolerance.backlash{number}"] = drawn
    numbers |= {name: getattr(scene, name) for name in (*names, "correlation_time")}
    numbers |= _noises_of(scene)
    numbers["start.tau"] = scene.start.tau
    states = zip(state_names(scene.stages), scene.start.values, strict=False)
    return numbers | {f"start.{name}": value for name, value in states}


def _noises_of(scene: Scene) -> dict[str, float]:
    """Intensities of several noises, over sigma, which is that of the drive."""
    if not isinstance(scene.noise, tuple):
        return {}
    return {f"noise.{name}": size for name, size in scene.noise if name != DRIVE_NOISE}


def axis_names(scene: Scene) -> tuple[str, ...]:
    """All values of a scene that an axis of a study may vary, numbers and words, but for orders of
    the drive."""
    others = () if scene.wheels else ("stages", *SECOND)
    words = ("start.mesh", "tolerance.distribution", "tolerance.draw")
    return (*numbers_of(scene), *words, *others)


def parameter_names(scene: Scene) -> list[str]:
    """The numbers of a scene that are changed one at a time to see what each of them does: of its
    gears as they were typed, or of the model where it has none."""
    gears = scene.gears
    if gears is None:
        left_out = ["tolerance.", "start."]
        if scene.bodies and scene.stages == 1:
            # of what is alone the mass is the unit, the ratio is alpha, and one restitution counts
            shared = scene.wheels[0].epsilon is None if scene.wheels else True
            own = [spell(scene, f"{kind}1") for kind in ("mass", "ratio", "epsilon")]
            left_out += own if shared else [*own[:2], "epsilon"]
        return [name for name in numbers_of(scene) if not name.startswith(tuple(left_out))]
    unused = {
        gears.name_of(number, "epsilon")
        for number, wheel in enumerate(gears.wheels, 1)
        if wheel.epsilon is None
    }
    if scene.stages == 1:
        unused |= {name for name in NUMBERED if name[-1] == "2"}
    unused |= set(DRIVES)
    others = [name for name in values_of(gears) if name not in unused]
    return ["amplitude", *others, "sigma", *_noises_of(scene), "correlation_time"]


def change(scene: Scene, changes: Facts) -> Scene:
    """The scene with other values, by name; all others stay as they were typed.

    Values of gears are changed first, as `Scene.with_gears` does; a start on a flank stays on it.
    """
    changes = {spell(scene, name): value for name, value in changes.items()}
    of_gears = {} if scene.gears is None else values_of(scene.gears)
    typed = {name: value for name, value in changes.items() if name in of_gears}
    if typed:
        scene = scene.with_gears(**typed)
    orders: dict[int, Facts] = {}
    parts: dict[str, Facts] = {
        part: {} for part in ("tolerance", "start", "wheel", "body", "noise")
    }
    values: Facts = {}
    for name, value in changes.items():
        part, _, field = name.partition(".")
        if name in typed:
            continue
        if order := ORDER_FIELD.fullmatch(name):
            orders.setdefault(int(order[1]), {})[order[2]] = value
        elif name in DRAWN and scene.gears is not None:
            half = 0.5 * non_negative(name, value)  # of the full backlash, as a drawing has it
            parts[part][DRAWN[name]] = half / scene.gears.units.length
        elif field:
            parts[part][field] = value
        else:
            values[name] = value
    if orders:
        values["drive"] = _change_orders(scene, orders)
    if parts["tolerance"]:
        values["tolerance"] = replace(scene.tolerance or Tolerance(), **parts["tolerance"])
    if parts["noise"]:
        noises: Any = scene.noise
        values["noise"] = dict(noises) | parts["noise"]
    if of_wheels := parts["wheel"] | parts["body"]:
        values["wheels"] = _change_wheels(scene, of_wheels)
    gaps = [values.get(f"gap{i}", gap) for i, gap in enumerate(scene.half_gaps, 1)]
    if "wheels" in values:
        gaps = [wheel.gap for wheel in values["wheels"]]
    start = move_to_flanks(scene.start, scene.half_gaps, gaps)
    values["start"] = _change_start(start, parts["start"])
    return replace(scene, **values)


def _change_wheels(scene: Scene, changes: Facts) -> tuple[Wheel, ...]:
    """The wheels of the model with other values, by ``third.gamma``."""
    wheels = dict(zip(scene.wheel_names if scene.wheels else (), scene.wheels, strict=True))
    for name, value in changes.items():
        label, _, kind = name.partition(".")
        if label not in wheels:
            name = f"{scene.words.wheel}.{name}"
            raise InputError("scene", name, _remedy(scene, name))
        wheels[label] = replace(wheels[label], **{kind: value})
    return tuple(wheels.values())


def _change_start(start: Start, changes: Facts) -> Start:
    """A start with other values, also of a wheel beyond the second."""
    if not start.state or "state" in changes:
        return replace(start, **changes)
    names = state_names(len(start.state) // 2)
    state = tuple(changes.get(n, value) for n, value in zip(names, start.state, strict=True))
    others = {name: value for name, value in changes.items() if name not in names}
    return replace(start, state=state, **others)


def _change_orders(scene: Scene, orders: Mapping[int, Facts]) -> Any:
    """The drive with other values of some orders; one that it did not have comes to it."""
    tables = {one.order: vars(one) for one in scene.drive}
    for number, new in orders.items():
        old = tables.get(number, {"order": number, "amplitude": 0.0})
        kept = {key: value for key, value in old.items() if not any(n.startswith(key) for n in new)}
        tables[number] = kept | dict(new)
    radius = None if scene.gears is None else scene.gears.values.get("driver_radius")
    return read_drive([*tables.values()], scene.gears, radius)


def find_value(scene: Scene, name: str, asked: str) -> float:
    """A number of a scene by its name; refused as an entry of what was asked, if there is none."""
    given = name
    name = spell(scene, name)
    numbers = numbers_of(scene)
    if name in numbers:
        return float(numbers[name])
    if order := ORDER_FIELD.fullmatch(name):
        return _find_in_order(scene, int(order[1]), order[2])
    if scene.gears is not None:
        check_typed(scene.gears, name, asked)
    raise InputError(asked, given, _remedy(scene, given))


def _remedy(scene: Scene, name: str) -> str:
    """What to write in place of a name that no number of a scene has: of values of wheels those of
    the one that was named, or of the first."""
    labels = scene.wheel_names
    shown = labels[0]
    part = scene.words.wheel
    if name.startswith(("wheel.", "body.")):
        shown = name.split(".")[1]
        if shown.isdecimal() and 0 < int(shown) <= len(labels):
            shown = labels[int(shown) - 1]
        if shown not in labels:
            return f"no {part} has this name; {nearest(shown, labels)}"
    others = [n for n in numbers_of(scene) if not n.startswith(f"{part}.")]
    own = [n for n in numbers_of(scene) if n.startswith(f"{part}.{shown}.")]
    return nearest(name, own + others)


def _find_in_order(scene: Scene, number: int, field: str) -> float:
    """A value of an order of the drive; 0 of one that it does not have."""
    values = {one.order: one for one in scene.drive}
    if number not in values:
        return 0.0
    phase = values[number].phase
    amplitude = values[number].amplitude
    if field.startswith("phase"):
        return math.degrees(phase) if field == "phase_degrees" else phase
    if field == "amplitude" or scene.gears is None:
        return amplitude
    in_mm = amplitude * scene.gears.amplitude
    return in_mm / scene.gears.values.get("driver_radius", 1.0) if field.endswith("rad") else in_mm


def same_speed(speed: float, scene: Scene, changed: Scene) -> float:
    """A dimensionless speed of a scene in a changed one: of gears it stays the same in mm/s."""
    if scene.gears is None or changed.gears is None:
        return speed
    return speed * (scene.gears.units.speed / changed.gears.units.speed)


def unit_of_value(name: str) -> str:
    """The unit of a value of gears or of a measured order; empty for one without a dimension."""
    if order := ORDER_FIELD.fullmatch(name):
        return ORDER_UNITS[order[2]]
    return TEXTS["units"].get(kind_of_value(name), "")


def words_of_value(name: str) -> str:
    """What a value is, in words; empty for one that only its symbol names."""
    if order := ORDER_FIELD.fullmatch(name):
        return f"{order[2].split('_')[0]} of order {order[1]} of the drive"
    if name in DRAWN:
        return TEXTS["wheel_values"]["backlash_tolerance"].format(name[-1])
    if value := WHEEL_VALUE.fullmatch(name):
        label = value[1] or value[3]
        if label:
            return TEXTS["wheel_values"].get(value[2], "").format(label)
    part, _, field = name.partition(".")
    if part == "noise":
        return f"intensity of the noise of {field}"
    return TEXTS["values"].get(name, "")
