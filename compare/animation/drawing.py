"""What a drawing of wheels or bodies tells the page and its script: which part follows which
place."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rattle.compare.animation.record import Motion
from rattle.compare.report.json_text import Facts
from rattle.scene import Floats, Scene
from rattle.scene.drive import driver_motion
from rattle.scene.elementary import each


class Part(NamedTuple):
    """A part that moves: it is changed by `rest` and `factor` times one of the `places`."""

    place: int
    factor: float
    rest: float = 0.0
    change: str = "translate(0 "  # the begin of its transform

    def at(self, places: list[float]) -> str:
        """Its transform where driver, bodies and displacements have these values."""
        return f"{self.change}{round(self.rest + self.factor * places[self.place], 3)})"


@dataclass(frozen=True)
class Drawing:
    """A drawing of a scene."""

    # in the order in which they stand in the template
    parts: list[Part]
    # heights at which impacts at side -1 and +1 of each mesh flash, downwards in its drawing
    sparks: list[tuple[float, float]]
    facts: Facts  # for its template


def places(scene: Scene, motion: Motion) -> Floats:
    """Places of the driver and of each wheel, that of the driver and of wheel 1 upwards, and then
    the displacements; `animation.js` computes the same.

    Shapes: result (1 + 2 wheels, instants).
    """
    drive = scene.constants.drive
    driver = each(lambda tau: driver_motion(drive, tau), scene.phase + motion.time)
    rows = [scene.alpha * driver]
    for wheel, x in zip(scene.tree, motion.x.T, strict=True):
        rows.append(wheel.ratio * rows[int(wheel.parent)] + (x if wheel.parent else -x))
    return np.array([*rows, *motion.x.T])
