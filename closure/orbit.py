"""The deterministic orbit (sigma = 0) from impact to impact over both meshes, around which every closure is built.

Between two impacts lies a flight, or a sticking phase: impacts accumulate (chatter), the mesh stays closed while its
contact force pushes, and opens.  The orbit goes through all of these.  Its linearisations end at the first sticking
phase, after which the state no longer depends on the one before.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.scene.compiled import lean
from rattle.scene.constants import Constants
from rattle.scene.flight import flow
from rattle.scene.impact import LOST, MISSES, NONE, REST, next_impact, struck
from rattle.scene.moments import STATE
from rattle.scene.scene import Scene
from rattle.scene.sticking import complete_chatter, find_sticking, next_contact, stick_on, stuck
from rattle.scene.units import as_dataset

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

__all__ = ["HORIZON", "Orbit", "StickingPhase", "follow"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

HORIZON = 1e4  # longest flight or sticking phase that is followed, in units of 1 / omega
LEGS = 8  # room for smooth pieces (legs) per impact; a sticking phase of one mesh takes 3
POINTS = 40  # of a figure's curve from one leg to the next
LEG = 7  # numbers per leg: tau, x1, y1, x2, y2, side on which mesh 1 sticks, side on which mesh 2 does


@lean
def _note(legs: Floats, n: int, tau: float, x1: float, y1: float, x2: float, y2: float, first: int, second: int) -> int:
    """Write a leg to row n; returns n + 1."""
    leg = legs[n]
    leg[0], leg[1], leg[2], leg[3], leg[4], leg[5], leg[6] = tau, x1, y1, x2, y2, first, second
    return n + 1


@lean
def _follow(
    c: Constants,
    tau: float,
    x1: float,
    y1: float,
    x2: float,
    y2: float,
    mesh: int,
    taus: Floats,
    meshes: Ints,
    sides: Ints,
    before: Floats,
    after: Floats,
    legs: Floats,
    legs_after: Ints,
) -> tuple[int, int, int]:
    """Fill the arrays; returns the numbers of impacts and legs, and the last mesh or a code of `MISSES`."""
    taus[0], meshes[0] = tau, mesh
    before[0, 0], before[0, 1], before[0, 2], before[0, 3] = x1, y1, x2, y2
    side = 0
    if mesh != 0:
        side = 1 if (x1 if mesh == 1 else x2) > 0.0 else -1
        y1, y2 = struck(c, mesh, y1, y2)
    sides[0] = side
    after[0, 0], after[0, 1], after[0, 2], after[0, 3] = x1, y1, x2, y2
    n, k = 0, 0
    while True:
        legs_after[k] = n
        n = _note(legs, n, tau, x1, y1, x2, y2, 0, 0)
        if k + 1 == taus.size:
            return k, n, 1
        closed = (0, 0)
        if mesh > 0:
            t, sticking = complete_chatter(c, tau, x1, y1, x2, y2, mesh, side)
            if t < np.inf:
                x1, y1, x2, y2 = stuck(c, *flow(c, tau, x1, y1, x2, y2, t), sticking)
                tau += t
        while True:  # through sticking phases, to the next impact
            if closed[0] == 0 and closed[1] == 0:
                touching1 = int(x1 == c.wall1) - int(x1 == -c.wall1) if y1 == 0.0 else 0
                touching2 = int(x2 == c.wall2) - int(x2 == -c.wall2) if y2 == 0.0 and c.stages == 2 else 0
                closed = find_sticking(c, tau, y1, y2, (touching1, touching2))
            if closed[0] != 0 or closed[1] != 0:
                n = _note(legs, n, tau, x1, y1, x2, y2, *closed)
                t, mesh, side, x1, y1, x2, y2, closed = next_contact(c, tau, x1, y1, x2, y2, closed, HORIZON)
                if mesh == NONE:
                    return k, n, REST
            else:
                t, mesh, side, x1, y1, x2, y2 = next_impact(c, tau, x1, y1, x2, y2, HORIZON)
            tau += t
            if mesh != REST:
                break
            if n + 2 >= len(legs):
                return k, n, LOST
            n = _note(legs, n, tau, x1, y1, x2, y2, *closed)
        if mesh <= 0:
            return k, n, mesh
        k += 1
        taus[k], meshes[k], sides[k] = tau, mesh, side
        before[k, 0], before[k, 1], before[k, 2], before[k, 3] = x1, y1, x2, y2
        y1, y2 = struck(c, mesh, y1, y2)
        after[k, 0], after[k, 1], after[k, 2], after[k, 3] = x1, y1, x2, y2


class StickingPhase(NamedTuple):
    """A time in which a mesh sticks."""

    mesh: int  # mesh, side: mesh and flank
    side: int
    closed: float  # closed, opened: begin and end in local time; ``opened`` is infinite for a mesh that sticks for good
    opened: float
    impact: int  # number of the last impact before it


@dataclass(frozen=True)
class Orbit:
    """A deterministic orbit through a number of impacts; index 0 of every array is the start.

    Attributes
    ----------
    constants : Constants
        Of its scene.
    tau : ndarray, shape (impacts + 1,)
        Impact times in local time (`Scene.phase`).
    mesh, side : ndarray of int, shape (impacts + 1,)
        Mesh and flank of each impact; 0 for a start in flight.
    before, after : ndarray, shape (impacts + 1, 4)
        ``(x1, y1, x2, y2)`` just before and just after the impact.
    found : int
        Number of impacts that were reached; the arrays are NaN (mesh and side 0) beyond.
    stopped : str
        Why it ended early, or an empty string.
    legs : ndarray, shape (legs, 7)
        The smooth pieces of the orbit, one after each impact and one for each change of the sticking meshes: time and
        state at which it begins, and the sides on which mesh 1 and mesh 2 stick (0 for open).
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
    mesh: Ints
    side: Ints
    before: Floats
    after: Floats
    found: int
    stopped: str
    legs: Floats
    sticking: tuple[StickingPhase, ...]

    @property
    def until_sticking(self) -> "Orbit":
        """The orbit up to its first sticking phase: as far as its linearisation describes neighbouring paths."""
        if not self.sticking:
            return self
        k = self.sticking[0].impact
        left = np.arange(len(self.tau)) <= k
        tau, mesh, side = np.where(left, self.tau, np.nan), np.where(left, self.mesh, 0), np.where(left, self.side, 0)
        before, after = np.where(left[:, None], self.before, np.nan), np.where(left[:, None], self.after, np.nan)
        legs = self.legs[: int(self.legs[:, 5:].any(axis=1).argmax())]
        return Orbit(self.constants, tau, mesh, side, before, after, k, f"{MISSES[REST]} after impact {k}", legs, ())

    def state(self, time: float) -> Floats:
        """State at a time of the orbit; at the time of an impact, the state after it.

        Parameters
        ----------
        time : float
            Local time, from the start on.

        Returns
        -------
        ndarray, shape (4,)
            ``(x1, y1, x2, y2)``.
        """
        tau, x1, y1, x2, y2, first, second = self.legs[int(np.searchsorted(self.legs[:, 0], time, side="right")) - 1]
        closed = int(first), int(second)
        return np.array(stick_on(self.constants, tau, x1, y1, x2, y2, closed, time - tau))

    def plot(self) -> "Figure":
        """Draw the displacements over time between their walls, with the impacts and the sticking phases.

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
        parts = [np.linspace(a, b, POINTS, endpoint=False) for a, b in pairwise(begins)]
        times = np.concatenate([*parts, [last]])
        states = np.array([self.state(t) for t in times])
        n = self.found + 1
        return plot_orbit(self.constants, times, states, self.tau[:n], self.mesh[:n], self.before[:n], self.sticking)

    def to_xarray(self) -> "xr.Dataset":
        """Convert times, meshes, sides and states to a dataset; needs the optional dependency ``xarray``.

        Returns
        -------
        xarray.Dataset
            Dimension ``impact``, from 0, the start; ``y1_after, y2_after`` are velocities just after the impact.  Each
            variable has its unit in ``attrs["units"]``.

        Examples
        --------
        >>> from rattle.scene import DAT21, Scene
        >>> follow(Scene.from_gears(DAT21), 3).to_xarray()["mesh"].values.tolist()
        [1, 1, 2, 1]
        """
        import pandas as pd

        columns = {
            "tau": self.tau,
            "mesh": self.mesh,
            "side": self.side,
            **dict(zip(STATE, self.before.T, strict=True)),
        }
        data = as_dataset(pd.DataFrame(columns).rename_axis("impact"), "dimensionless", None)
        for i in (1, 3):
            data[f"{STATE[i]}_after"] = ("impact", self.after[:, i], data[STATE[i]].attrs)
        return data


def follow(scene: Scene, impacts: int) -> Orbit:
    """Compute the orbit of a scene through a number of impacts, and the sticking phases between them.

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
    start = scene.start
    tau, before, after = (
        np.full(impacts + 1, np.nan),
        np.full((impacts + 1, 4), np.nan),
        np.full((impacts + 1, 4), np.nan),
    )
    mesh, side = np.zeros(impacts + 1, np.int64), np.zeros(impacts + 1, np.int64)
    legs, legs_after = np.empty((LEGS * (impacts + 2), LEG)), np.zeros(impacts + 1, np.int64)
    found, pieces, last = _follow(
        c, scene.phase, *scene.start_state, start.mesh, tau, mesh, side, before, after, legs, legs_after
    )
    legs = legs[:pieces].copy()
    phases = _sticking_phases(legs, legs_after[: found + 1])
    stopped = "" if last > 0 else f"{MISSES[last]} after impact {found}"
    return Orbit(c, tau, mesh, side, before, after, found, stopped, legs, phases)


def _sticking_phases(legs: Floats, legs_after: Ints) -> tuple[StickingPhase, ...]:
    """Runs of legs in which a mesh sticks."""
    phases = []
    for mesh in (1, 2):
        closed = legs[:, 4 + mesh].astype(int)
        (edges,) = np.nonzero(np.diff(closed, prepend=0, append=0))
        for first, last in pairwise(edges):
            if closed[first] != 0:
                opened = float(legs[last, 0]) if last < len(legs) else np.inf
                impact = int(np.searchsorted(legs_after, first, side="right")) - 1
                phases.append(StickingPhase(mesh, int(closed[first]), float(legs[first, 0]), opened, impact))
    return tuple(sorted(phases, key=lambda phase: phase.closed))
