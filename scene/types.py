"""What everything here works with: arrays, names of the state, and the numbers of a scene for
compiled code."""

from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Facts = dict[str, Any]
"""Plain data by name, as a table of a file holds it."""
Wheels = Any
"""An array of `WHEEL`, whose records have their fields as attributes."""


def state_names(wheels: int) -> tuple[str, ...]:
    """``x1, y1, x2, y2, ...``: displacement in each gap and its rate."""
    return tuple(f"{letter}{i}" for i in range(1, wheels + 1) for letter in "xy")


def section_names(wheels: int) -> tuple[str, ...]:
    """The section quantities: those of a path just before its own k-th impact (a Poincaré section
    at the impacts)."""
    return ("tau", "flight", *state_names(wheels))


MOST_WHEELS = 32  # of a gearbox
MOST_RESTITUTIONS = 16  # of a table of restitution
CUT = 2.0  # c_max in standard deviations of the normal distribution that is truncated there


class Orders(NamedTuple):
    """The driver's motion ``f(tau) = sum_j a_j sin(j tau + phi_j)`` for compiled code
    (docs/model.md section 1)."""

    order: Floats  # j, ascending; (orders,)
    gap: Ints  # j less the order before it, or 0 where that is too far; (orders,)
    odd: Floats  # odd, even: a_j cos phi_j and a_j sin phi_j, of sin j tau and cos j tau; (orders,)
    even: Floats
    highest: float  # the largest j
    most1: float  # most1, most2, most3: bounds of the first three derivatives of f
    most2: float
    most3: float
    # scratch of `rattle.scene.drive.begin_derivatives`: of one thread, so `Scene.constants` makes
    # a new one each time; (2, orders)
    waves: Floats


SINE: tuple[()] = ()
"""The drive ``f = sin tau``, in place of `Orders`: another type, so that its machine code knows no
sum."""


class WheelRecord(np.void):  # type: ignore[misc]  # numpy calls a base of it final
    """A record whose fields are attributes in Python too; those of numpy's own are twenty times as
    slow."""


class BodyRecord(np.void):  # type: ignore[misc]
    """As `WheelRecord`, of `BODY`."""


INTEGERS = ("parent", "drives", "rows", "root")


def _attribute(name: str) -> property:
    """A field of a record as an attribute."""

    def put(record: Any, value: float) -> None:
        record[name] = value

    return property(itemgetter(name), put)


def _record_of(kind: type[np.void], *names: str) -> np.dtype[np.void]:
    """The type of a record of numbers, with its fields as attributes."""
    formats = dict.fromkeys(names, "f8") | dict.fromkeys(INTEGERS, "i8")
    formats["pieces"] = f"({MOST_RESTITUTIONS + 1},5)f8"
    for name in names:
        setattr(kind, name, _attribute(name))
    return np.dtype((kind, [(name, formats[name]) for name in names]), align=True)


WHEEL = _record_of(
    WheelRecord,
    "parent",  # index of the wheel that it meshes with; -1 for the driver
    "drives",  # whether another wheel meshes with it
    "sign",  # of its own deviation in its gap: 1 or -1
    "ratio",  # k: radius of the parent there over the parent's own
    "turn",  # kappa: product of the ratios from the driver on
    "beta",
    "gamma",
    "stiffness",  # of a spring that holds it at the middle of its gap
    "fastest",  # bound of the rates at which it relaxes and swings
    "wall",  # half gap of the deterministic orbit
    "low",  # the same where it has two walls; infinite where it has one
    "size",  # a length that is small beside its motion is small beside this
    "epsilon",  # of slow impacts, the mean of it where it is random
    "variance",  # of epsilon, where it is drawn at each impact
    "slowing",  # 1 over the speed at which restitution begins to fall, or 0
    "rows",  # of its table of restitution; 0 where there is none
    "pieces",  # of that table, see `rattle.scene.wheel.restitution_pieces`
    "mass",  # at its own mesh, in units of that of wheel 1
    "share",  # of the parent, of the change of the rate at an impact
    "own",  # of a noise that does not modulate the drive: 1 on its wheel, or 0
    "alone",  # intensity over sigma of a noise that acts on it alone
    # The gap obeys y' = -beta y - stiffness x + coupling v_p + drag + (alpha + modulates sigma eta)
    # (second f'' + first f') + force sigma eta + shaking sigma eta_i, v_p the deviation of the
    # parent's speed
    "coupling",
    "drag",
    "second",
    "first",
    "force",
    "shaking",  # of the noises of its wheel and of its parent alone
    # bounds of |f'' + beta f'| and of its rate, beta of the wheel or of a parent wheel
    "modulation",
    "modulation_rate",
)
"""A loose wheel and its gap, for compiled code (docs/model.md section 2)."""

Bodies = Any
"""An array of `BODY`, one for each wheel."""
BODY = _record_of(
    BodyRecord,
    "root",  # first wheel of the body that it is locked into; -1: the driver
    "carry",  # its speed over that of the root
    # mass, beta, gamma, own, alone: of all that is locked below its mesh, as of one wheel
    "mass",
    "beta",
    "gamma",
    "own",
    "alone",
    "speed",  # u, at its own mesh
    "pull",  # acceleration by damping and drag of all that is locked below
    "motion",  # its acceleration, less the driver's
    "push",  # see `rattle.scene.sticking.contact_motion`
    # place, rate: deviations of its position and speed; kept: what its body keeps of them
    "place",
    "rate",
    "kept_place",
    "kept_rate",
    "offset",  # of its position in its body
    "share",  # of its speed in that of the first wheel of its body
)
"""What closed meshes make of a wheel, for compiled code (docs/model.md section 10)."""


class Constants(NamedTuple):
    """The numbers of a scene, as a named tuple for compiled code (dimensionless)."""

    alpha: float
    sigma: float
    wheels: Wheels  # of `WHEEL`, parents before their children; (wheels,)
    drive: Any = SINE  # `SINE` or `Orders`
    memory: float = 0.0  # correlation time of the noise; 0 for white noise
    modulates: float = 1.0  # 1 where the noise modulates the drive, 0 where it acts on a wheel
    pressing: float = 0.0  # the noise's force on wheels, where it is known for a while
