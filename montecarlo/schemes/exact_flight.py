"""``exact-flight``: the exact Gaussian distribution of the flight, and impacts located by refining the Brownian path.

Between impacts Eq. 5 is linear: the state after a step is the flight of Eq. 3 plus a Gaussian displacement, an integral
of the noise against known kernels.  The noise of a step is represented by its increment and area
(`rattle.montecarlo.noise.brownian`).  The kernels' projections on higher Legendre polynomials are of relative size
``h^2`` and are neglected (their share of the variance is about ``h^4 / 720``).

Given increment and area, the displacement inside a step deviates from the cubic Hermite interpolant of both end states
by a Gaussian of sd at most ``sigma m h^(3/2) (s (1 - s))^(3/2) / sqrt(3)`` at the share s of the step, m the modulation
of the noise.  A step whose cubic stays away from the walls by `MARGIN_SDS` such sds has no impact.  Any other step is
cut where the cubic meets the wall, its noise is split there (`split`), and so on: the distance to the wall falls with
exponent 3/2, and about four cuts locate an impact to `CLOSE`.

There is no step bias apart from these bounds.  At the default step the neglected noise is 2e-6 of sd(x1) where the
variance grows from zero (a flight of 0.2 from tau = 0), and 1e-10 of the other sds.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.noise.brownian import joined, split
from rattle.montecarlo.noise.philox import Key, Word, normals
from rattle.montecarlo.schemes.series import short_apart, short_phi1
from rattle.montecarlo.schemes.step_state import Noise, Progress, Walls
from rattle.scene.compiled import inlined, lean, spliced
from rattle.scene.constants import Constants
from rattle.scene.damping import pair
from rattle.scene.flight import flow

__all__ = [
    "PARTS",
    "FlightForcing",
    "advance_exactly",
    "first_root",
    "first_stage",
    "flight_forcing",
    "flight_lanes",
    "kick",
    "margins",
    "near_second",
    "near_wall",
    "second_stage",
]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

MARGIN_SDS = 6.0  # bound on a path's deviation from the cubic, in sds; exceeded in 2e-9 of the steps near a wall
CLOSE = 1e-10  # distance to the wall, in half gaps, at which an impact is accepted
MOST_CUTS = 1000  # per step; then the path is clipped to its walls
PARTS = 200  # most parts of a step that wait at once: the depth of the stack of cuts
SCALE = 1.0 / (6.0 * math.sqrt(3.0))  # margin on the inner Bernstein coefficients that covers (s (1-s))^1.5 / sqrt(3)

# Three-point Gauss-Legendre rule on [0, 1], exact to degree 5: the outer nodes lie OUTER from the middle.
OUTER, OUTER_WEIGHT, MIDDLE_WEIGHT = math.sqrt(0.15), 5.0 / 18.0, 4.0 / 9.0


class FlightForcing(NamedTuple):
    """A step of all lanes: ``s' = J s + drift + z_w along + z_a across``, and the margins of the walls.

    Attributes
    ----------
    x1y1, y1y1, x2y1, x2y2, y2y1, y2y2 : float
        Entries of the flight's Jacobian J that are neither 0 nor 1: ``x1y1 = dx1'/dy1`` and so on.
    drift : tuple of 4 float
        Effect of excitation and drag on ``(x1, y1, x2, y2)``.
    along, across : tuple of 4 float
        Effect of a unit normal for the increment, and for the area.
    margin1, margin2 : float
        Of both stages, see `margins`.
    """

    x1y1: float
    y1y1: float
    x2y1: float
    x2y2: float
    y2y1: float
    y2y2: float
    drift: tuple[float, float, float, float]
    along: tuple[float, float, float, float]
    across: tuple[float, float, float, float]
    margin1: float
    margin2: float


@lean
def margins(c: Constants, sine: float, cosine: float, h: float) -> tuple[float, float]:
    """Margins on the inner Bernstein coefficients of both stages' cubics, for noise and for the interpolation error.

    A stage has no impact if its coefficients stay away from the walls by its margin.  The noise is taken at its largest
    modulation in this time, not at its largest ever: where the modulation vanishes, a path that sticks to its wall must
    not be cut as if it were noisy.

    Parameters
    ----------
    c : Constants
        Of the scene.
    sine, cosine : float
        Of any phase in this time.
    h : float
        Length of the time.

    Returns
    -------
    margin1, margin2 : float
        Displacements.
    """
    spread = MARGIN_SDS * abs(c.sigma) * h * math.sqrt(h) * SCALE
    most = math.sqrt(1.0 + c.beta1**2)  # bound on the modulation of y1, and on its rate
    first = min(most, abs(c.beta1 * cosine - sine) + h * most)
    second = abs(c.beta1 - c.beta2) * (min(1.0, abs(cosine) + h) + h * first)  # the last term: noise of y1 acting on y2
    force = c.alpha * most + c.gamma1 + c.gamma2
    bend = h**4 / 96.0 * force * (1.0 + max(c.beta1, c.beta2)) ** 2  # Hermite error: h^4 / 384 times the 4th derivative
    return spread * first + bend, spread * second + bend


@inlined
def node(c: Constants, sine: float, cosine: float, lag: float) -> tuple[float, float, float, float]:
    """Impulse response: effect of unit noise at a phase on the state `lag` later (Eq. 5).

    Parameters
    ----------
    c : Constants
        Of the scene.
    sine, cosine : float
        Of the phase.
    lag : float
        Time since.

    Returns
    -------
    x1, y1, x2, y2 : float
    """
    m1 = -sine + c.beta1 * cosine
    if c.stages == 1:
        e1 = short_phi1(c.beta1, lag)
        return e1 * m1, (1.0 - c.beta1 * e1) * m1, 0.0, 0.0
    d = c.beta1 - c.beta2
    e1, e12 = short_apart(c.beta1, c.beta2, lag)
    d1, d12 = 1.0 - c.beta1 * e1, -d * e1 - c.beta2 * e12  # decay of stage 1; the same less that of stage 2
    return e1 * m1, d1 * m1, -cosine * d12 - sine * e12, cosine * (d * d1 + c.beta2 * d12) - sine * d12


@lean
def kick(c: Constants, tau: float, h: float, first: float, slope: float) -> tuple[float, float, float, float]:
    """Displacement at the end of a time h by the noise ``dB = (first + slope (s / h - 1/2)) ds / h`` (Eq. 5).

    Parameters
    ----------
    c : Constants
        Of the scene.
    tau, h : float
        Start and length of the time.
    first : float
        The Brownian increment.
    slope : float
        12 times the area.

    Returns
    -------
    x1, y1, x2, y2 : float
    """
    away = OUTER * h
    sine, cosine = math.sin(tau + 0.5 * h), math.cos(tau + 0.5 * h)
    s, k = math.sin(away), math.cos(away)
    a = node(c, sine * k - cosine * s, cosine * k + sine * s, 0.5 * h + away)
    b = node(c, sine, cosine, 0.5 * h)
    d = node(c, sine * k + cosine * s, cosine * k - sine * s, 0.5 * h - away)
    before = c.sigma * OUTER_WEIGHT * (first - slope * OUTER)
    middle = c.sigma * MIDDLE_WEIGHT * first
    after = c.sigma * OUTER_WEIGHT * (first + slope * OUTER)
    return (
        before * a[0] + middle * b[0] + after * d[0],
        before * a[1] + middle * b[1] + after * d[1],
        before * a[2] + middle * b[2] + after * d[2],
        before * a[3] + middle * b[3] + after * d[3],
    )


@lean
def flight_forcing(c: Constants, tau: float, h: float) -> FlightForcing:
    """Everything in a step that is the same for all paths.

    Parameters
    ----------
    c : Constants
        Of the scene.
    tau, h : float
        Start and length of the step.

    Returns
    -------
    FlightForcing
    """
    p = pair(c.beta1, c.beta2, h)
    margin1, margin2 = margins(c, math.sin(tau), math.cos(tau), h)
    return FlightForcing(
        p.e1, p.d1, p.e12, p.e2, p.d12, p.d2, flow(c, tau, 0.0, 0.0, 0.0, 0.0, h),
        kick(c, tau, h, math.sqrt(h), 0.0), kick(c, tau, h, 0.0, math.sqrt(12.0 * h)), margin1, margin2,
    )  # fmt: skip


@spliced
def _near(a: float, b: float, end: float, high: float, low: float, margin: float) -> bool:
    """Whether an inner Bernstein coefficient a, b of a cubic is within the margin of a wall, or its end beyond one."""
    return (max(a, b) > high - margin) | (min(a, b) < margin - low) | (end > high) | (end < -low)


@inlined
def near_wall(third: float, x0: float, y0: float, x: float, y: float, high: float, low: float, margin: float) -> bool:
    """Whether the cubic through both end states of a stage comes within its margin of a wall.

    Parameters
    ----------
    third : float
        A third of the step.
    x0, y0, x, y : float
        Displacement and velocity at the start and at the end.
    high, low : float
        Distances of the two flanks from the middle.
    margin : float
        Of this stage, see `margins`.

    Returns
    -------
    bool
    """
    return _near(x0 + third * y0, x - third * y, x, high, low, margin)


@inlined
def first_stage(f: FlightForcing, x1: float, y1: float, z: float, area: float) -> tuple[float, float]:
    """Stage 1 after a step, ignoring the walls.

    Parameters
    ----------
    f : FlightForcing
        Of the step.
    x1, y1 : float
        Its displacement and velocity.
    z, area : float
        Standard normals of the increment and of the area.

    Returns
    -------
    x1, y1 : float
    """
    return (
        x1 + f.x1y1 * y1 + (f.drift[0] + f.along[0] * z + f.across[0] * area),
        f.y1y1 * y1 + (f.drift[1] + f.along[1] * z + f.across[1] * area),
    )


@inlined
def second_stage(f: FlightForcing, x2: float, y1: float, y2: float, z: float, area: float) -> tuple[float, float]:
    """Stage 2 after a step, ignoring the walls.

    Parameters
    ----------
    f : FlightForcing
        Of the step.
    x2, y1, y2 : float
        State at the start of the step.
    z, area : float
        Standard normals of the increment and of the area.

    Returns
    -------
    x2, y2 : float
    """
    return (
        x2 + (f.x2y1 * y1 + f.x2y2 * y2 + (f.drift[2] + f.along[2] * z + f.across[2] * area)),
        f.y2y1 * y1 + f.y2y2 * y2 + (f.drift[3] + f.along[3] * z + f.across[3] * area),
    )


@lean
def flight_lanes(
    c: Constants, f: FlightForcing, h: float, walls: Floats, state: Floats, z: Floats, area: Floats, near: Bools,
    lanes: int,
) -> None:  # fmt: skip
    """One step of all lanes in place, ignoring the walls; marks those whose stage 1 may have an impact.  Vectorises.

    Parameters
    ----------
    c : Constants
        Of the scene.
    f : FlightForcing
        Of the step.
    h : float
        Step.
    walls, state : ndarray, shape (4, lanes or more)
        Flanks and states of the paths.
    z, area : ndarray
        Standard normals of the increment and of the area.
    near : ndarray of bool
        Output.
    lanes : int
        Number of lanes.
    """
    x1, y1, x2, y2 = state[0], state[1], state[2], state[3]
    third = h / 3.0
    high1, low1 = walls[0], walls[1]
    for p in range(lanes):
        x, y = x1[p], y1[p]
        end, speed = first_stage(f, x, y, z[p], area[p])
        near[p] = near_wall(third, x, y, end, speed, high1[p], low1[p], f.margin1)
        x1[p], y1[p] = end, speed
        if c.stages == 2:
            x2[p], y2[p] = second_stage(f, x2[p], y, y2[p], z[p], area[p])


@lean
def near_second(h: float, margin: float, walls: Floats, before: Floats, state: Floats, near: Bools, lanes: int) -> None:
    """Mark the lanes whose stage 2 may have an impact; vectorises.

    Parameters
    ----------
    h : float
        Step.
    margin : float
        Of stage 2, see `margins`.
    walls : ndarray, shape (4, lanes or more)
        Flanks of the paths.
    before, state : ndarray, shape (4, lanes or more)
        States at the start and at the end of the step.
    near : ndarray of bool
        Output; marks already set stay.
    lanes : int
        Number of lanes.
    """
    third = h / 3.0
    x0, y0, x1, y1, high, low = before[2], before[3], state[2], state[3], walls[2], walls[3]
    for p in range(lanes):
        near[p] |= near_wall(third, x0[p], y0[p], x1[p], y1[p], high[p], low[p], margin)


@inlined
def _cubic(a: float, b: float, c: float, d: float, s: float) -> float:
    """Value at s of the cubic with Bernstein coefficients a, b, c, d."""
    r = 1.0 - s
    return r * r * r * a + 3.0 * r * s * (r * b + s * c) + s * s * s * d


@spliced
def first_root(a: float, b: float, c: float, d: float) -> float:
    """First zero in (0, 1] of a cubic, by bracketing on eight pieces and safeguarded Newton steps.

    Parameters
    ----------
    a, b, c, d : float
        Bernstein coefficients, a >= 0.

    Returns
    -------
    float
        2 if no piece ends below zero.
    """
    low, pieces = 0.0, 8
    there = 1e-15 * (abs(a) + abs(b) + abs(c) + abs(d))
    for i in range(1, pieces + 1):
        high = i / pieces
        if _cubic(a, b, c, d, high) >= 0.0:
            low = high
            continue
        for _ in range(60):
            guess = 0.5 * (low + high)
            for _ in range(2):  # the middle of the bracket, then Newton's step from there if it stays inside
                value = _cubic(a, b, c, d, guess)
                if value < 0.0:
                    high = guess
                else:
                    low = guess
                r = 1.0 - guess
                slope = 3.0 * (r * r * (b - a) + 2.0 * r * guess * (c - b) + guess * guess * (d - c))
                newton = guess - value / slope if slope < 0.0 else guess
                if not low < newton < high:
                    break
                guess = newton
            if high - low < 1e-15 or abs(_cubic(a, b, c, d, guess)) <= there:
                return guess
        return low
    return 2.0


@lean
def _cut_at(gap0: float, rate0: float, gap1: float, rate1: float, h: float, margin: float, close: float) -> float:
    """Share of the time h after which a wall must be looked at again: 1 if there can be no impact before."""
    b, c = gap0 + rate0 * h / 3.0, gap1 - rate1 * h / 3.0
    if b > margin - close and c > margin - close and gap1 >= -close:  # `close` lets a path at rest on its wall start
        return 1.0
    root = first_root(max(gap0, 0.0), b, c, gap1)
    return root if root < 1.0 else 0.5


@spliced
def _due(c: Constants, at: Progress, walls: Walls) -> tuple[int, float]:
    """``mesh * side`` of an impact that is due, or 0; and the time to the next wall ahead at the present velocity."""
    code, reach = 0, math.inf
    for mesh in range(1, c.stages + 1):
        x, y = (at.x1, at.y1) if mesh == 1 else (at.x2, at.y2)
        high, low = (walls.high1, walls.low1) if mesh == 1 else (walls.high2, walls.low2)
        gap = high - x if y > 0.0 else low + x
        if y != 0.0 and gap > CLOSE * (c.wall1 if mesh == 1 else c.wall2):
            reach = min(reach, gap / abs(y))
        elif y != 0.0 and code == 0:
            code = mesh if y > 0.0 else -mesh
    return code, reach


@inlined
def _due_at_once(c: Constants, at: Progress, walls: Walls) -> int:
    """``mesh * side`` of an impact due at this very state (on a wall, moving outward), or 0; mesh 1 first."""
    code = int((at.x1 == walls.high1) & (at.y1 > 0.0)) - int((at.x1 == -walls.low1) & (at.y1 < 0.0))
    if code == 0 and c.stages == 2:
        code = 2 * int((at.x2 == walls.high2) & (at.y2 > 0.0)) - 2 * int((at.x2 == -walls.low2) & (at.y2 < 0.0))
    return code


@spliced
def _on_wall(at: Progress, code: int, walls: Walls) -> Progress:
    """The path with the struck coordinate on its wall, and the impact due."""
    x1, x2 = at.x1, at.x2
    if abs(code) == 1:
        x1 = walls.high1 if code > 0 else -walls.low1
    elif abs(code) == 2:
        x2 = walls.high2 if code > 0 else -walls.low2
    return Progress(code, at.tau, at.left, at.noise, x1, at.y1, x2, at.y2)


@spliced
def _put_inside(at: Progress, walls: Walls) -> Progress:
    """The path clipped to its walls: for a step that has used up its cuts."""
    x1, x2 = min(max(at.x1, -walls.low1), walls.high1), min(max(at.x2, -walls.low2), walls.high2)
    return Progress(at.code, at.tau, at.left, at.noise, x1, at.y1, x2, at.y2)


@spliced
def _cut_of_trial(c: Constants, at: Progress, end: Progress, h: float, walls: Walls) -> float:
    """Share of a trial step of length h to cut it at, over all walls; 1 if it has no impact before its end."""
    margin1, margin2 = margins(c, math.sin(at.tau), math.cos(at.tau), h)
    close = CLOSE * c.wall1
    cut = min(
        _cut_at(walls.high1 - at.x1, -at.y1, walls.high1 - end.x1, -end.y1, h, margin1, close),
        _cut_at(walls.low1 + at.x1, at.y1, walls.low1 + end.x1, end.y1, h, margin1, close),
    )
    if c.stages == 2:
        close = CLOSE * c.wall2
        cut = min(
            cut,
            _cut_at(walls.high2 - at.x2, -at.y2, walls.high2 - end.x2, -end.y2, h, margin2, close),
            _cut_at(walls.low2 + at.x2, at.y2, walls.low2 + end.x2, end.y2, h, margin2, close),
        )
    return cut


@inlined
def _with_noise(at: Progress, ahead: Floats, top: int) -> Progress:
    """The path with the noise of all waiting parts below `top` of the stack, joined."""
    noise, length = Noise(0.0, 0.0), 0.0
    for i in range(top):  # from the end of the step backwards
        whole = length + ahead[i, 0]
        noise = joined(Noise(ahead[i, 1], ahead[i, 2]), noise, ahead[i, 0] / whole)
        length = whole
    return Progress(at.code, at.tau, at.left, noise, at.x1, at.y1, at.x2, at.y2)


@inlined
def advance_exactly(
    c: Constants, key: Key, path: Word, index: Word, purpose: Word, at: Progress, walls: Walls, ahead: Floats
) -> Progress:
    """Go to the next wall that the path meets in this step, or to the end of the step.

    The time left is tried as a whole.  A trial that may have an impact is cut at the wall and its first part is tried;
    the second waits on a stack.  Waiting parts must not be joined before an impact: a trial is cut because of what its
    end would be, and forgetting that end and sampling it anew would give the path a second chance to miss the wall.  At
    an impact they may be joined, since it is a stopping time of the path.

    Parameters
    ----------
    c : Constants
        Of the scene.
    key : Key
        Of the run.
    path, index, purpose : Word
        Of the random numbers that split the noise; cut number i uses index + i.
    at : Progress
        Just after an impact, or at the start of a step.
    walls : Walls
        Of the path.
    ahead : ndarray, shape (PARTS, 3)
        Scratch, a stack: length, increment and area of the parts of the step still ahead, the nearest on top.

    Returns
    -------
    Progress
        At the impact that is due, or at the end of the step.
    """
    code = _due_at_once(c, at, walls)
    if code != 0:
        return Progress(code, at.tau, at.left, at.noise, at.x1, at.y1, at.x2, at.y2)
    cuts = Word(0)
    top = 0
    ahead[0, 0], ahead[0, 1], ahead[0, 2] = at.left, at.noise.increment, at.noise.area
    while True:
        h, trial = ahead[top, 0], Noise(ahead[top, 1], ahead[top, 2])
        x1, y1, x2, y2 = flow(c, at.tau, at.x1, at.y1, at.x2, at.y2, h)
        k1, l1, k2, l2 = kick(c, at.tau, h, trial.increment, 12.0 * trial.area)
        left = at.left - h if top > 0 else 0.0
        end = Progress(0, at.tau + h, left, Noise(0.0, 0.0), x1 + k1, y1 + l1, x2 + k2, y2 + l2)
        cut = _cut_of_trial(c, at, end, h, walls)
        used_up = cuts >= MOST_CUTS or top + 1 >= len(ahead)
        if cut == 1.0 or used_up:
            if used_up:
                end = _put_inside(end, walls)
            code, reach = _due(c, end, walls)
            if code != 0 or top == 0:
                return _on_wall(_with_noise(end, ahead, top), code, walls)
            at = end
            top -= 1
            h, trial = ahead[top, 0], Noise(ahead[top, 1], ahead[top, 2])
            if reach >= h:
                continue
            cut = reach / h
        z1, z2, _, _ = normals(key, path, index + cuts, purpose)
        cuts += Word(1)
        first, second = split(trial, h, cut, z1, z2)
        ahead[top, 0], ahead[top, 1], ahead[top, 2] = h - cut * h, second.increment, second.area
        top += 1
        ahead[top, 0], ahead[top, 1], ahead[top, 2] = cut * h, first.increment, first.area
