"""``euler-maruyama``: Eq. 5 by the Euler-Maruyama scheme, with impacts detected at the end of a step.

A path that ends a step beyond a wall and moves outward is put back on the wall, and the impact rule is applied.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.schemes.step_state import Noise, Progress, Walls
from rattle.scene.compiled import inlined, lean, spliced
from rattle.scene.constants import Constants
from rattle.scene.flight import noise_rate

__all__ = ["StepForcing", "at_end", "due", "euler_lanes", "euler_step", "put_on_wall", "step_forcing"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class StepForcing(NamedTuple):
    """The part of a step that is the same for every path: ``y_i += push_i + kick_i z``, z standard normal.

    Attributes
    ----------
    push1, push2 : float
        Drift by excitation and drag, over the step.
    kick1, kick2 : float
        Effect of a unit normal.
    """

    push1: float
    kick1: float
    push2: float
    kick2: float


@lean
def step_forcing(c: Constants, tau: float, h: float) -> StepForcing:
    """Forcing of an Euler-Maruyama step of length h at `tau` (Eq. 5).

    Parameters
    ----------
    c : Constants
        Of the scene.
    tau, h : float
        Start and length of the step.

    Returns
    -------
    StepForcing
    """
    m1, m2 = noise_rate(c, tau)
    root = c.sigma * math.sqrt(h)
    return StepForcing(
        h * (c.gamma1 + c.alpha * m1), root * m1, h * (c.gamma1 - c.gamma2 + c.alpha * m2), root * m2
    )  # fmt: skip


@inlined
def euler_step(
    c: Constants, f: StepForcing, h: float, x1: float, y1: float, x2: float, y2: float, z: float
) -> tuple[float, float, float, float]:
    """One Euler-Maruyama step of Eq. 5 without walls.

    Parameters
    ----------
    c : Constants
        Of the scene.
    f : StepForcing
        Of the step.
    h : float
        Step.
    x1, y1, x2, y2 : float
        State at its start.
    z : float
        The standard normal that both stages share.

    Returns
    -------
    x1, y1, x2, y2 : float
        State at its end.
    """
    return (
        x1 + h * y1,
        y1 - h * c.beta1 * y1 + (f.push1 + f.kick1 * z),
        x2 + h * y2,
        y2 - h * c.beta2 * y2 + h * (c.beta2 - c.beta1) * y1 + (f.push2 + f.kick2 * z),
    )


@lean
def euler_lanes(
    c: Constants, f: StepForcing, h: float, toleranced: bool, walls: Floats, state: Floats, z: Floats, beyond: Bools,
    lanes: int,
) -> None:  # fmt: skip
    """One step of all lanes, in place; marks those that end beyond a wall.  Vectorises.

    Parameters
    ----------
    c : Constants
        Of the scene.
    f : StepForcing
        Of the step.
    h : float
        Step.
    toleranced : bool
        Whether flanks differ between paths.
    walls, state : ndarray, shape (4, lanes or more)
        Flanks and states of the paths; `walls` is read only if they are toleranced.
    z : ndarray
        Standard normals.
    beyond : ndarray of bool
        Output.
    lanes : int
        Number of lanes.
    """
    x1, y1, x2, y2 = state[0], state[1], state[2], state[3]
    if toleranced and c.stages == 2:
        for p in range(lanes):
            x1[p], y1[p], x2[p], y2[p] = euler_step(c, f, h, x1[p], y1[p], x2[p], y2[p], z[p])
        high1, low1, high2, low2 = walls[0], walls[1], walls[2], walls[3]
        for p in range(lanes):
            beyond[p] = (x1[p] > high1[p]) | (x1[p] < -low1[p]) | (x2[p] > high2[p]) | (x2[p] < -low2[p])
    elif c.stages == 2:
        for p in range(lanes):
            a, y1[p], b, y2[p] = euler_step(c, f, h, x1[p], y1[p], x2[p], y2[p], z[p])
            x1[p], x2[p] = a, b
            beyond[p] = (abs(a) > c.wall1) | (abs(b) > c.wall2)
    elif toleranced:
        high1, low1 = walls[0], walls[1]
        for p in range(lanes):
            a, y1[p], _, _ = euler_step(c, f, h, x1[p], y1[p], 0.0, 0.0, z[p])
            x1[p] = a
            beyond[p] = (a > high1[p]) | (a < -low1[p])
    else:
        for p in range(lanes):
            a, y1[p], _, _ = euler_step(c, f, h, x1[p], y1[p], 0.0, 0.0, z[p])
            x1[p] = a
            beyond[p] = abs(a) > c.wall1


@spliced
def due(c: Constants, x1: float, y1: float, x2: float, y2: float, walls: Walls) -> int:
    """The impact due at the end of a step: beyond a wall and moving outward, mesh 1 before mesh 2.  Branch-free.

    Parameters
    ----------
    c : Constants
        Of the scene.
    x1, y1, x2, y2 : float
        State.
    walls : Walls
        Of the path.

    Returns
    -------
    int
        ``mesh * side``, or 0.
    """
    first = int((x1 > walls.high1) & (y1 > 0.0)) - int((x1 < -walls.low1) & (y1 < 0.0))
    second = int((x2 > walls.high2) & (y2 > 0.0)) - int((x2 < -walls.low2) & (y2 < 0.0))
    return first if first != 0 else (2 * second if c.stages == 2 else 0)


@spliced
def put_on_wall(code: int, x1: float, x2: float, walls: Walls) -> tuple[float, float]:
    """Displacements with that of the struck mesh put back on its wall.

    Parameters
    ----------
    code : int
        ``mesh * side`` of the impact, or 0.
    x1, x2 : float
        Displacements.
    walls : Walls
        Of the path.

    Returns
    -------
    x1, x2 : float
    """
    x1 = walls.high1 if code == 1 else (-walls.low1 if code == -1 else x1)
    x2 = walls.high2 if code == 2 else (-walls.low2 if code == -2 else x2)
    return x1, x2


@spliced
def at_end(c: Constants, at: Progress, walls: Walls) -> Progress:
    """The path with the impact that is due at the end of its step.

    Parameters
    ----------
    c : Constants
        Of the scene.
    at : Progress
        At the end of the step.
    walls : Walls
        Of the path.

    Returns
    -------
    Progress
        Struck coordinate on its wall, and `code` set.
    """
    code = due(c, at.x1, at.y1, at.x2, at.y2, walls)
    x1, x2 = put_on_wall(code, at.x1, at.x2, walls)
    return Progress(code, at.tau, 0.0, Noise(0.0, 0.0), x1, at.y1, x2, at.y2)
