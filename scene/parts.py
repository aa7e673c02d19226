"""Parts of a scene that are given as a whole: the tolerance of its gaps and the start of its
paths."""

import math
import re
from collections.abc import Iterable, Sequence, Sized
from copy import copy
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from statistics import NormalDist
from typing import Any, NamedTuple

from rattle.scene.errors import (
    InputError,
    check_range,
    choice,
    count,
    finite,
    nearest,
    non_negative,
    positive,
    suggesting,
    take_numbers,
    unit_interval,
)
from rattle.scene.text import as_call
from rattle.scene.types import CUT, MOST_RESTITUTIONS, MOST_WHEELS, Facts, state_names

_edge = math.exp(-0.5 * CUT**2) / math.sqrt(2.0 * math.pi)
UNIT_VARIANCE = {
    "fixed": 0.0,
    "uniform": 1.0 / 3.0,
    "normal": (1.0 - 2.0 * CUT * _edge / math.erf(CUT / math.sqrt(2.0))) / CUT**2,
}
"""Variance of c for ``c_max = 1``, by distribution."""
DRAWS = ("path", "contact")

LEAST_SIZE = 1e-30
"""Smallest size of a parameter that is not 0: its sixth moments do not underflow."""
GAPS = (1e-9, 1e6)
LARGEST_ORDER = 1000  # order of a drive
LARGEST_PHASE = 6.2832  # largest phase of an order: 2 pi, also as people round it
MEMORY_RANGE = (1e-4, 1e6)  # correlation times of noise that is not white
# largest speed and time of a start; a float resolves 1e-4 at a time of 1e12
LARGEST_SPEED = 1e6
LARGEST_TIME = 1e12


WIDEST = 3.0  # sds from its mean at which a random restitution is cut by default
LARGEST_BETA = 1e4
LARGEST_STIFFNESS = 1e8  # the square of the largest beta
LARGEST_RATE = 1e6  # of excitation, drag and noise
MASSES = (1e-6, 1e6)  # of a wheel over that of wheel 1
RATIOS = (1e-3, 1e3)
DRIVERS_NAME = "driver"
"""What wheels may call the driver, which has the number 0."""
# as a part of a name of a value (wheel.third.torque) and in the label of a column
WHEEL_NAME = re.compile(r"[^\W\d_][\w-]{0,23}")


@suggesting
@dataclass(frozen=True, kw_only=True)
class Restitution:
    """How the restitution of a contact departs from its `epsilon` (docs/model.md section 3,
    dimensionless).

    ``epsilon(w) = e (1 + |w| / speed)^(-1/4)`` at the impact speed w: that of slow impacts, and the
    power law of a plastic contact for fast ones (Johnson, Contact Mechanics, 1985, section 11.5).
    Or a table says how it falls: a monotone cubic between its rows, constant beyond both ends.
    e is `epsilon`, or random: normal with mean `epsilon`, cut at `least` and `most`.

    Parameters
    ----------
    sd : float
        Standard deviation of e before it is cut, 0 to 1.
    least, most : float, optional
        Where its distribution is cut, 0 to 1; by default 3 sds from `epsilon`, and not beyond 0
        and 1.
    draw : {"contact", "path"}
        Whether each impact draws, or each path once for all of its impacts.
    speed : float, optional
        Impact speed at which restitution is 16 % below that of slow impacts, 1e-9 to 1e6; left
        out, it does not depend on speed.
    table : sequence of pairs, optional
        In place of `speed`, 2 to 16 rows of an impact speed and the restitution there: speeds rise
        from row to row, 1e-9 to 1e6, and restitutions, 1 to 0, do not.  `epsilon` of the contact is
        then by default that of the first row; with another all rows are multiplied, so that slow
        impacts have it.

    Raises
    ------
    InputError
        If a value is not in its range, or a name is unknown.

    Examples
    --------
    >>> Restitution(sd=0.02, least=0.84, most=1.0).draw
    'contact'
    >>> Wheel(restitution=Restitution(table=[(0.1, 0.9), (0.5, 0.8), (2.0, 0.6)])).epsilon
    0.9
    """

    sd: float = 0.0
    least: float | None = None
    most: float | None = None
    draw: str = "contact"
    speed: float | None = None
    table: Sequence[tuple[float, float]] | None = None

    def __post_init__(self) -> None:
        for name in ("sd", "least", "most", "speed"):
            value = getattr(self, name)
            if value is not None and name != "speed":
                unit_interval(f"restitution.{name}", value)
            if value is not None:
                take_numbers(self, "restitution", name)
        choice("restitution.draw", self.draw, DRAWS)
        if self.speed is not None:
            positive("restitution.speed", self.speed, *GAPS)
        if self.table is None:
            return
        if self.speed is not None:
            raise InputError("restitution.speed", self.speed, "give it, or a table; not both")
        object.__setattr__(self, "table", _read_rows(self.table))

    def scaled(self, factor: float) -> "Restitution":
        """The same in another unit of length: old unit over the new one."""
        changed = copy(self)
        object.__setattr__(changed, "speed", self.speed and factor * self.speed)
        rows = self.table and tuple((factor * speed, value) for speed, value in self.table)
        object.__setattr__(changed, "table", rows)
        return changed

    def of(self, epsilon: float) -> "RestitutionLaw":
        """The law of a contact with a given `epsilon`."""
        least = max(epsilon - WIDEST * self.sd, 0.0) if self.least is None else self.least
        most = min(epsilon + WIDEST * self.sd, 1.0) if self.most is None else self.most
        if self.sd and not least < most:
            why = f"must be below most = {most}, and the part between them holds epsilon"
            raise InputError("restitution.least", least, why)
        if self.sd and not least <= epsilon <= most:
            why = f"epsilon = {epsilon} must lie between least = {least} and most = {most}"
            raise InputError("restitution", (least, most), why)
        table = tuple(self.table or ())
        speed = table[0][0] if table else self.speed
        slowing = 0.0 if speed is None else 1.0 / speed
        return RestitutionLaw(epsilon, self.sd, (least, most), self.draw, slowing, table)


def _read_rows(given: Iterable[Any]) -> tuple[tuple[float, float], ...]:
    """The rows of a table of restitution, checked."""
    name = "restitution.table"
    try:
        rows = [tuple(row) for row in given]
    except TypeError:
        rows = []
    if not 2 <= len(rows) <= MOST_RESTITUTIONS or any(len(row) != 2 for row in rows):
        raise InputError(
            name, given, f"give 2 to {MOST_RESTITUTIONS} rows [impact speed, restitution]"
        )
    table = []
    for number, row in enumerate(rows, 1):
        place = f"{name}: speed of row {number}"
        speed = positive(place, finite(place, row[0]), *GAPS)
        place = f"{name}: restitution of row {number}"
        table.append((speed, unit_interval(place, finite(place, row[1]))))
    for (slower, before), (faster, after) in pairwise(table):
        if faster <= slower:
            raise InputError(name, faster, f"must be above {slower:g}: speeds in rising order")
        if after > before:
            why = f"must be at most {before:g}: restitution does not rise with the speed"
            raise InputError(name, after, why)
    if table[0][1] == 0.0:
        why = "must be above 0 in the first row; for none at any speed give epsilon = 0 alone"
        raise InputError(name, 0.0, why)
    return tuple(table)


class RestitutionLaw(NamedTuple):
    """A restitution as the model has it; `Restitution` says what its parts are."""

    value: float  # of slow impacts, before the distribution is cut
    sd: float
    ends: tuple[float, float]
    draw: str
    # 1 over its speed, or over that of the first row of its table; 0 if it does not depend on that
    slowing: float
    table: tuple[tuple[float, float], ...]  # impact speeds and restitutions, or empty

    @property
    def moments(self) -> tuple[float, float]:
        """Mean and variance of the restitution of slow impacts: a normal, cut at both ends."""
        if self.sd == 0.0:
            return self.value, 0.0
        unit = NormalDist()
        low, high = ((end - self.value) / self.sd for end in self.ends)
        inside = unit.cdf(high) - unit.cdf(low)
        shift = (unit.pdf(low) - unit.pdf(high)) / inside
        spread = 1.0 + (low * unit.pdf(low) - high * unit.pdf(high)) / inside - shift * shift
        return self.value + self.sd * shift, self.sd * self.sd * spread


@suggesting
@dataclass(frozen=True, kw_only=True)
class Wheel:
    """A loose wheel of a gearbox and its mesh with its parent, or any other body and its contact
    (docs/model.md section 2, dimensionless).

    Parameters
    ----------
    beta : float
        Damping ratio in flight, 0 to 1e4.
    gamma : float
        Constant drag, 0 or 1e-30 to 1e6.
    gap : float
        Half gap at its mesh, 1e-9 to 1e6; that of a wall that stands alone may be 0.
    mass : float
        ``I / R^2`` at its mesh over that of wheel 1, 1e-6 to 1e6.
    parent : int or str
        Number or name of the wheel that it meshes with, which stands before it; 0 is the driver.
    ratio : float
        Radius of the parent at this mesh over the parent's own radius (at the driver: over its
        radius at wheel 1), 1e-3 to 1e3.
    epsilon : float, optional
        Restitution at its mesh, 0 to 1; by default that of the first row of its table of
        restitution, or of the scene.
    stiffness : float
        Of a spring that holds it at the middle of its gap, ``x'' = ... - stiffness x``: 0 to 1e8.
        It then meshes with the driver and drives no other.
    one_sided : bool
        Whether there is one wall only, at ``+gap``: that of a ball above its floor.  Drag pulls
        towards it.
    restitution : Restitution, optional
        How its restitution departs from `epsilon`: random, or falling with the impact speed.
    tolerance : float
        Largest deviation of its half gap, below `gap`; how it is drawn is in the scene's
        `Tolerance`.
    name : str
        What tables and figures call it; by default its number.  A letter, and up to 23 letters,
        digits, ``-`` or ``_`` after it.

    Raises
    ------
    InputError
        If a value is not a finite number in its range.

    Examples
    --------
    >>> Wheel(beta=0.1, gamma=0.3, name="third").mass
    1.0
    """

    beta: float = 0.0
    gamma: float = 0.0
    gap: float = 0.5
    mass: float = 1.0
    parent: int | str = 0
    ratio: float = 1.0
    epsilon: float | None = None
    tolerance: float = 0.0
    name: str = ""
    stiffness: float = 0.0
    one_sided: bool = False
    restitution: Restitution | None = None

    def __post_init__(self) -> None:
        names = ("beta", "gamma", "gap", "mass", "ratio", "tolerance", "stiffness")
        take_numbers(self, "wheel", *names)
        non_negative("wheel.beta", self.beta, most=LARGEST_BETA)
        non_negative("wheel.gamma", self.gamma, LEAST_SIZE, LARGEST_RATE)
        non_negative("wheel.stiffness", self.stiffness, LEAST_SIZE, LARGEST_STIFFNESS)
        in_middle = self.one_sided is True and self.gap == 0.0
        if not in_middle:
            positive("wheel.gap", self.gap, *GAPS)
        positive("wheel.mass", self.mass, *MASSES)
        positive("wheel.ratio", self.ratio, *RATIOS)
        non_negative("wheel.tolerance", self.tolerance, LEAST_SIZE, GAPS[1])
        if self.tolerance and self.tolerance >= self.gap:
            why = f"must be below gap = {self.gap}, or a gap could close"
            raise InputError("wheel.tolerance", self.tolerance, why)
        if not isinstance(self.one_sided, bool):
            raise InputError("wheel.one_sided", self.one_sided, "write true or false")
        if self.one_sided and self.tolerance:
            why = "a wall that stands alone has no tolerance: start paths from another place"
            raise InputError("wheel.tolerance", self.tolerance, why)
        if self.epsilon is not None:
            take_numbers(self, "wheel", "epsilon")
            unit_interval("wheel.epsilon", self.epsilon)

        if not isinstance(self.restitution, Restitution | None):
            raise InputError("wheel.restitution", self.restitution, "give a Restitution")
        if self.restitution and self.restitution.table and self.epsilon is None:
            object.__setattr__(self, "epsilon", self.restitution.table[0][1])

    @cached_property
    def law(self) -> RestitutionLaw:
        """Its law of restitution, of a wheel that has an `epsilon`; refuses one that does not fit
        it."""
        return (self.restitution or Restitution()).of(self.epsilon or 0.0)

    @property
    def with_mean_restitution(self) -> "Wheel":
        """The same with the mean of its restitution wherever that is random."""
        law = self.restitution and replace(self.restitution, sd=0.0, least=None, most=None)
        return replace(self, epsilon=self.law.moments[0], restitution=law)

    @property
    def low_gap(self) -> float:
        """Distance of its lower wall from the middle: `gap`, or infinite where there is none."""
        return math.inf if self.one_sided else self.gap

    def side_of(self, x: float) -> int:
        """The side of the nominal flank on which a displacement lies, 1 or -1; 0 off both."""
        if x == self.gap:
            return 1
        return -1 if x == -self.low_gap else 0


def fields_of(part: Any, *left_out: str) -> Facts:
    """Fields of a dataclass by name, as they are."""
    return {f.name: getattr(part, f.name) for f in fields(part) if f.name not in left_out}


def are_given(wheels: object) -> bool:
    """Whether wheels are given, rightly or wrongly."""
    return not isinstance(wheels, Sized) or len(wheels) > 0


def wheel_labels(wheels: Sequence[Any]) -> tuple[str, ...]:
    """What a person calls each of some wheels: its name, or its number."""
    return tuple(wheel.name or str(number) for number, wheel in enumerate(wheels, 1))


def find_parents(wheels: Sequence[Any], field: str) -> tuple[int, ...]:
    """The number of each wheel's parent, 0 for the driver; checks the names of the wheels.

    `field`: of a wheel, the number or the name of its parent.
    """
    if len(wheels) > MOST_WHEELS:
        raise InputError("wheels", len(wheels), f"at most {MOST_WHEELS} wheels")
    labels = wheel_labels(wheels)
    numbers = {DRIVERS_NAME: 0}
    for number, wheel in enumerate(wheels, 1):
        place = f"wheel.{number}.name"
        if wheel.name == "":
            continue
        if not isinstance(wheel.name, str) or not WHEEL_NAME.fullmatch(wheel.name):
            why = "write a letter, and up to 23 letters, digits, - or _ after it"
            raise InputError(place, wheel.name, why)
        if wheel.name in numbers:
            why = (
                "is the name of the driver"
                if wheel.name == DRIVERS_NAME
                else "two wheels have this name"
            )
            raise InputError(place, wheel.name, f"{why}; rename one")
        numbers[wheel.name] = number
    parents = []
    for number, wheel in enumerate(wheels, 1):
        place = f"wheel.{labels[number - 1]}.{field}"
        given = getattr(wheel, field)
        if isinstance(given, str) and given not in numbers:
            why = f"no wheel has this name; {nearest(given, numbers)}"
            raise InputError(place, given, why)
        parent = numbers[given] if isinstance(given, str) else count(place, given, least=0)
        if parent > len(wheels):
            raise InputError(place, given, f"there are {len(wheels)} wheels; 0 is the driver")
        if parent >= number:
            why = (
                f"wheel {labels[number - 1]} must stand after the wheel that it meshes with, and no"
                " wheel may mesh with itself in a circle"
            )
            raise InputError(place, given, why)
        parents.append(parent)
    return tuple(parents)


@suggesting
@dataclass(frozen=True)
class Tolerance:
    """Random part ``c_i`` of the half gaps ``g_i + c_i`` (docs/model.md section 4, dimensionless).

    Parameters
    ----------
    c1_max, c2_max : float
        Largest deviation at each mesh; below the half gap, and 0 or at least 1e-30.
    distribution : {"uniform", "fixed", "normal"}
        ``fixed`` puts every gap at ``+c_max``; ``uniform`` on ``[-c_max, c_max]``; ``normal`` with
        standard deviation ``c_max / 2``, truncated at ``c_max``.
    draw : {"path", "contact"}
        One draw per gear set (path), or a fresh one per contact: a flank's ``c`` is drawn anew when
        the opposite flank is struck, so that no state is ever outside its wall.

    Raises
    ------
    InputError
        If a deviation is negative or out of range, or a name is unknown.

    Examples
    --------
    >>> Tolerance(0.01, 0.02, distribution="normal").draw
    'path'
    """

    c1_max: float = 0.0
    c2_max: float = 0.0
    distribution: str = "uniform"
    draw: str = "path"

    def __post_init__(self) -> None:
        for name in ("c1_max", "c2_max"):
            take_numbers(self, "tolerance", name)
            non_negative(f"tolerance.{name}", getattr(self, name), LEAST_SIZE, GAPS[1])
        choice("tolerance.distribution", self.distribution, UNIT_VARIANCE)
        choice("tolerance.draw", self.draw, DRAWS)

    @property
    def differs_by_set(self) -> bool:
        """Whether every gear set has backlashes of its own, for good."""
        drawn_once = self.draw == "path" and self.distribution != "fixed"
        return drawn_once and max(self.c1_max, self.c2_max) > 0.0

    @property
    def variances(self) -> tuple[float, float]:
        """Variances of ``c_1`` and ``c_2``, a pair of floats."""
        return (
            self.c1_max**2 * UNIT_VARIANCE[self.distribution],
            self.c2_max**2 * UNIT_VARIANCE[self.distribution],
        )


@suggesting
@dataclass(frozen=True)
class Order:
    """One order of the driver's motion, ``amplitude sin(order tau + phase)`` (docs/model.md section
    1).

    Parameters
    ----------
    order : int
        How often it repeats in a period of the excitation: 1 to 1000.
    amplitude : float
        Relative to the excitation amplitude ``alpha`` of the scene, 0 or between 1e-30 and 1e6 in
        size.
    phase : float
        At ``tau = 0``, in radians, up to 2 pi in size.

    Raises
    ------
    InputError
        If the order is no positive whole number, or a value is not a finite number in its range.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> engine = Scene.from_gears(DAT21, drive=(Order(1), Order(2, 0.4, 0.3), Order(4, 0.1, -1.0)))
    >>> [order.amplitude for order in engine.drive]
    [1.0, 0.4, 0.1]
    """

    order: int
    amplitude: float = 1.0
    phase: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "order", count("drive.order", self.order, least=1, most=LARGEST_ORDER)
        )
        take_numbers(self, "drive", "amplitude", "phase")
        check_range("drive.amplitude", self.amplitude, LEAST_SIZE, GAPS[1])
        if abs(self.phase) > LARGEST_PHASE:
            degrees = f"if it is in degrees, write {math.radians(self.phase):.6g}"
            why = (
                f"is in radians, from -2 pi to 2 pi; {degrees}, or phase_degrees = {self.phase:g}"
                " in a scene file"
            )
            raise InputError("drive.phase", self.phase, why)


SINE_ALONE = (Order(1),)
"""The drive ``sin tau``."""
TWO_STATES = state_names(2)
"""Fields of a start for the state of up to two wheels."""


@suggesting
@dataclass(frozen=True)
class Start:
    """The state from which every path starts (dimensionless).

    Parameters
    ----------
    tau : float
        Time of the start, up to 1e12 in size; the excitation is ``alpha f(tau)``, ``f = sin tau``
        where the scene gives no other drive.
    x1, y1, x2, y2 : float
        Relative displacement and velocity of both stages; velocities up to 1e6 in size.
    mesh : int
        The mesh that is struck at once (the state is the one just before that impact), or 0 for a
        start in flight.  The impact of the start is number 0; tables count from the next one.
    state : sequence of float
        ``(x1, y1, x2, y2, x3, y3, ...)`` of all wheels, in place of the four numbers: for more
        than two wheels.

    Raises
    ------
    InputError
        If a value is not a finite number in its range.

    Examples
    --------
    >>> Start(0.0, 0.5, 2.0, 0.5, 2.0, mesh=1)      # the paper's start
    Start(tau=0.0, x1=0.5, y1=2.0, x2=0.5, y2=2.0, mesh=1)
    """

    tau: float = 0.0
    x1: float = 0.0
    y1: float = 0.0
    x2: float = 0.0
    y2: float = 0.0
    mesh: int = 0
    state: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        take_numbers(self, "start", "tau", *TWO_STATES)
        check_range("start.tau", self.tau, 0.0, LARGEST_TIME)
        self._take_state()
        for name, value in zip(state_names(len(self.values) // 2), self.values, strict=True):
            most = GAPS[1] if name.startswith("x") else LARGEST_SPEED
            check_range(f"start.{name}", value, 0.0, most)
        mesh = count("start.mesh", self.mesh, least=0, most=MOST_WHEELS)
        object.__setattr__(self, "mesh", mesh)

    def __repr__(self) -> str:
        return as_call("Start", self.table)

    @property
    def table(self) -> Facts:
        """Its fields, without those that it has no use for."""
        unused = TWO_STATES if self.state else ("state",)
        return fields_of(self, *unused)

    def _take_state(self) -> None:
        """Check a state that is given as a whole; one of two wheels becomes the four numbers."""
        if not isinstance(self.state, Sequence) or isinstance(self.state, str):
            raise InputError("start.state", self.state, "give x and y of each wheel in turn")
        if not self.state:
            return
        given = [finite("start.state", value) for value in self.state]
        if len(given) % 2 or len(given) > 2 * MOST_WHEELS:
            raise InputError("start.state", self.state, "give x and y of each wheel in turn")
        if any((self.x1, self.y1, self.x2, self.y2)):
            raise InputError("start.state", self.state, "give it, or x1, y1, x2 and y2")
        short = len(given) <= 4
        object.__setattr__(self, "state", () if short else tuple(given))
        if short:
            vars(self).update(zip(TWO_STATES, given, strict=False))

    @property
    def values(self) -> tuple[float, ...]:
        """``(x1, y1, x2, y2, ...)``."""
        return self.state or (self.x1, self.y1, self.x2, self.y2)


def move_to_flanks(start: Start, before: Sequence[float], after: Sequence[float]) -> Start:
    """The start of a scene whose half gaps at both meshes are others: what lies on a nominal flank
    stays on it."""
    values = list(start.values)
    for i, (old, new) in enumerate(zip(before, after, strict=True)):
        x = values[2 * i]
        values[2 * i] = math.copysign(finite(f"gap{i + 1}", new), x) if abs(x) == old else x
    if start.state:
        return replace(start, state=tuple(values))
    return replace(start, x1=values[0], x2=values[2])
