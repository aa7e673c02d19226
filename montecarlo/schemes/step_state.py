"""State of a path within a step, shared by all schemes."""

from typing import Any, NamedTuple

from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.noise.philox import Key, Word
from rattle.scene import Constants, Floats, Ints
from rattle.scene.compiled import inline, lean_internal
from rattle.scene.types import Bodies, Wheels

MOST_IN_A_STEP = 64
"""Most impacts of a path in a step, of three wheels or more for each of them; then the struck mesh
stays closed to the end of the step, which is counted."""

SPLITS = Word(1 << 16)
"""Indices of random numbers reserved for the splits of one step."""

MOST_PARTS = 200
"""Most parts of a step that wait at once: the depth of the stack of cuts of an exact flight."""

MOST_TERMS = 60  # of the Taylor series of a part of a step
INCREMENT = MOST_TERMS + 1
AREA = MOST_TERMS + 2
"""Columns beside the series of a wheel, of the noise that acts on it alone."""
TERMS_AND_NOISE = MOST_TERMS + 3
TOGETHER = 1e-12
"""Time in which impacts at two meshes count as one instant, and the first comes first: what a
flight's rounding adds."""


class Progress(NamedTuple):
    """Where a path is within a step, beside its state: the impact that is due there, and what is
    left of the step."""

    code: int  # ``mesh * side`` of an impact that is due at this very state, or 0
    tau: float  # time
    left: float  # time to the end of the step
    noise: Noise  # of the time left


@inline
def at_end(at: Progress) -> Progress:
    """A path that has come to the end of the step."""
    return Progress(0, at.tau + at.left, 0.0, Noise(0.0, 0.0))


class Quiet(NamedTuple):
    """Down to which speed the motion of a mesh at its wall is followed impact by impact.

    The defaults follow all of it.
    """

    speed: float = 0.0  # up to which a mesh at its wall may be held closed
    slow: float = 0.0  # speed of impacts that noise must not make at a closed mesh
    tail: float = 0.0  # exponent of their distribution, `rattle.montecarlo.schemes.quiet`
    most: float = 0.0  # largest rate of such impacts at which a mesh is held closed
    relaxed: float = 0.0  # times of relaxation that a mesh must stay closed


class Scratch(NamedTuple):
    """Buffers for one path within a step, and for what a step has in common for all."""

    # number of wheels: a constant of kernels for one and two, whose loops it unrolls
    wheels: int
    shaken: bool  # whether noises act on single wheels alone; none where wheels are known
    # state, end: present state, and that at the end of a part of a step; (2 wheels,)
    state: Floats
    end: Floats
    walls: Floats  # distances of the flanks +1, -1, +2, -2, ... from their middle; (2 wheels,)
    whole: Floats  # state at the end of the whole step, if no wall is met; (2 wheels,)
    # derivatives in the unit of a flight's time: of what forces a gap by the drive's velocity and
    # acceleration, of the deviation of each wheel's speed, and zeros; beside those
    # of a wheel, increment and area of the noise on it alone; (3 + wheels, TERMS_AND_NOISE)
    series: Floats
    # parts of the step that are still ahead: length, increment and area of the common noise, and
    # those of each wheel alone; (MOST_PARTS, 3 + 2 wheels)
    ahead: Floats
    sides: Ints  # sides on which meshes are closed; 0 for an open mesh; (wheels,)
    # energies of the motions that end when meshes are closed, and those per unit of time that
    # impacts by noise would lose there; (2, wheels)
    unfollowed: Floats
    forcing: Floats  # of a step of all lanes, see the schemes; (wheels, FORCING)
    speeds: (
        Floats  # deviations of the speeds of wheels between others, of all lanes; (wheels, lanes)
    )
    # where meshes are closed: what they make of the wheels, by wheel; sets of meshes, see the rows
    # below; and the wheels, state, end and walls of the bodies that they leave
    bodies: Bodies
    choices: Ints  # (CHOICES, wheels)
    wheels_beside: Wheels
    beside: Floats  # (3, 2 wheels)
    # of noises that act on single wheels alone: their intensities, (wheels,); increment and area
    # of each in the time left, (2 wheels,); effect of unit normals for both on all gaps in a step,
    # (wheels, 2, 2 wheels)
    intensity: Floats
    alone: Floats
    effects: Floats


# rows of `Scratch.choices`: sides on which meshes touch their walls, on which they stick, on which
# they stick and are not shaken, on which they are held, and on which they are held together
TOUCHING, STICKING, UNSHAKEN, HELD, GROUP = range(5)
TOP = 5  # the wheel at the driver behind which each wheel is
FREE = 6  # the open meshes
LEFT = 7  # sides of the closed meshes that left `Scratch.wheels_beside`
CHOICES = 8  # number of these rows

FORCING = 12
"""Most numbers that are the same for every path, of each gap in a step."""
MARGIN = 10  # that of them which is the margin of the walls in an exact step


class Inside(NamedTuple):
    """A step of a path, within which it is followed from impact to impact."""

    c: Constants  # of the scene
    key: Key  # key, path, step, level: of the random numbers that split its noise
    path: Word
    step: int  # number of the step, in finest steps
    level: int  # 0 for dt, 1 for 2 dt, ...
    known: bool  # whether `whole` is where this flight ends: nothing has happened in the step yet
    closed: bool  # whether some meshes are closed, those of `Scratch.sides`
    scratch: Scratch


@inline
def copy_state(to: Any, s: Any) -> None:
    """Copy a state into another one."""
    for i in range(to.size):
        to[i] = s[i]


@inline
def due_side(code: int) -> int:
    """The side of an impact."""
    return 1 if code > 0 else -1


@lean_internal
def clip(s: Floats, walls: Floats) -> None:
    """Clip the displacements of a state to the walls, in place."""
    for i in range(s.size // 2):
        s[2 * i] = min(max(s[2 * i], -walls[2 * i + 1]), walls[2 * i])


@inline
def put_on_wall(s: Floats, code: int, walls: Floats) -> None:
    """Put the gap of an impact ``mesh * side`` on that wall, in place."""
    i = abs(code) - 1
    high = walls[2 * i]  # both are read, for which one it is cannot be predicted
    low = walls[2 * i + 1]
    s[2 * i] = high if code > 0 else -low


@inline
def parent_deviation(c: Constants, s: Floats, i: int) -> float:
    """Deviation of the speed of the wheel that gap i is a gap to; 0 for the driver."""
    total = 0.0
    carry = 1.0
    j = c.wheels[i].parent
    while j >= 0:
        wheel = c.wheels[j]
        total += carry * wheel.sign * s[2 * j + 1]
        carry *= wheel.ratio
        j = wheel.parent
    return total
