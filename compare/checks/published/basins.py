"""Basins of attraction of a published gear-rattling model, beside the published figure.

De Souza and Caldas (2001): ``s'' + beta s' = gamma + alpha (sin t - beta cos t)`` between walls at -1 and 0.  With
``x1 = s + 1/2`` and ``tau = t + pi`` that is one stage of this model.  Equation, values and the figure are taken from
Wagemakers, "The Basins Zoo" (2025), arXiv:2504.01580, whose figure has 1200 x 1200 starts.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from rattle.closure.long_orbit import PERIOD, LongOrbit
from rattle.compare.checks.check import Check, Found, self_test
from rattle.compare.report.texts import read_file
from rattle.scene import Scene, Start
from rattle.scene.types import Floats

GEARS = Scene(alpha=0.48, epsilon=0.9, beta1=0.1, gamma1=0.1, stages=1)
FRAME = (-0.99, -0.02), (-1.0, 1.0)  # of the figure: s from left to right, its velocity from bottom to top
FIGURE = read_file("checks.published", "basins.md")
"""The figure: impacts a period of the motion at each place whose surroundings have one colour."""
SHARE, PIXELS = 0.3821, 334  # of the coloured pixels of the figure as printed; a side of it
STARTS = 6000
STRETCH, LONGEST = 120, 24  # impacts of a stretch, and the most stretches until an orbit repeats
SAME = 1e-6


def _impacts_a_period(scene: Scene, starts: Iterable[Any], phase: float = math.pi) -> Floats:
    """Impacts in a period of the motion that is reached from each start ``(s, s')``; NaN for another one."""
    found = []
    for s, velocity in starts:
        orbit = LongOrbit(replace(scene, start=Start(phase, s + 0.5, velocity)))
        found.append(math.nan)
        for _ in range(LONGEST):
            flight = orbit.stretch(STRETCH, tangent=False).flight
            if flight.size < STRETCH:  # at rest
                break
            number = STRETCH / 2 * PERIOD / flight[STRETCH // 2 :].sum()
            if abs(number - round(number)) < SAME:
                found[-1] = round(number)
                break
    return np.array(found)


def _in_frame(across: Floats, up: Floats) -> Floats:
    """Starts at places of the figure, 0 to 1; shape (starts, 2)."""
    (left, right), (bottom, top) = FRAME
    return np.column_stack([left + (right - left) * across, bottom + (top - bottom) * up])


@self_test
def gear_rattle_basins(seed: int = 0, workers: int = 2) -> Found:
    """Check from which starts each of two coexisting motions is reached, and the share of all starts."""
    lines = FIGURE.split()
    cells = [(i, j, int(c)) for i, line in enumerate(lines) for j, c in enumerate(line) if c != "."]
    row, column, printed = np.array(cells).T
    places = _in_frame((column + 0.5) / len(lines), 1.0 - (row + 0.5) / len(lines))

    def differ(scene: Scene = GEARS, phase: float = math.pi) -> list[Check]:
        other = _impacts_a_period(scene, places, phase) != printed
        return [Check(f"places of {len(cells)} that differ from the figure", float(other.sum()), 0.0)]

    rng = np.random.default_rng(seed)
    three = _impacts_a_period(GEARS, _in_frame(*rng.uniform(size=(2, STARTS)))) == 3.0
    se = float(three.std()) * math.sqrt(1.0 / STARTS + 1.0 / PIXELS**2)
    share = Check("share of starts that end in three impacts a period", float(three.mean()), SHARE, se)
    return (
        [*differ(), share],
        {
            "restitution 0.88": differ(replace(GEARS, epsilon=0.88)),
            "drive 5 % smaller": differ(replace(GEARS, alpha=0.95 * GEARS.alpha)),
            "drag 20 % larger": differ(replace(GEARS, gamma1=1.2 * GEARS.gamma1)),
            "drag on the other flank": differ(phase=0.0),
        },
    )
