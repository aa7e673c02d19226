"""The figure of an orbit between its walls."""

from itertools import pairwise

import numpy as np

from rattle.closure.orbit import Orbit
from rattle.scene.figure import ShownFigure

POINTS = 40  # of a curve from one impact to the next


def plot_orbit(orbit: Orbit) -> ShownFigure:
    """Draw the displacements over time, the walls, the impacts at each mesh, and the times in which a mesh sticks."""
    c, last = orbit.constants, orbit.tau[orbit.found]
    figure = ShownFigure(figsize=(7.0, 0.6 + 1.8 * c.stages), layout="constrained")
    panels = figure.subplots(c.stages, 1, sharex=True, squeeze=False)[:, 0]
    begins = np.append(orbit.legs[orbit.legs[:, 0] < last, 0], last)
    times = np.concatenate([np.linspace(a, b, POINTS, endpoint=False) for a, b in pairwise(begins)] + [[last]])
    state = np.array([orbit.state(t) for t in times])
    for i, (ax, wall) in enumerate(zip(panels, (c.wall1, c.wall2), strict=False)):
        here = np.flatnonzero(orbit.mesh[: orbit.found + 1] == i + 1)
        ax.plot(times, state[:, 2 * i], color="#0072B2", lw=1.2)
        struck = orbit.before[here, 2 * i]
        ax.plot(orbit.tau[here], struck, "o", color="#D55E00", ms=4, label=f"impact at mesh {i + 1}")
        for side in (-1, 1):
            ax.axhline(side * wall, color="0.4", lw=1.0)
        phases = [p for p in orbit.sticking if p.mesh == i + 1 and p.closed < last]
        for number, phase in enumerate(phases):
            label = "_" * (number > 0) + f"mesh {i + 1} sticks"
            ax.axvspan(phase.closed, min(phase.opened, last), color="#E69F00", alpha=0.3, lw=0, label=label)
        ax.set_ylabel(f"$x_{i + 1}$ in backlash1")
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False)
    panels[-1].set_xlabel(r"time $\tau = \omega t$")
    return figure
