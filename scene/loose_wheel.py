"""A loose wheel of a gearbox in physical units, the names of its values, and their checks."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, fields, replace
from typing import Any

from rattle.scene.drag import DragLaw, read_drag
from rattle.scene.errors import (
    InputError,
    check_keys,
    check_range,
    finite,
    non_negative,
    positive,
    suggesting,
    unit_interval,
)
from rattle.scene.parts import find_parents, wheel_labels
from rattle.scene.text import as_call
from rattle.scene.types import Facts

SIZES = (1e-12, 1e12)  # admissible range of every dimensional value
POSITIVE = ("omega", "inertia", "radius", "backlash", "parent_radius", "driver_radius")
NON_NEGATIVE = ("damping", "torque", "backlash_tolerance")
WHEEL_KINDS = ("inertia", "radius", "backlash", "damping", "torque")
"""Values of every wheel."""
OPTIONAL_KINDS = ("parent_radius", "epsilon", "backlash_tolerance")
"""Values of a wheel that it need not have."""
GEAR_VALUES = (*WHEEL_KINDS, *OPTIONAL_KINDS)
OF_MODEL = ("beta", "gamma", "gap", "mass", "ratio", "tolerance", "epsilon", "stiffness")
"""Values of a `rattle.scene.Wheel`, dimensionless."""
WHEEL_VALUE = re.compile(
    r"(?:(?:wheel|body)\.([^.]+)\.)?"
    rf"({'|'.join(dict.fromkeys((*GEAR_VALUES, *OF_MODEL)))})"
    r"([1-9][0-9]*)?"
)
"""A value of a wheel or body: ``wheel.third.torque``, ``wheel.3.torque`` or ``torque3``."""


@suggesting
@dataclass(frozen=True, kw_only=True)
class LooseWheel:
    """A loose wheel of a gearbox and its mesh with its parent, in physical units.

    `rattle.scene.Gears` takes these, checks them, and fills in what is left out.

    Parameters
    ----------
    inertia : float
        Moment of inertia of all that turns with the wheel, in kg mm^2.
    radius : float
        Base radius at its mesh with the parent, in mm.
    backlash : float
        Full backlash of that mesh in mm; left out, that of the first wheel.
    meshes : int or str
        Number or name of its parent, the wheel that it meshes with, which stands before it; 0 or
        ``driver``, if left out, is the driver.
    parent_radius : float, optional
        Base radius of the parent at this mesh in mm, where that is a second toothing on its shaft;
        left out, that of the parent's own mesh, and of the driver that at the first wheel.
    damping : float
        Rotational damping in N mm s; left out, that of the first wheel, or none.
    torque : float
        Drag torque in N mm at the mean speed; left out, that of the first wheel, or none.
    torque_over_rpm : sequence of pairs, or mapping, optional
        In place of `torque`, as ``torque1_over_rpm`` of `rattle.scene.Gears.driven`.
    epsilon : float, optional
        Restitution at its mesh; left out, that of the gears.
    backlash_tolerance : float
        Largest deviation of the full backlash in mm, the number behind ± in a drawing.
    name : str
        What tables and figures call it; by default its number.

    Examples
    --------
    >>> LooseWheel(name="third", inertia=4000.0, radius=41.0, backlash=0.2).meshes
    0
    """

    name: str = ""
    meshes: int | str = 0
    inertia: float
    radius: float
    parent_radius: float | None = None
    backlash: float = None  # type: ignore[assignment]  # filled in by `complete`
    backlash_tolerance: float = 0.0
    damping: float = None  # type: ignore[assignment]
    torque: float = None  # type: ignore[assignment]
    torque_over_rpm: DragLaw | None = None
    epsilon: float | None = None

    def __repr__(self) -> str:
        return as_call("Gears.Wheel", as_table(self))


WHEEL_FIELDS = tuple(f.name for f in fields(LooseWheel))
NEEDED = tuple(f.name for f in fields(LooseWheel) if f.default is MISSING)


def kind_of_value(name: str) -> str:
    """What a value of gears is: ``torque`` of ``torque1`` and of ``wheel.third.torque``."""
    return name.rpartition(".")[2].rstrip("0123456789")


def check_value(name: str, value: object) -> float:
    """Check a value of gears by its name, as a float."""
    kind = kind_of_value(name)
    number = finite(name, value)
    if kind in POSITIVE:
        check_range(name, positive(name, number), *SIZES)
    elif kind in NON_NEGATIVE:
        non_negative(name, number, most=SIZES[1])
    elif kind == "epsilon":
        unit_interval(name, number)
    else:
        non_negative(name, number)
    return number


def value_name(
    labels: Sequence[str], number: int, kind: str, named: bool, part: str = "wheel"
) -> str:
    """The name of a value of a wheel, or other `part`: ``wheel.third.torque``, or ``torque2`` where
    not `named`."""
    if named:
        return f"{part}.{labels[number - 1]}.{kind}"
    first, rest = (kind, "") if kind != "torque_over_rpm" else ("torque", "_over_rpm")
    return f"{first}{number}{rest}"


def spell_value(name: str, labels: Sequence[str], named: bool, part: str = "wheel") -> str:
    """The name of a value of a wheel as its scene or gears have it; any other name as it is.

    `labels`: of the wheels.  `named`, `part`: as `value_name` has them.
    """
    value = WHEEL_VALUE.fullmatch(name)
    if value is None or bool(value[1]) == bool(value[3]):
        return name
    numbers = {str(number): number for number in range(1, len(labels) + 1)}
    numbers |= {label: number for number, label in enumerate(labels, 1)}
    number = numbers.get(value[1] or value[3])
    return name if number is None else value_name(labels, number, value[2], named, part)


def read_wheels(given: object, named: bool = True) -> tuple[LooseWheel, ...]:
    """Loose wheels from a list of them or of their tables, checked; what is left out is filled in.

    `named`: as `value_name` has it, for errors.
    """
    if isinstance(given, str | Mapping) or not isinstance(given, Sequence):
        raise InputError("wheels", given, "give a sequence; in a file, a table [[wheel]] for each")
    wheels = [_as_wheel(one, number) for number, one in enumerate(given, 1)]
    find_parents(wheels, "meshes")
    first = wheels[0]
    if first.torque is None and first.torque_over_rpm is None:
        first = replace(first, torque=0.0)
    if first.damping is None:
        first = replace(first, damping=0.0)
    labels = wheel_labels(wheels)
    for number, wheel in enumerate(wheels, 1):
        names = {kind: value_name(labels, number, kind, named) for kind in WHEEL_FIELDS}
        wheels[number - 1] = _check_wheel(_complete(wheel, first), names)
    return tuple(wheels)


def _complete(wheel: LooseWheel, first: LooseWheel) -> LooseWheel:
    """A wheel with what it leaves out as the first one has it."""
    left_out = ["backlash", "damping"]
    if wheel.torque is None and wheel.torque_over_rpm is None:
        left_out += ["torque", "torque_over_rpm"]
    values = {kind: getattr(first, kind) for kind in left_out if getattr(wheel, kind) is None}
    return replace(wheel, **values)


def _check_wheel(wheel: LooseWheel, names: Mapping[str, str]) -> LooseWheel:
    """A wheel with its values checked, as floats."""
    checked: Facts = {}
    for kind in GEAR_VALUES:
        value = getattr(wheel, kind)
        needed = kind not in ("parent_radius", "epsilon")
        if kind == "torque":
            needed = wheel.torque_over_rpm is None
        if needed or value is not None:
            checked[kind] = check_value(names[kind], value)
    if wheel.torque_over_rpm is not None:
        table = read_drag(names["torque_over_rpm"], wheel.torque_over_rpm)
        checked["torque_over_rpm"] = table
    if checked["backlash_tolerance"] >= checked["backlash"]:
        why = f"must be below backlash = {wheel.backlash:g} mm, or a gap could close"
        raise InputError(names["backlash_tolerance"], wheel.backlash_tolerance, why)
    return replace(wheel, **checked)


def _as_wheel(given: object, number: int) -> LooseWheel:
    """A loose wheel as it was given: itself, or its table."""
    if isinstance(given, LooseWheel):
        return given
    if not isinstance(given, Mapping):
        raise InputError("wheels", given, "give each as a LooseWheel, or as a table of its values")
    place = f"wheel.{given.get('name') or number}"
    check_keys(place, given, WHEEL_FIELDS)
    missing = [name for name in NEEDED if name not in given]
    if missing:
        raise InputError(place, missing, "these keys are missing")
    return LooseWheel(**given)


def as_table(wheel: Any) -> Facts:
    """A wheel, loose or of the model, as a table of a file; what is as by default is left out."""
    defaults = {f.name: f.default for f in fields(wheel)}
    return {name: value for name, value in asdict(wheel).items() if value != defaults[name]}


def ratios_of(wheels: Sequence[LooseWheel]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """For each wheel the radius of its parent at their mesh over the parent's own (of the driver
    over that at the first wheel), and the product of these from the driver on."""
    parents = find_parents(wheels, "meshes")
    ratios: list[float] = []
    turns: list[float] = []
    for label, wheel, parent in zip(wheel_labels(wheels), wheels, parents, strict=True):
        own = wheels[parent - 1].radius if parent else wheels[0].parent_radius
        ratio = 1.0
        if wheel.parent_radius is not None:
            if own is None:
                why = "give the driver's radius at the first wheel too: driver_radius"
                raise InputError(f"wheel.{label}.parent_radius", wheel.parent_radius, why)
            ratio = wheel.parent_radius / own
        ratios.append(ratio)
        turns.append(ratio * (turns[parent - 1] if parent else 1.0))
    return tuple(ratios), tuple(turns)
