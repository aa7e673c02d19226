"""How much a study of chaos computes within its budget: sizes from counted work, so that no clock
decides what its figures show."""

import math
from collections.abc import Mapping
from typing import NamedTuple, Self

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
from rattle.montecarlo.looks import CountedWork
from rattle.scene import Scene, count, positive

CHAOS_BUDGET = 60.0  # core-seconds, by default
# nominal core-seconds, measured on DAT21 and four gear sets: an impact, the same with tangents, a
# step of a noisy path, an event of two paths at one distance, and a value of the sweep at the least
ORBIT_IMPACT_SECONDS = 0.75e-6
TANGENT_SECONDS = 1.5e-6
NOISY_STEP_SECONDS = 0.24e-6
EVENT_SECONDS = 60e-6
VALUE_SECONDS = 0.8
CHAOS_SHARE = 0.8  # of the budget; the rest is for what nobody counts
PART_WEIGHTS = {"exponents": 1.0, "sections": 1.5, "spectra": 1.5, "events": 1.5, "sweep": 4.5}
"""Weights by which the parts share what is left."""
FEWEST_OF_SECTION = 1000
FEWEST_OF_SPECTRA = 20_000
FEWEST_EVENTS = 128
LEAST_OF_EFFORT = {"points": 100, "impacts": 20_000, "events": FEWEST_EVENTS, "workers": 1}
"""Of what is asked for, the least by its name."""


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

    def check(self) -> Self:
        """Check all but seed and budget."""
        positive("width", self.width)
        for name, least in LEAST_OF_EFFORT.items():
            count(name, getattr(self, name), least=least)
        return self


class Sizes(CountedWork):
    """The sizes of the parts of a study, chosen one after the other from what is left of the
    budget."""

    def __init__(self, effort: Effort, sweeps: bool) -> None:
        super().__init__(effort.budget, CHAOS_SHARE)
        self.effort = effort
        self._weights = dict(PART_WEIGHTS)
        if not sweeps:
            del self._weights["sweep"]

    def _share(self, part: str) -> float:
        """Core-seconds for a part, of what the parts before it have left."""
        weight = self._weights.pop(part)
        return self.left * weight / (sum(self._weights.values()) + weight)

    def longest(self) -> int:
        """The longest record of the exponents, in impacts."""
        room = 0.5 * self._share("exponents") / TANGENT_SECONDS
        return _record(room)

    def count_exponents(self, scene: Scene, orbit: Exponents, drift: Exponents) -> None:
        """Charge the exponents, whose records say what an impact costs in the parts to come."""
        self.left -= TANGENT_SECONDS * orbit.regime.computed
        self.left -= _noisy_seconds(drift.regime, TANGENT_SECONDS)
        for which in (orbit, drift):
            if which.width > self.effort.width:
                self.reduced.append(f"{which.impacts:,} impacts of the {which.of}")
        self._of_orbit = 0.0
        if orbit.regime.has_record:
            recorded = max(orbit.regime.impacts, 1)
            self._of_orbit = ORBIT_IMPACT_SECONDS * orbit.regime.computed / recorded
        noisy = drift.regime
        self._of_path = _noisy_seconds(noisy, ORBIT_IMPACT_SECONDS) / max(noisy.computed, 1)
        self._of_step = _noisy_seconds(noisy, ORBIT_IMPACT_SECONDS) / max(noisy.steps, 1)

    def points(self) -> int:
        """Points of each section."""
        cost = self._of_orbit + self._of_path
        room = self._share("sections")
        return self.fit("points of each section", self.effort.points, FEWEST_OF_SECTION, cost, room)

    def spectra(self) -> tuple[int, int]:
        """Impacts of the spectra, and the fewest segments of each noisy path."""
        segment = SPECTRUM_PATHS * SEGMENT[VELOCITY_IN_TIME] * self._of_step
        impact = self._of_orbit + self._of_path
        room = self._share("spectra")
        segments = self.fit("segments of the noisy spectra", SEGMENTS, 1, segment, 0.5 * room)
        room -= segments * segment
        wanted = self.effort.impacts
        impacts = self.fit("impacts of the spectra", wanted, FEWEST_OF_SPECTRA, impact, room)
        return impacts, segments

    def events(self) -> int:
        """Pairs of paths behind each figure."""
        cost = EVENT_SECONDS * (len(DELTAS) + 1)
        room = self._share("events")
        return self.fit("pairs of paths", self.effort.events, FEWEST_EVENTS, cost, room)

    def sweep(self, scenes: Mapping[float, Scene]) -> tuple[dict[float, Scene], int]:
        """The values of the sweep, at equal distances, and the longest record at each."""
        values = list(scenes)
        work = len(values) * VALUE_SECONDS
        stride = min(math.ceil(work / max(self._share("sweep"), VALUE_SECONDS)), len(values) - 1)
        chosen = values[:: max(stride, 1)]
        number = len(chosen)
        fits = number * VALUE_SECONDS
        self.fit("values of the sweep", len(values), number, VALUE_SECONDS, fits)
        room = VALUE_SECONDS + max(self.left, 0.0) / number
        return {at: scenes[at] for at in chosen}, _record(0.25 * room / TANGENT_SECONDS)


def _record(impacts: float) -> int:
    """A length of a record that gives exponents, and is not too long."""
    least = 2 * GROWTH_BATCHES * GROWTH_BLOCK
    return int(min(max(impacts, min(least, FIRST_RECORD)), LONGEST_RECORD))


def _noisy_seconds(path: Regime, impact: float) -> float:
    """Nominal core-seconds of the record of a noisy path."""
    return impact * path.computed + NOISY_STEP_SECONDS * path.steps
