"""The deterministic orbit (sigma = 0) from impact to impact over both meshes: what every closure is built around."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scene.compiled import lean
from scene.flight import flow
from scene.impact import MISSES, REST, next_impact, struck
from scene.scene import Constants, Scene

__all__ = ["HORIZON", "Orbit", "follow"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

HORIZON = 1e4  # longest flight that is followed, in units of 1 / omega
CHATTER_FLIGHT, CHATTER_COUNT = 1e-7, 4  # so many flights in a row, each shorter than this: impacts accumulate;
# the excursions of shorter flights are below the rounding of a wall, where the time of the next impact has no meaning


@lean
def _follow(
    c: Constants, tau: float, x1: float, y1: float, x2: float, y2: float, mesh: int,
    taus: Floats, meshes: Ints, sides: Ints, before: Floats, after: Floats,
) -> tuple[int, int]:  # fmt: skip
    """Fill the arrays; returns how many impacts were found, and the mesh of the last event (`MISSES` if none)."""
    taus[0], meshes[0] = tau, mesh
    before[0, 0], before[0, 1], before[0, 2], before[0, 3] = x1, y1, x2, y2
    if mesh != 0:
        sides[0] = 1 if (x1 if mesh == 1 else x2) > 0.0 else -1
        y1, y2 = struck(c, mesh, y1, y2)
    after[0, 0], after[0, 1], after[0, 2], after[0, 3] = x1, y1, x2, y2
    short = 0
    for k in range(1, taus.size):
        t, mesh, side, x1, y1, x2, y2 = next_impact(c, tau, x1, y1, x2, y2, HORIZON)
        short = short + 1 if t < CHATTER_FLIGHT else 0
        if short >= CHATTER_COUNT:
            mesh = REST
        if mesh <= 0:
            return k - 1, mesh
        tau += t
        taus[k], meshes[k], sides[k] = tau, mesh, side
        before[k, 0], before[k, 1], before[k, 2], before[k, 3] = x1, y1, x2, y2
        y1, y2 = struck(c, mesh, y1, y2)
        after[k, 0], after[k, 1], after[k, 2], after[k, 3] = x1, y1, x2, y2
    return taus.size - 1, 1


@dataclass(frozen=True)
class Orbit:
    """An orbit of `impacts` impacts; index 0 of every array is the start.

    Attributes
    ----------
    tau : ndarray, shape (impacts + 1,)
        Impact times, counted from the start's phase (`Scene.phase`).
    mesh, side : ndarray of int, shape (impacts + 1,)
        Where it struck; 0 for a start in flight.
    before, after : ndarray, shape (impacts + 1, 4)
        ``(x1, y1, x2, y2)`` on both sides of the impact.
    found : int
        Impacts that were reached; the rest of the arrays is NaN (and mesh 0).
    stopped : str
        Why it ended early, or an empty string.
    """

    tau: Floats
    mesh: Ints
    side: Ints
    before: Floats
    after: Floats
    found: int
    stopped: str

    def state(self, c: Constants, time: float) -> Floats:
        """State at a time of the orbit, after any impact at that very instant, shape (4,)."""
        k = int(np.searchsorted(self.tau[: self.found + 1], time, side="right")) - 1
        x1, y1, x2, y2 = self.after[k]
        return np.asarray(flow(c, self.tau[k], x1, y1, x2, y2, time - self.tau[k]), dtype=float)


def follow(scene: Scene, impacts: int) -> Orbit:
    """Follow the orbit of a scene through `impacts` impacts.

    Examples
    --------
    >>> from scene import DAT21, Scene
    >>> orbit = follow(Scene.from_gears(DAT21), 3)
    >>> orbit.mesh.tolist(), orbit.side.tolist()
    ([1, 1, 2, 1], [1, -1, 1, -1])
    """
    c = scene.constants
    start = scene.start
    tau, before, after = (
        np.full(impacts + 1, np.nan),
        np.full((impacts + 1, 4), np.nan),
        np.full((impacts + 1, 4), np.nan),
    )
    mesh, side = np.zeros(impacts + 1, np.int64), np.zeros(impacts + 1, np.int64)
    found, last = _follow(c, scene.phase, *scene.start_state, start.mesh, tau, mesh, side, before, after)
    stopped = "" if last > 0 else f"{MISSES[last]} after impact {found}"
    return Orbit(tau, mesh, side, before, after, found, stopped)
