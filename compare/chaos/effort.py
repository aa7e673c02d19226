"""How much a study of chaos computes within its budget: sizes from counted work, so that no clock
decides what its figures show."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from rattle.compare.chaos.exponents import (
    DELTAS,
    FIRST_RECORD,
    GROWTH_BATCHES,
    GROWTH_BLOCK,
    LONGEST_RECORD,
    Exponents,
)
from rattle.compare.chaos.record import Regime
from rattle.compare.chaos.spectrum import SEGMENT, SEGMENTS, SPECTRUM_PATHS, VELOCITY_IN_TIME
from rattle.montecarlo.looks import order_ends_first
from rattle.scene import Scene, duration_text

CHAOS_BUDGET = 60.0  # core-seconds, by default
# nominal core-seconds, measured on DAT21 and four gear sets: an impact, the same with tangents, a
# step of a noisy path, an event of two paths at one distance, and a value of the sweep at the least
IMPACT_SECONDS = 0.75e-6
TANGENT_SECONDS = 1.5e-6
NOISY_STEP_SECONDS = 0.24e-6
EVENT_SECONDS = 60e-6
VALUE_SECONDS = 0.8
COUNTED_SHARE = 0.8  # of the budget; the rest is for what nobody counts
SHARES = {"exponents": 1.0, "sections": 1.5, "spectra": 1.5, "events": 1.5, "sweep": 4.5}
"""Weights by which the parts share what is left."""
FEWEST_POINTS = 1000
FEWEST_IMPACTS = 20_000
FEWEST_EVENTS = 128


class Effort(NamedTuple):
    """How much a study of chaos computes, and from which seed."""

    points: int = 1_000_000  # of each Poincaré section
    impacts: int = 200_000  # of the spectra
    events: int = 4000  # pairs of paths
    # required width of the interval of each largest exponent; wider ones are reported as they are
    width: float = 0.01
    seed: int = 0
    workers: int = 2
    budget: float = math.inf  # core-seconds


class Sizes:
    """The sizes of the parts of a study, chosen one after the other from what is left of the
    budget.

    `reduced`: what is smaller than asked for, in words.
    """

    def __init__(self, effort: Effort, sweeps: bool) -> None:
        self.effort = effort
        self.reduced: list[str] = []
        self._left = COUNTED_SHARE * effort.budget
        self._weights = dict(SHARES)
        if not sweeps:
            del self._weights["sweep"]

    def _share(self, part: str) -> float:
        """Core-seconds for a part, of what the parts before it have left."""
        return self._left * self._weights.pop(part) / (sum(self._weights.values()) + SHARES[part])

    def _fit(self, part: str, what: str, wanted: int, fewest: int, cost: float) -> int:
        """As many as fit the share of a part at a cost of each, the fewest in any case."""
        affordable = self._share(part) / max(cost, 1e-12)
        number = max(min(wanted, fewest), int(min(wanted, affordable)))
        self._left -= number * cost
        if number < wanted:
            self.reduced.append(f"{number:,} of {wanted:,} {what}")
        return number

    def longest(self) -> int:
        """The longest record of the exponents, in impacts."""
        room = 0.5 * self._share("exponents") / TANGENT_SECONDS
        return _record(room)

    def count_exponents(self, scene: Scene, orbit: Exponents, drift: Exponents) -> None:
        """Charge the exponents, whose records say what an impact costs in the parts to come."""
        self._left -= TANGENT_SECONDS * orbit.regime.computed
        self._left -= _noisy_seconds(drift.regime, TANGENT_SECONDS)
        for which in (orbit, drift):
            if which.width > self.effort.width:
                self.reduced.append(f"{which.impacts:,} impacts of the {which.of}")
        self._of_orbit = 0.0
        if orbit.regime.has_record:
            recorded = max(orbit.regime.impacts, 1)
            self._of_orbit = IMPACT_SECONDS * orbit.regime.computed / recorded
        noisy = drift.regime
        self._of_path = _noisy_seconds(noisy, IMPACT_SECONDS) / max(noisy.computed, 1)
        self._of_step = _noisy_seconds(noisy, IMPACT_SECONDS) / max(noisy.steps, 1)

    def points(self) -> int:
        """Points of each section."""
        cost = self._of_orbit + self._of_path
        return self._fit(
            "sections", "points of each section", self.effort.points, FEWEST_POINTS, cost
        )

    def spectra(self) -> tuple[int, int]:
        """Impacts of the spectra, and the fewest segments of each noisy path."""
        segment = SPECTRUM_PATHS * SEGMENT[VELOCITY_IN_TIME] * self._of_step
        share = self._share("spectra")
        segments = max(1, min(SEGMENTS, int(min(0.5 * share / max(segment, 1e-12), SEGMENTS))))
        left = share - segments * segment
        wanted = self.effort.impacts
        affordable = max(left, 0.0) / max(self._of_orbit + self._of_path, 1e-12)
        impacts = max(min(wanted, FEWEST_IMPACTS), int(min(wanted, affordable)))
        self._left -= segments * segment + impacts * (self._of_orbit + self._of_path)
        if impacts < wanted:
            self.reduced.append(f"{impacts:,} of {wanted:,} impacts of the spectra")
        if segments < SEGMENTS:
            self.reduced.append(f"{segments} of {SEGMENTS} segments of the noisy spectra")
        return impacts, segments

    def events(self) -> int:
        """Pairs of paths behind each figure."""
        cost = EVENT_SECONDS * (len(DELTAS) + 1)
        return self._fit("events", "pairs of paths", self.effort.events, FEWEST_EVENTS, cost)

    def sweep(self, scenes: Mapping[float, Scene]) -> tuple[dict[float, Scene], int]:
        """The values of the sweep, spread evenly, and the longest record at each."""
        values = list(scenes)
        number = self._fit("sweep", "values of the sweep", len(values), 2, VALUE_SECONDS)
        room = VALUE_SECONDS + max(self._left, 0.0) / number
        chosen = set(order_ends_first(values)[:number])
        longest = _record(0.25 * room / TANGENT_SECONDS)
        return {at: scenes[at] for at in values if at in chosen}, longest

    def describe(self) -> str:
        """What the budget has cut, as a sentence; empty if nothing."""
        if not self.reduced or math.isinf(self.effort.budget):
            return ""
        budget = duration_text(self.effort.budget)
        return (
            f"Within the budget of {budget} of processor time: {', '.join(self.reduced)}. A larger"
            " one (`--budget`, `budget=`) gives more."
        )


def _record(impacts: float) -> int:
    """A length of a record that gives exponents, and is not too long."""
    least = 2 * GROWTH_BATCHES * GROWTH_BLOCK
    return int(min(max(impacts, min(least, FIRST_RECORD)), LONGEST_RECORD))


def _noisy_seconds(path: Regime, impact: float) -> float:
    """Nominal core-seconds of the record of a noisy path."""
    return impact * path.computed + NOISY_STEP_SECONDS * path.steps
