"""Gears as people write them: the tables of a scene file, and questions about gears that cannot
exist.

The table ``[gears]`` has gears, and their tolerances as a drawing gives them; each table
``[[wheel]]`` has a loose wheel where these are not numbered, each table ``[[drive]]`` an order, and
a table ``[drive]`` the file of a measured drive.  A value is questioned, in the user's own fields
and units, only where no gear pair can have it (docs/guide/scenes.md).  What follows from several
values, and is outside the range of the model, is named by the field that differs most from the
paper's example.
"""

import math
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from rattle.scene.drag import DRAG_TABLES
from rattle.scene.errors import (
    InputError,
    check_keys,
    check_range,
    finite,
    non_negative,
    positive,
    table_in,
)
from rattle.scene.gears import DAT21, DRIVES, NUMBERED, SPEEDS, WHEEL2, Gears
from rattle.scene.loose_wheel import LooseWheel, kind_of_value
from rattle.scene.measured_drive import MeasuredDrive, measure_drive
from rattle.scene.parts import Order
from rattle.scene.types import Facts
from rattle.scene.words import TEXTS

GEAR_FIELDS = tuple(f.name for f in fields(Gears) if f.name != "wheels")
REQUIRED = ("alpha", "epsilon", "omega", "inertia1", "radius1", "backlash1")
OPTIONAL = (*DRIVES, "driver_radius", *SPEEDS, *DRAG_TABLES, "tolerance")
AMPLITUDES = {"amplitude_mm": "amplitude", "amplitude_rad": "amplitude_rad"}
"""An order's amplitude on the driver's pitch circle, in mm or rad, and what the gears call their
own."""
MEASURED_KEYS = ("file", "periods", "periods_per_turn", "highest_order")
"""Keys of the table ``[drive]`` of a measured drive."""
ORDER_KEYS = ("order", "amplitude", *AMPLITUDES, "phase", "phase_degrees")
TOLERANCE_KEYS = ("backlash1", "backlash2", "distribution", "draw")


def read_gears(table: Facts, stages: object, wheels: object = None) -> Gears:
    """Gears from their table.

    `table`: The fields of Gears, which says what may be left out, and the arguments of
    `Gears.driven`. `stages`: Of the scene; for a single stage all values of wheel 2 may be left
    out. `wheels`: The tables ``[[wheel]]``, in place of all numbered values.
    """
    check_keys("gears", table, (*GEAR_FIELDS, *OPTIONAL))
    values = {name: value for name, value in table.items() if name != "tolerance"}
    if wheels is None:
        wanted = REQUIRED if stages == 1 else sorted((*REQUIRED, *WHEEL2), key=GEAR_FIELDS.index)
    else:
        for name in (*NUMBERED, *DRAG_TABLES):
            if name in table:
                why = "belongs to a file without [[wheel]]; give it with each wheel there"
                raise InputError(f"gears.{name}", table[name], why)
        if not isinstance(wheels, list) or not wheels:
            raise InputError("wheel", wheels, "write each wheel as a table: [[wheel]]")
        values["wheels"] = wheels
        wanted = ["alpha", "omega"]
    drives = [name for name in DRIVES if name in values]
    missing = [name for name in wanted if name not in values and not (name == "alpha" and drives)]
    if missing:
        single = (
            "; without a second wheel write stages = 1 in [scene]"
            if set(missing) & set(WHEEL2)
            else ""
        )
        raise InputError("gears", missing, f"these keys are missing{single}")
    try:
        return Gears.driven(**values)
    except InputError as error:
        field = error.field
        if not field.startswith(("gears", "wheel")):
            field = f"gears.{field}"
        raise InputError(field, error.value, error.remedy) from None


def read_tolerance(table: Facts, gears: Gears) -> Facts | None:
    """The tolerances of the backlashes in the table of the gears, as the fields of a
    `rattle.scene.Tolerance`.

    `table`: ``[gears]``; its table ``tolerance`` has ``backlash1`` and ``backlash2``, the largest
    deviations of the full backlashes in mm (the number behind ± in a drawing), ``distribution`` and
    ``draw``. Returns: Half the deviations, in units of ``backlash1``; None if the table has no
    tolerances.
    """
    if "tolerance" not in table:
        return None
    given = table_in("gears.tolerance", table["tolerance"])
    check_keys("gears.tolerance", given, TOLERANCE_KEYS)
    widths: Facts = {}
    for i in (1, 2):
        name = f"gears.tolerance.backlash{i}"
        if f"backlash{i}" not in given:
            continue
        deviation = non_negative(name, given[f"backlash{i}"])
        if gears.wheels:
            raise InputError(name, deviation, "give it as backlash_tolerance in [[wheel]]")
        if i > len(gears.tree):
            raise InputError(name, deviation, "belongs to wheel 2, which these gears do not have")
        backlash = gears.tree[i - 1].backlash
        if deviation >= backlash:
            why = (
                f"must be below backlash{i} = {backlash:g} mm, or a gap could close; the unit is mm"
            )
            raise InputError(name, deviation, why)
        widths[f"c{i}_max"] = 0.5 * deviation / gears.backlash1
    return widths | {name: given[name] for name in ("distribution", "draw") if name in given}


def own_amplitude(gears: Facts, drive: object) -> Facts:
    """The table of the gears, with the amplitude of the first order, in mm or rad, where it gives
    none of its own."""
    if (
        isinstance(drive, list)
        and drive
        and isinstance(drive[0], Mapping)
        and not set(DRIVES) & set(gears)
    ):
        for name, own in AMPLITUDES.items():
            if name in drive[0]:
                return gears | {own: drive[0][name]}
    return gears


def read_drive(
    given: object, gears: Gears | None = None, radius: float | None = None
) -> tuple[Order, ...]:
    """The orders of a drive from the tables ``[[drive]]``.

    Each has ``order``, ``phase`` in radians or ``phase_degrees`` (0 if left out), and its amplitude
    relative to the excitation amplitude alpha of the scene, as ``amplitude``; with gears in place
    of it on the driver's pitch circle, in mm as ``amplitude_mm``, or the driver's in rad as
    ``amplitude_rad``, for which the gears give ``driver_radius``.
    """
    if not isinstance(given, list) or not all(isinstance(table, Mapping) for table in given):
        raise InputError("drive", given, "write each order as a table: [[drive]]")
    orders = []
    for table in given:
        check_keys("drive", table, ORDER_KEYS)
        if "order" not in table:
            raise InputError(
                "drive.order",
                None,
                "is missing: a whole number, how often the order repeats in a period",
            )
        names = [name for name in ("amplitude", *AMPLITUDES) if name in table]
        if len(names) != 1:
            ways = "amplitude (relative to alpha), amplitude_mm or amplitude_rad"
            raise InputError(
                "drive", names, f"give the amplitude of order {table['order']} once: {ways}"
            )
        amplitude = finite(f"drive.{names[0]}", table[names[0]])
        if names[0] != "amplitude":
            if gears is None:
                raise InputError(
                    f"drive.{names[0]}",
                    amplitude,
                    "needs [gears]; give amplitude, relative to alpha",
                )
            own = positive("gears.alpha, to which amplitudes are relative,", gears.alpha)
            if names[0] == "amplitude_rad":
                if radius is None:
                    raise InputError(
                        "gears.driver_radius", None, "give it, in mm, for a drive in rad"
                    )
                amplitude *= radius
            # as alpha is made: the gears' own is exactly 1
            amplitude = amplitude / gears.units.length / own
        orders.append(Order(table["order"], amplitude, _phase(table)))
    return tuple(orders)


def _phase(table: Facts) -> Any:
    """The phase of an order in radians."""
    if "phase_degrees" not in table:
        return table.get("phase", 0.0)
    degrees = table["phase_degrees"]
    if "phase" in table:
        raise InputError(
            "drive.phase_degrees",
            degrees,
            f"phase = {table['phase']} is given too; keep one of them",
        )
    return math.radians(check_range("drive.phase_degrees", degrees, 0.0, 360.0))


def read_measured(data: Facts) -> MeasuredDrive:
    """The measured drive of a scene file: its table ``[drive]`` with a ``file``."""
    table = data["drive"]
    gears = table_in("gears", data.get("gears", {}))
    if "order" in table:
        raise InputError("drive", table, "write each order as a table: [[drive]]")
    check_keys("drive", table, MEASURED_KEYS)
    if "file" not in table:
        raise InputError(
            "drive.file", None, "is missing; or write each order as a table: [[drive]]"
        )
    if not gears:
        raise InputError("drive.file", table["file"], "needs [gears], whose wheels it drives")
    if given := [name for name in DRIVES if name in gears]:
        raise InputError(
            f"gears.{given[0]}",
            gears[given[0]],
            "leave it out: the file of the drive has the amplitude",
        )
    return measure_drive(
        omega=gears.get("omega"), driver_radius=gears.get("driver_radius"), **table
    )


def take_measured(data: Facts) -> Facts:
    """The data of a scene with the orders of its measured drive, and their noise where it gives
    none of its own."""
    if not isinstance(data.get("drive"), Mapping):
        return data
    given = table_in("scene", data.get("scene", {}))
    measured = read_measured(data)
    gears = {"omega": measured.omega} | data["gears"] | {"amplitude": measured.amplitude}
    wheels = data.get("wheel")
    if not wheels and not set(SPEEDS) & set(gears):
        gears.pop("driver_radius", None)  # the amplitude is in mm now
    backlash = read_gears(gears, 1, wheels).units.length
    scene = {"sigma": measured.sigma_ratio * measured.amplitude / backlash} | given
    orders = [
        {"order": one.order, "amplitude": one.amplitude, "phase": one.phase}
        for one in measured.drive
    ]
    return data | {"gears": gears, "drive": orders, "scene": scene}


def find_measured(data: Facts, folder: Path) -> Facts:
    """The data of a scene file with the path of its measured drive from the folder of that file."""
    drive = data.get("drive")
    if not isinstance(drive, Mapping) or not isinstance(drive.get("file"), str):
        return data
    return data | {"drive": {**drive, "file": str(folder / drive["file"])}}


SMALLEST_RADIUS = 0.05  # mm
LEAST_BACKLASH = 1e-5  # of the radius
# kg/mm^3: inertia over the fifth power of the radius
LIGHTEST = 1e-9
HEAVIEST = 1e3
LEAST_DRAG = 0.003 * 9.81  # N/kg: of the weight of a kilogram
SWING = 0.5  # rad
SOUND = 5e6  # mm/s

VALUES_OF = {
    "beta": (("damping", "inertia"), (), ("omega",)),
    "gamma": (("torque", "radius", "inertia"), ("backlash",), ("omega",)),
    "mass": (("inertia", "radius"), ("inertia", "radius"), ()),
    "gap": (("backlash",), ("backlash",), ()),
    "ratio": (("parent_radius",), (), ()),
}
"""What each parameter of a wheel follows from: values of it, of the first wheel, and of all."""

UNIT = TEXTS["units"]
IN_SI = {
    "inertia": ("kg m^2", 1e6),
    "radius": ("m", 1e3),
    "parent_radius": ("m", 1e3),
    "backlash": ("m", 1e3),
    "torque": ("N m", 1e3),
}
SMALLER = {"amplitude": ("um", 1e-3), "amplitude_rad": ("degrees", math.pi / 180.0)}


def check_plausible(gears: Gears, table: Facts) -> None:
    """Refuse gears that cannot exist as given; the bounds are those of this module."""
    for number, wheel in enumerate(gears.tree, 1):
        _check_wheel(wheel, {kind: gears.name_of(number, kind) for kind in UNIT})
    drive = next((name for name in SMALLER if name in table), "alpha")
    radius = gears.tree[0].radius
    if max(gears.amplitude / radius, table.get("amplitude_rad", 0.0)) > SWING:
        why = (
            f"swings the driver's pitch circle by {gears.amplitude:g} mm, at"
            f" {gears.name_of(1, 'radius')} = {radius:g} mm"
        )
        raise _question(drive, table.get(drive, gears.alpha), why, SMALLER.get(drive))
    if gears.amplitude * gears.omega > SOUND:
        why = (
            f"moves the driver's pitch circle by {gears.amplitude:g} mm faster than sound in steel"
        )
        raise _question("omega", gears.omega, why, ("1/min", 2.0 * math.pi / 60.0))


def _check_wheel(wheel: LooseWheel, names: Mapping[str, str]) -> None:
    """Refuse a wheel that cannot exist; `names`: of its values, by what they are."""
    radius = wheel.radius
    backlash = wheel.backlash
    inertia = wheel.inertia
    size = f"{names['radius']} = {radius:g} mm"
    lightest = LIGHTEST * radius**5
    heaviest = HEAVIEST * radius**5
    is_tiny = radius < 1.0
    driven_at = radius if wheel.parent_radius is None else wheel.parent_radius
    mass = inertia / radius**2
    questions = (
        ("radius", radius < SMALLEST_RADIUS, "is smaller than any gear", None),
        ("parent_radius", driven_at < SMALLEST_RADIUS, "is smaller than any gear", None),
        (
            "radius",
            is_tiny and backlash >= radius,
            f"is no larger than {names['backlash']} = {backlash:g} mm",
            None,
        ),
        ("backlash", backlash >= radius, f"must be smaller than {size}", ("um", 1e-3)),
        (
            "backlash",
            backlash < LEAST_BACKLASH * radius,
            f"is less than {size} grows in one kelvin",
            None,
        ),
        (
            "inertia",
            inertia < lightest,
            f"is too little for a wheel of {size}, of whatever it is made",
            None,
        ),
        (
            "radius",
            is_tiny and inertia > heaviest,
            f"is too small for {names['inertia']} = {inertia:g} kg mm^2",
            None,
        ),
        (
            "inertia",
            inertia > heaviest,
            f"is too much for a wheel of {size}",
            ("g mm^2", 1e-3),
        ),
        (
            "torque",
            0.0 < wheel.torque < LEAST_DRAG * inertia / radius,
            f"is less than the bearing of a wheel of {mass:.2g} kg takes (0 leaves drag out)",
            None,
        ),
    )
    for kind, is_asked, why, likely in questions:
        if is_asked:
            raise _question(names[kind], getattr(wheel, kind), why, likely)


def of_gears(gears: Gears, error: InputError) -> InputError:
    """The refusal of a parameter that follows from gears, said of the gears.

    Returns: Names the field of gears that differs most from the paper's example; the same error for
    anything else.
    """
    kind = "mass" if error.field == "mu" else kind_of_value(error.field)
    if kind not in VALUES_OF:
        return error
    if gears.wheels:
        number = 1 + gears.wheel_names.index(error.field.split(".")[1])
    else:
        number = 2 if error.field == "mu" else int(error.field[-1])
    of_wheel, of_first, of_all = VALUES_OF[kind]
    # values of the gears and of the paper's example
    values = {}
    for at, kinds in ((number, of_wheel), (1, of_first)):
        example = DAT21.tree[min(at, 2) - 1]
        for one in kinds:
            usual = getattr(example, one) or example.radius  # its driver's is not known
            values[gears.name_of(at, one)] = getattr(gears.tree[at - 1], one), usual
    values |= {one: (getattr(gears, one), getattr(DAT21, one)) for one in of_all}
    sizes = {name: abs(math.log10(v / usual)) for name, (v, usual) in values.items() if v > 0.0}
    worst = max(sizes, key=lambda name: sizes[name])
    value = error.value if isinstance(error.value, int | float) else math.nan
    parts = ", ".join(f"{n} = {v:g} {UNIT[kind_of_value(n)]}" for n, (v, _) in values.items())
    why = f"with {parts} the model would have {error.field} = {value:.3g}, which {error.remedy}"
    given, usual = values[worst]
    likely = IN_SI.get(kind_of_value(worst))
    if likely is not None and given < 0.01 * usual:
        why += _conversion(worst, given, likely)
    return InputError(_field_of(worst), given, why)


def _question(
    name: str, value: float, why: str, likely: tuple[str, float] | None = None
) -> InputError:
    """The refusal of a value that no gears have, with the likely conversion."""
    likely = likely or IN_SI.get(kind_of_value(name))
    conversion = _conversion(name, value, likely) if likely else ""
    return InputError(
        _field_of(name),
        value,
        f"{why}{conversion}; if it is meant, write a [scene] without [gears]",
    )


def _field_of(name: str) -> str:
    """Where a value of gears stands in a file."""
    return name if name.startswith("wheel.") else f"gears.{name}"


def _conversion(name: str, value: float, likely: tuple[str, float]) -> str:
    unit, factor = likely
    here = UNIT[kind_of_value(name)]
    return f"; the unit is {here}: if {value:g} is in {unit}, write {value * factor:g}"
