"""A scene as the tables of a file, written and read."""

from collections.abc import Sequence
from dataclasses import asdict

from rattle.scene import errors, gears_input
from rattle.scene.errors import InputError
from rattle.scene.gears import Gears
from rattle.scene.loose_wheel import as_table
from rattle.scene.noise import DRIVE_NOISE
from rattle.scene.parts import SINE_ALONE, Restitution, Start, Tolerance, Wheel
from rattle.scene.scene_checks import of_wheel
from rattle.scene.types import Facts
from rattle.scene.words import BODIES, PAIR

SHORT = {
    "beta1": 0.0,
    "gamma1": 0.0,
    "beta2": 0.0,
    "gamma2": 0.0,
    "mu": 0.0,
    "gap1": 0.5,
    "gap2": 0.5,
}
"""Fields of one or two wheels in a row, and what they are in a scene of `Wheel`, which has no use
for them."""
TABLES = ("gears", "wheel", "body", "scene", "drive")
"""Tables of a scene file."""
FREE_FIELDS = ("sigma", "tolerance", "start", "stages", "drive", "correlation_time", "noise")
"""Fields of a scene that gears do not fix."""


def write_tables(given: Facts, is_gears: bool) -> Facts:
    """The fields of a scene as plain data, as `Scene.to_dict` says; `is_gears`: of the scene."""
    values = given.copy()
    gears = values.pop("gears")
    orders = values.pop("drive")
    values["tolerance"] = values["tolerance"] and asdict(values["tolerance"])
    values["start"] = values["start"].table
    if given["wheels"]:
        values = {k: v for k, v in values.items() if k not in (*SHORT, "stages")}
        values["wheels"] = [_wheel_as_table(wheel) for wheel in given["wheels"]]
    else:
        del values["wheels"]
    for name in ("tolerance", "correlation_time"):
        if not values[name]:
            del values[name]
    if values["noise"] == DRIVE_NOISE:
        del values["noise"]
    elif isinstance(values["noise"], tuple):
        values["noise"] = dict(values["noise"])
    if values["bodies"] is not is_gears:  # as it is without being said
        del values["bodies"]
    drive = {} if orders == SINE_ALONE else {"drive": [asdict(one) for one in orders]}
    if gears is None:
        bodies = {} if is_gears or not given["wheels"] else {"body": values.pop("wheels")}
        return drive | {"scene": values} | bodies
    typed = gears.values
    wheels = [as_table(wheel) for wheel in typed.pop("wheels", ())]
    return (
        {"gears": typed}
        | ({"wheel": wheels} if wheels else {})
        | drive
        | {"scene": {k: v for k, v in values.items() if k in FREE_FIELDS}}
    )


def read_tables(data: Facts, names: Sequence[str]) -> tuple[Gears | None, Facts]:
    """The gears of a scene, if it is made from gears, and its other fields, from plain data as
    `Scene.from_dict` says; `names`: of all fields."""
    errors.check_keys("top level", errors.table_in("scene", data), TABLES)
    data = gears_input.take_measured(data)
    settings = errors.table_in("scene", data.get("scene", {}))
    if "drive" in settings:
        raise InputError(
            "scene.drive",
            settings["drive"],
            "write each order as a table [[drive]] beside [scene]",
        )
    for name, part in {"tolerance": Tolerance, "start": Start}.items():
        if name in settings:
            settings[name] = part(**errors.table_in(f"scene.{name}", settings[name], part))
    if "body" in data:
        if "gears" in data or "wheels" in settings:
            why = "stands in place of [gears] and [[scene.wheels]]; leave out one of them"
            raise InputError("body", data["body"], why)
        settings.setdefault("alpha", 0.0)
        settings.setdefault("bodies", True)
        settings["wheels"] = data["body"]
    if "wheels" in settings:
        place = "body" if "body" in data else "scene.wheels"
        settings["wheels"] = _read_wheels(place, settings["wheels"])
    if "gears" in data:
        table = gears_input.own_amplitude(
            errors.table_in("gears", data["gears"]), data.get("drive")
        )
        errors.check_keys("scene", settings, FREE_FIELDS)
        gears = gears_input.read_gears(table, settings.get("stages", 2), data.get("wheel"))
        if gears.wheels and "stages" in settings:
            why = "leave it out: there are as many as tables [[wheel]]"
            raise InputError("scene.stages", settings["stages"], why)
        drawn = gears_input.read_tolerance(table, gears)
        if drawn is not None:
            if "tolerance" in settings:
                raise InputError(
                    "gears.tolerance",
                    drawn,
                    "give it once: here in mm, or in [scene.tolerance]",
                )
            settings["tolerance"] = Tolerance(**drawn)
        if "drive" in data:
            radius = table.get("driver_radius")
            settings["drive"] = gears_input.read_drive(data["drive"], gears, radius)
        return gears, settings
    if "wheel" in data:
        why = "needs [gears]; wheels of a scene without gears are tables [[scene.wheels]]"
        raise InputError("wheel", data["wheel"], why)
    errors.check_keys("scene", settings, (name for name in names if name != "gears"))
    needed = ("alpha",) if "wheels" in settings else ("alpha", "epsilon", "beta1", "gamma1")
    if missing := [name for name in needed if name not in settings]:
        raise InputError("scene", missing, "these keys are missing")
    if "drive" in data:
        settings["drive"] = gears_input.read_drive(data["drive"])
    return None, settings


def _wheel_as_table(wheel: Wheel) -> Facts:
    """A wheel as plain data; what is as by default is left out."""
    table = as_table(wheel)
    if wheel.restitution is not None:
        law = asdict(wheel.restitution)
        table["restitution"] = {name: value for name, value in law.items() if value is not None}
    return table


def _read_wheels(name: str, tables: object) -> list[Wheel]:
    """Wheels or bodies from a list of their tables."""
    if not isinstance(tables, Sequence) or isinstance(tables, str):
        raise InputError(name, tables, f"write each as a table: [[{name}]]")
    return [_read_wheel(name, number, data) for number, data in enumerate(tables, 1)]


def _read_wheel(name: str, number: int, data: object) -> Wheel:
    """A wheel or body from its table, which an error names."""
    table = errors.table_in(name, data, Wheel)
    if "restitution" in table:
        law = errors.table_in(f"{name}.restitution", table["restitution"], Restitution)
    with (BODIES if name == "body" else PAIR).in_errors(), of_wheel(table.get("name") or number):
        if "restitution" in table:
            table["restitution"] = Restitution(**law)
        return Wheel(**table)
