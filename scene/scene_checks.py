"""What a scene says of all of its wheels together: its short form, and checks."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from rattle.scene.errors import InputError
from rattle.scene.parts import Order, Start, Tolerance, Wheel, wheel_labels
from rattle.scene.types import Facts


@contextmanager
def of_wheel(label: object) -> Iterator[None]:
    """Errors about a wheel say which."""
    try:
        yield
    except InputError as error:
        field = f"wheel.{label}.{error.field.removeprefix('wheel.')}"
        raise InputError(field, error.value, error.remedy) from None


def are_in_a_row(wheels: tuple[Wheel, ...], epsilon: float) -> bool:
    """Whether wheels are the paper's one or two stages: in a row, nameless, with one restitution
    and one radius each."""
    parents = [wheel.parent for wheel in wheels]
    plain = all(
        w.ratio == 1.0
        and w.epsilon in (None, epsilon)
        and not w.name
        and not w.one_sided
        and not w.stiffness
        and w.restitution is None
        for w in wheels
    )
    return plain and parents in ([0], [0, 1])


def short_form(wheels: tuple[Wheel, ...], tolerance: Tolerance | None) -> Facts:
    """The fields of one or two wheels in a row."""
    values: Facts = {"wheels": ()}
    for number, wheel in enumerate(wheels, 1):
        values |= {f"{name}{number}": getattr(wheel, name) for name in ("beta", "gamma", "gap")}
    if len(wheels) == 2:
        values["mu"] = wheels[1].mass / (1.0 + wheels[1].mass)
    if tolerance is not None and any(wheel.tolerance for wheel in wheels):
        widths: Facts = {f"c{i}_max": wheel.tolerance for i, wheel in enumerate(wheels, 1)}
        values["tolerance"] = replace(tolerance, **widths)
    return values


def sort_orders(drive: Any) -> tuple[Order, ...]:
    """The orders of a drive in ascending order, or say what is wrong with them."""
    try:
        orders = tuple(drive)
    except TypeError:
        raise InputError("drive", drive, "give a sequence of Order") from None
    for one in orders:
        if not isinstance(one, Order):
            raise InputError("drive", one, "give a sequence of Order")
    numbers = [one.order for one in orders]
    twice = [number for number in numbers if numbers.count(number) > 1]
    if twice:
        raise InputError(
            "drive.order",
            twice[0],
            "is given twice; give one amplitude and phase to each order",
        )
    if not any(one.amplitude for one in orders):
        raise InputError(
            "drive",
            orders,
            "has no order with an amplitude; for a driver at rest give alpha = 0",
        )
    return tuple(sorted(orders, key=lambda one: one.order))


def check_springs(wheels: Sequence[Wheel]) -> None:
    """Check that a spring holds only what meshes with the driver and drives nothing: its
    displacement is its own."""
    parents = [wheel.parent for wheel in wheels]
    for number, (label, wheel) in enumerate(zip(wheel_labels(wheels), wheels, strict=True), 1):
        if wheel.stiffness and (wheel.parent != 0 or number in parents):
            why = "a spring holds only what meshes with the driver and drives no other: 0 here"
            raise InputError(f"wheel.{label}.stiffness", wheel.stiffness, why)


def check_tolerance(tolerance: Any, wheels: Sequence[Wheel], is_short: bool) -> None:
    """Check the tolerance of a scene; `is_short`: whether it has the widths of all wheels."""
    if tolerance is None:
        return
    if not isinstance(tolerance, Tolerance):
        raise InputError("tolerance", tolerance, "give a Tolerance")
    for i, wheel in enumerate(wheels, 1):
        if is_short and wheel.tolerance >= wheel.gap:
            why = f"must be below gap{i} = {wheel.gap}, or a gap could close"
            raise InputError(f"tolerance.c{i}_max", wheel.tolerance, why)
    if not is_short and max(tolerance.c1_max, tolerance.c2_max) > 0.0:
        why = "of a scene of wheels is given with each: Wheel(tolerance=...)"
        raise InputError("tolerance.c1_max", tolerance.c1_max, why)


def check_start(start: Any, wheels: Sequence[Wheel]) -> None:
    """Check that a start lies between the walls of its scene."""
    stages = len(wheels)
    if not isinstance(start, Start):
        raise InputError("start", start, "give a Start")
    if start.mesh > stages:
        why = f"a scene of {stages} wheels has no mesh {start.mesh}"
        if stages == 1:
            why = "a single-stage scene has mesh 1 only"
        raise InputError("start.mesh", start.mesh, why)
    if len(start.values) < 2 * stages:
        raise InputError("start", start, f"give state = (x1, y1, ...) of {stages} wheels")
    for i, wheel in enumerate(wheels, 1):
        x, y = start.values[2 * i - 2 : 2 * i]
        gap = wheel.gap
        side = wheel.side_of(x)
        ahead = x if wheel.one_sided else abs(x)
        sides = "" if wheel.one_sided else "+-"
        if ahead > gap - wheel.tolerance and side == 0:
            inside = gap - wheel.tolerance
            where = f"must lie on a flank (+-{gap}) or inside +-{inside}"
            if wheel.one_sided:
                where = f"must lie on the wall ({gap}) or before it"
            raise InputError(f"start.x{i}", x, where)
        if start.mesh == i and side * y <= 0.0:
            needed = f"an impact at mesh {i} needs x{i} = {sides}{gap} and y{i} outward"
            raise InputError("start.mesh", start.mesh, f"{needed}; given x{i} = {x}, y{i} = {y}")
        if start.mesh == 0 and side * y >= 0.0 and side != 0:
            raise InputError(
                f"start.y{i}",
                y,
                f"a start in flight on a flank must move inward, or give mesh={i}",
            )
