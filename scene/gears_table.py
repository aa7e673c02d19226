"""The table ``[gears]`` of a scene file: gears, and their tolerances as a drawing gives them."""

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any

from rattle.scene.errors import InputError
from rattle.scene.gears import DRIVES, SPEEDS, WHEEL2, Gears
from rattle.scene.validate import check_keys, finite, non_negative

FIELDS = tuple(f.name for f in fields(Gears))
REQUIRED = tuple(f.name for f in fields(Gears) if f.default is MISSING)
OPTIONAL = (*DRIVES, "driver_radius", *SPEEDS, "tolerance")
TOLERANCE = ("backlash1", "backlash2", "distribution", "draw")


def read_gears(table: Mapping[str, Any], stages: object) -> Gears:
    """Gears from their table.

    `table`: The fields of Gears, which says what may be left out, and the arguments of `Gears.driven`. `stages`:
    Of the scene; for a single stage all values of wheel 2 may be left out.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> read_gears({k: v for k, v in vars(DAT21).items() if k[-1] != "2"}, 1).wheels
    1
    """
    check_keys("gears", table, (*FIELDS, *OPTIONAL))
    values = {name: value for name, value in table.items() if name != "tolerance"}
    drives = [name for name in DRIVES if name in values]
    wanted = REQUIRED if stages == 1 else sorted((*REQUIRED, *WHEEL2), key=FIELDS.index)
    missing = [name for name in wanted if name not in values and not (name == "alpha" and drives)]
    if missing:
        single = "; without a second wheel write stages = 1 in [scene]" if set(missing) & set(WHEEL2) else ""
        raise InputError("gears", missing, f"these keys are missing{single}")
    try:
        return Gears.driven(**values)
    except InputError as error:
        raise InputError(_full(error.field), error.value, error.remedy) from None


def read_tolerance(table: Mapping[str, Any], gears: Gears) -> dict[str, Any] | None:
    """The tolerances of the backlashes in the table of the gears, as the fields of a `rattle.scene.Tolerance`.

    `table`: ``[gears]``; its table ``tolerance`` has ``backlash1`` and ``backlash2``, the largest deviations of
    the full backlashes in mm (the number behind ± in a drawing), ``distribution`` and ``draw``. Returns: Half the
    deviations, in units of ``backlash1``; None if the table has no tolerances.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> read_tolerance({"tolerance": {"backlash1": 0.05, "draw": "contact"}}, DAT21)
    {'c1_max': 0.125, 'draw': 'contact'}
    """
    if "tolerance" not in table:
        return None
    given = table["tolerance"]
    if not isinstance(given, Mapping):
        raise InputError("gears.tolerance", given, "write it as a table: [gears.tolerance]")
    check_keys("gears.tolerance", given, TOLERANCE)
    found: dict[str, Any] = {}
    for i in (1, 2):
        name, backlash = f"gears.tolerance.backlash{i}", getattr(gears, f"backlash{i}")
        if f"backlash{i}" in given:
            deviation = non_negative(name, finite(name, given[f"backlash{i}"]))
            if backlash is None:
                raise InputError(name, deviation, "belongs to wheel 2, which these gears do not have")
            if deviation >= backlash:
                why = f"must be below backlash{i} = {backlash:g} mm, or a gap could close; the unit is mm"
                raise InputError(name, deviation, why)
            found[f"c{i}_max"] = 0.5 * deviation / gears.backlash1
    return found | {name: given[name] for name in ("distribution", "draw") if name in given}


def _full(field: str) -> str:
    return field if field.startswith("gears") else f"gears.{field}"
