"""State of a path within a step, shared by all schemes."""

from typing import NamedTuple

from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.noise.philox import Key, Word
from rattle.scene import Constants, Floats
from rattle.scene.compiled import inline

MOST_IN_A_STEP = 64
"""Most impacts of a path in a step; then the struck mesh stays closed to the end of the step, which
is counted."""

SPLITS = Word(1 << 16)
"""Indices of random numbers reserved for the splits of one step."""

MOST_PARTS = 200
"""Most parts of a step that wait at once: the depth of the stack of cuts of an exact flight."""

TOGETHER = 1e-12
"""Time in which impacts at both meshes count as one instant, and mesh 1 comes first: what a
flight's rounding adds."""


State = tuple[float, float, float, float]
"""``x1, y1, x2, y2``."""


class Walls(NamedTuple):
    """Distances of a path's four flanks from the middle of their gap."""

    high1: float  # high1, low1, high2, low2: flanks +1, -1, +2, -2; all positive
    low1: float
    high2: float
    low2: float


class Progress(NamedTuple):
    """A path within a step: its state, the impact that is due there, and what is left of the
    step."""

    code: int  # ``mesh * side`` of an impact that is due at this very state, or 0
    tau: float  # time
    left: float  # time to the end of the step
    noise: Noise  # of the time left
    state: State


class Quiet(NamedTuple):
    """Down to which speed the motion of a mesh at its wall is followed impact by impact.

    The defaults follow all of it.
    """

    speed: float = 0.0  # up to which a mesh at its wall may be held closed
    slow: float = 0.0  # speed of impacts that noise must not make at a closed mesh
    tail: float = 0.0  # exponent of their distribution, `rattle.montecarlo.schemes.quiet`
    most: float = 0.0  # largest rate of such impacts at which a mesh is held closed
    relaxed: float = 0.0  # times of relaxation that a mesh must stay closed


class Hold(NamedTuple):
    """Meshes that are held closed in what is left of a step, and what is not followed there."""

    first: int  # first, second: sides on which mesh 1 and mesh 2 are closed; 0 for an open mesh
    second: int
    # ended1, ended2: energies of the motions at both meshes that end when they are closed
    ended1: float
    ended2: float
    # power1, power2: energies per unit of time that impacts by noise would lose
    power1: float
    power2: float
    above: float  # bound on the rate of impacts that are not slow


class Inside(NamedTuple):
    """A step of a path, within which it is followed from impact to impact."""

    c: Constants  # of the scene
    key: Key  # key, path, step, level: of the random numbers that split its noise
    path: Word
    step: int  # number of the step, in finest steps
    level: int  # 0 for dt, 1 for 2 dt, ...
    whole: State  # at the end of the whole step, if no wall is met
    known: bool  # whether that is where this flight ends: nothing has happened in the step so far
    hold: Hold  # meshes that are closed in this flight
    # scratch of `rattle.montecarlo.schemes.exact_flight.advance_exactly`; (MOST_PARTS, 3)
    ahead: Floats


@inline
def of_mesh(mesh: int, s: State) -> tuple[float, float, float]:
    """Displacement and velocity of the stage at a mesh, and the other stage's velocity."""
    return (s[0], s[1], s[3]) if mesh == 1 else (s[2], s[3], s[1])


@inline
def flanks_of(mesh: int, walls: Walls) -> tuple[float, float]:
    """Distances of the flanks of a mesh from the middle of their gap."""
    return (walls.high1, walls.low1) if mesh == 1 else (walls.high2, walls.low2)


@inline
def clip(s: State, walls: Walls) -> State:
    """A state with its displacements clipped to the walls."""
    x1 = min(max(s[0], -walls.low1), walls.high1)
    x2 = min(max(s[2], -walls.low2), walls.high2)
    return x1, s[1], x2, s[3]


@inline
def put_on_wall(x1: float, x2: float, code: int, walls: Walls) -> tuple[float, float]:
    """Displacements of both stages, with the stage that strikes ``mesh * side`` on that wall."""
    x1 = walls.high1 if code == 1 else (-walls.low1 if code == -1 else x1)
    x2 = walls.high2 if code == 2 else (-walls.low2 if code == -2 else x2)
    return x1, x2
