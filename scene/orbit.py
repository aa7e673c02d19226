"""The deterministic orbit (sigma = 0) from impact to impact over all meshes: what every closure is
built around, and what a simulation compares its paths with.

Between two impacts lies a flight, or a sticking phase: impacts accumulate (chatter), the mesh stays
closed while its contact force pushes, and opens.  The orbit goes through all of these.  Its
linearisations end at the first sticking phase, after which the state no longer depends on the one
before.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rattle.scene import Constants, Floats, Ints, Scene
from rattle.scene.compiled import internal, jit
from rattle.scene.drive import velocity_acceleration
from rattle.scene.elementary import unknown
from rattle.scene.flight import flow
from rattle.scene.impact import LOST, MISSES, NONE, REST, next_impact, strike
from rattle.scene.linear_algebra import put_row
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.sticking import (
    close,
    complete_chatter,
    find_sticking,
    may_chatter,
    next_contact,
    stick_on,
)
from rattle.scene.text import as_html
from rattle.scene.types import BODY, state_names
from rattle.scene.units import as_dataset
from rattle.scene.wheel import nearest_wall

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure


HORIZON = 1e4  # longest flight or sticking phase that is followed, in units of 1 / omega
LEGS = 8  # most smooth pieces (legs) per impact; a sticking phase of one mesh takes 3
# searches for a sticking phase of an orbit before they are compiled, which takes ten seconds, once:
# these take a twentieth of a second
INTERPRETED_SEARCHES = 100
CURVE_POINTS = 40  # of a figure's curve from one leg to the next


class Impacts(NamedTuple):
    """Impacts of an orbit, arrays as of `Orbit`; the first is where it begins."""

    tau: Floats
    flight: Floats
    mesh: Ints
    side: Ints
    before: Floats
    after: Floats

    @classmethod
    def empty(cls, impacts: int, wheels: int) -> "Impacts":
        """Room for a start and so many impacts after it, none of which is known yet."""
        tau, flight = unknown(2, impacts + 1)
        mesh, side = np.zeros((2, impacts + 1), np.int64)
        before, after = unknown(2, impacts + 1, 2 * wheels)
        return cls(tau, flight, mesh, side, before, after)

    @classmethod
    def of(cls, orbit: Any, part: slice = slice(None)) -> "Impacts":
        """The impacts of an orbit, or of what has arrays of the same names, or a part of them."""
        return cls(*(getattr(orbit, name)[part] for name in cls._fields))

    def until(self, last: int) -> "Impacts":
        """Copies in which no impact after the last one is known."""
        known = Impacts._make(values.copy() for values in self)
        unknown = Impacts.empty(0, self.before.shape[1] // 2)
        for values, missing in zip(known, unknown, strict=True):
            values[last + 1 :] = missing[0]
        return known


@internal
def put_impact(
    c: Constants, at: Impacts, k: int, tau: float, flight: float, mesh: int, state: Floats
) -> None:
    """Write impact k, whose state just before it is given; a start in flight has mesh 0."""
    at.tau[k] = tau
    at.flight[k] = flight
    at.mesh[k] = mesh
    put_row(at.before[k], state)
    put_row(at.after[k], state)
    if mesh > 0:
        at.side[k] = nearest_wall(c, mesh - 1, state[2 * mesh - 2])[0]
        strike(c, mesh, at.after[k])


@internal
def find_touching(c: Constants, state: Floats) -> Ints:
    """Sides on which meshes touch their wall at zero speed; 0 for a mesh that does not."""
    touching = np.zeros(c.wheels.size, np.int64)
    for i in range(touching.size):
        side, distance = nearest_wall(c, i, state[2 * i])
        if state[2 * i + 1] == 0.0 and distance == 0.0:
            touching[i] = side
    return touching


@jit
def fly(c: Constants, period: float, at: Impacts, k: int) -> int:
    """Write the impacts after impact k, as far as no mesh can stick between them; returns the last
    one."""
    while k + 1 < at.tau.size:
        if np.any(find_touching(c, at.after[k]) != 0):
            break
        if at.mesh[k] > 0 and may_chatter(c, at.tau[k], at.after[k], at.mesh[k]):
            break
        t, mesh, _, state = next_impact(c, at.tau[k], at.after[k], HORIZON)
        if mesh <= 0:
            break
        tau = at.tau[k] + t
        if tau >= period:
            tau %= period
        k += 1
        put_impact(c, at, k, tau, t, mesh, state)
    return k


@internal
def find_chatter(c: Constants, at: Impacts, k: int) -> tuple[float, Ints]:
    """The time after impact k at which its chatter is complete, infinite where it is none, and the
    meshes that then stick."""
    if at.mesh[k] == 0:
        return math.inf, np.zeros(c.wheels.size, np.int64)
    return complete_chatter(c, float(at.tau[k]), at.after[k], int(at.mesh[k]), int(at.side[k]))


@internal
def put_leg(legs: Floats, n: int, k: int, tau: float, state: Floats, closed: Ints) -> int:
    """Write row n of the legs, one after impact k; returns the number of the next row."""
    leg = legs[n]
    leg[0] = tau
    put_row(leg[1:], state)
    put_row(leg[1 + state.size :], closed)
    leg[-1] = k
    return n + 1


@internal
def stick(
    c: Constants, period: float, at: Impacts, k: int, legs: Floats, n: int
) -> tuple[int, int]:
    """Write the impact after impact k, through sticking phases, and their legs from row n on.

    Returns: Its mesh, or a code of `MISSES` where there is none; and the next row.
    """
    tau = float(at.tau[k])
    state = at.after[k].copy()
    flight = 0.0
    closed = np.zeros(c.wheels.size, np.int64)
    bodies = np.empty(c.wheels.size, BODY)
    t, sticking = find_chatter(c, at, k)
    if t < math.inf:
        walls = np.empty(state.size)
        for i, wheel in enumerate(c.wheels):
            walls[2 * i] = wheel.wall
            walls[2 * i + 1] = wheel.low
        state = flow(c, tau, state, t)
        close(c, state, sticking, walls, bodies)
        tau += t
        flight += t
    while True:
        if not np.any(closed != 0):
            driver = velocity_acceleration(c.drive, tau)
            find_sticking(c, driver, state, find_touching(c, state), closed, bodies)
        if np.any(closed != 0):
            n = put_leg(legs, n, k, tau, state, closed)
            t, mesh, _, state, closed = next_contact(c, tau, state, closed, HORIZON)
            if mesh == NONE:
                return REST, n
        else:
            t, mesh, _, state = next_impact(c, tau, state, HORIZON)
        tau += t
        flight += t
        if mesh > 0:
            tau = tau % period if tau >= period else tau
            put_impact(c, at, k + 1, tau, flight, mesh, state)
        if mesh != REST:
            return mesh, n
        if n + k + 3 >= len(legs):
            return LOST, n
        n = put_leg(legs, n, k, tau, state, closed)


@internal
def _go_on(
    c: Constants, at: Impacts, legs: Floats, k: int, n: int, most: int
) -> tuple[int, int, int]:
    """Write the impacts after impact k with at most so many searches for sticking phases, and their
    legs from row n on; returns as `fill_impacts`."""
    code = 1
    for _ in range(most):
        k = fly(c, math.inf, at, k)
        if k + 1 == at.tau.size:
            break
        code, n = stick(c, math.inf, at, k, legs, n)
        if code <= 0:
            break
        k += 1
    return k, code, n


_go_on_compiled = jit(_go_on)


def fill_impacts(c: Constants, at: Impacts, legs: Floats) -> tuple[int, int, int]:
    """Write the impacts after the first, through sticking phases, and the legs of these.

    Returns: The last impact; its mesh, or a code of `MISSES` where it is the last of all; and how
    many legs there are.  Shapes: `legs` (room, 2 + 3 wheels), rows as of `Orbit.legs` and the
    impact before.
    """
    k, code, n = _go_on(c, at, legs, 0, 0, INTERPRETED_SEARCHES)
    if code > 0 and k + 1 < at.tau.size:
        k, code, n = _go_on_compiled(c, at, legs, k, n, at.tau.size)
    return k, code, n


def empty_legs(impacts: int, wheels: int) -> Floats:
    """Room for the legs of so many impacts, as `fill_impacts` writes them."""
    return np.empty((LEGS * (impacts + 2), 2 + 3 * wheels))


def begin(scene: Scene, impacts: int) -> Impacts:
    """The start of a scene, with room for so many impacts after it."""
    at = Impacts.empty(impacts, scene.stages)
    put_impact(scene.constants, at, 0, scene.phase, math.nan, scene.start.mesh, scene.start_state)
    return at


def first_state(scene: Scene) -> Floats:
    """State in which the first flight of a scene begins: after the impact at the start if there is
    one."""
    state: Floats = begin(scene, 0).after[0]
    return state


def last_until(times: Floats, time: float) -> int:
    """Index of the last of some rising times, NaN after them, that is not later than another."""
    return int(np.searchsorted(times, time, side="right")) - 1


ITINERARY_SHOWN = 12  # impacts of an itinerary that a repr shows


class StickingPhase(NamedTuple):
    """A time in which a mesh sticks."""

    mesh: int  # mesh, side: mesh and flank
    side: int
    # closed, opened: begin and end in local time; ``opened`` is infinite for a mesh that sticks for
    # good
    closed: float
    opened: float
    impact: int  # number of the last impact before it


@numpy_defaults
@dataclass(frozen=True)
class Orbit:
    """A deterministic orbit through a number of impacts; index 0 of every array is the start.

    Attributes
    ----------
    constants : Constants
        Of its scene.
    tau : ndarray, shape (impacts + 1,)
        Impact times in local time (`Scene.phase`).
    flight : ndarray, shape (impacts + 1,)
        Time since the impact before; NaN for the start.
    mesh, side : ndarray of int, shape (impacts + 1,)
        Mesh and flank of each impact; 0 for a start in flight.
    before, after : ndarray, shape (impacts + 1, 2 wheels)
        ``(x1, y1, ...)`` just before and just after the impact.
    found : int
        Number of impacts that were reached; the arrays are NaN (mesh and side 0) beyond.
    stopped : str
        Why it ended early, or an empty string.
    legs : ndarray, shape (legs, 1 + 3 wheels)
        The smooth pieces of the orbit, one after each impact and one for each change of the
        sticking meshes: time and state at which it begins, and the sides on which the meshes stick
        (0 for open).
    sticking : tuple of StickingPhase
        Sticking phases, in order of time.

    Examples
    --------
    >>> from rattle import DAT21, Scene
    >>> follow(Scene.from_gears(DAT21), impacts=3).mesh.tolist()
    [1, 1, 2, 1]
    """

    constants: Constants
    tau: Floats
    flight: Floats
    mesh: Ints
    side: Ints
    before: Floats
    after: Floats
    found: int
    stopped: str
    legs: Floats
    sticking: tuple[StickingPhase, ...]

    def __repr__(self) -> str:
        """What was followed, on a few lines."""
        codes = self.mesh[1 : ITINERARY_SHOWN + 1] * self.side[1 : ITINERARY_SHOWN + 1]
        more = " ..." * (len(self.mesh) - 1 > ITINERARY_SHOWN)
        lines = [
            (
                f"Orbit: impacts 1 to {self.found}, tau = {self.tau[0]:.6g} to"
                f" {self.tau[self.found]:.6g} (local time)"
            ),
            f"  itinerary (mesh * side): {' '.join(f'{code:+d}' for code in codes if code)}{more}",
            f"  sticking phases: {len(self.sticking)}",
        ]
        return "\n".join(lines + [f"  ended: {self.stopped}"] * bool(self.stopped))

    def _repr_html_(self) -> str:
        return as_html(repr(self), self.table.to_html(max_rows=12))

    @property
    def table(self) -> "pd.DataFrame":
        """Times, meshes, sides and states just before each impact, index ``impact`` from 0, the
        start."""
        import pandas as pd

        columns = {"tau": self.tau, "mesh": self.mesh, "side": self.side} | dict(
            zip(state_names(self.constants.wheels.size), self.before.T, strict=True)
        )
        return pd.DataFrame(columns).rename_axis("impact")

    @property
    def until_sticking(self) -> "Orbit":
        """The orbit up to its first sticking phase: as far as its linearisation describes
        neighbouring paths."""
        if not self.sticking:
            return self
        k = self.sticking[0].impact
        cut = Impacts.of(self).until(k)
        sticks = self.legs[:, 1 + self.before.shape[1] :].any(axis=1)
        legs = self.legs[: int(sticks.argmax())]
        return Orbit(self.constants, *cut, k, f"{MISSES[REST]} after impact {k}", legs, ())

    def state(self, time: float) -> Floats:
        """State at a time of the orbit; at the time of an impact, the state after it.

        Parameters
        ----------
        time : float
            Local time, from the start on.

        Returns
        -------
        ndarray, shape (2 wheels,)
            ``(x1, y1, ...)``.
        """
        leg = self.legs[last_until(self.legs[:, 0], time)]
        states = 2 * self.constants.wheels.size
        closed = leg[1 + states :].astype(np.int64)
        begun = leg[1 : 1 + states]
        state: Floats = stick_on(self.constants, leg[0], begun, closed, time - leg[0])
        return state

    def plot(self) -> "Figure":
        """Draw the displacements over time between their walls, with the impacts and the sticking
        phases.

        Returns
        -------
        Figure
            Of matplotlib; a notebook shows it, ``savefig`` writes it.

        Examples
        --------
        >>> from rattle.scene import DAT21, Scene
        >>> [ax.get_ylabel() for ax in follow(Scene.from_gears(DAT21), 3).plot().axes]
        ['$x_1$ in backlash1', '$x_2$ in backlash1']
        """
        from rattle.scene.plot import plot_orbit

        last = self.tau[self.found]
        begins = np.append(self.legs[self.legs[:, 0] < last, 0], last)
        parts = [np.linspace(a, b, CURVE_POINTS, endpoint=False) for a, b in pairwise(begins)]
        times = np.concatenate([*parts, [last]])
        states = np.array([self.state(t) for t in times])
        n = self.found + 1
        return plot_orbit(
            self.constants,
            times,
            states,
            self.tau[:n],
            self.mesh[:n],
            self.before[:n],
            self.sticking,
        )

    def to_xarray(self) -> "xr.Dataset":
        """Convert times, meshes, sides and states to a dataset; needs the optional dependency
        ``xarray``.

        Returns
        -------
        xarray.Dataset
            Dimension ``impact``, from 0, the start; ``y1_after, y2_after`` are velocities just
            after the impact.  Each variable has its unit in ``attrs["units"]``.

        Examples
        --------
        >>> from rattle.scene import DAT21, Scene
        >>> follow(Scene.from_gears(DAT21), 3).to_xarray()["mesh"].values.tolist()
        [1, 1, 2, 1]
        """
        data = as_dataset(self.table, "dimensionless", None)
        for i in range(1, self.after.shape[1] // 2 + 1):
            data[f"y{i}_after"] = ("impact", self.after[:, 2 * i - 1], data[f"y{i}"].attrs)
        return data


@numpy_defaults
def follow(scene: Scene, impacts: int) -> Orbit:
    """Compute the orbit of a scene through a number of impacts, with its sticking phases.

    Parameters
    ----------
    scene : Scene
        Its noise and random tolerance are not used.
    impacts : int
        Impacts after the start.

    Returns
    -------
    Orbit
        With fewer impacts where no more were found (`Orbit.stopped`).

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> orbit = follow(Scene.from_gears(DAT21), 3)
    >>> orbit.mesh.tolist(), orbit.side.tolist()
    ([1, 1, 2, 1], [1, -1, 1, -1])

    Mesh 1 sticks under the drag, and the excitation opens it once a period:

    >>> orbit = follow(Scene(alpha=1.0, epsilon=0.3, beta1=0.0, gamma1=0.8, stages=1), 20)
    >>> [round(value, 5) for value in orbit.sticking[0]]
    [1, 1, 4.97495, 7.21048, 14]
    """
    c = scene.constants
    at = begin(scene, impacts)
    legs = empty_legs(impacts, scene.stages)
    k, code, n = fill_impacts(c, at, legs)
    number = np.arange(k + 1)
    begun = np.zeros((k + 1, legs.shape[1]))
    begun[:, 0] = at.tau[: k + 1]
    begun[:, 1 : 1 + at.after.shape[1]] = at.after[: k + 1]
    begun[:, -1] = number
    place = np.searchsorted(number, legs[:n, -1], side="right")
    pieces = np.insert(begun, place, legs[:n], axis=0)
    stopped = "" if code > 0 else f"{MISSES[code]} after impact {k}"
    phases = _sticking_phases(pieces[:, :-1], pieces[:, -1].astype(int))
    return Orbit(c, *at, k, stopped, pieces[:, :-1], phases)


def _sticking_phases(legs: Floats, impact: Ints) -> tuple[StickingPhase, ...]:
    """Runs of legs in which a mesh sticks; `impact` is the last one before each leg."""
    phases = []
    wheels = legs.shape[1] // 3
    for mesh in range(1, wheels + 1):
        closed = legs[:, 2 * wheels + mesh].astype(int)
        (edges,) = np.nonzero(np.diff(closed, prepend=0, append=0))
        for first, last in pairwise(edges):
            if closed[first] != 0:
                begin = float(legs[first, 0])
                end = float(legs[last, 0]) if last < len(legs) else np.inf
                phases.append(
                    StickingPhase(mesh, int(closed[first]), begin, end, int(impact[first]))
                )
    return tuple(sorted(phases, key=lambda phase: phase.closed))
