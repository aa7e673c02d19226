"""Orbits of any length, with the growth of their neighbours, and where they end: at rest, on a
cycle, or on neither.

Times are kept modulo the period of the excitation, so that the accuracy does not decrease along the
orbit.  For its end the orbit is looked at once a period (a stroboscopic section), which sees
chatter and sticking phases like everything else.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from rattle.scene import Constants, Floats, Ints, Scene
from rattle.scene.compiled import jit
from rattle.scene.drive import PERIOD
from rattle.scene.flight import flow
from rattle.scene.impact import MISSES, NONE, REST, strike
from rattle.scene.orbit import (
    Impacts,
    Orbit,
    begin,
    empty_legs,
    find_chatter,
    fly,
    follow,
    last_until,
    stick,
)
from rattle.scene.tangent import Stretch, grow

PERIODIC = "periodic"
REST_FOR_GOOD = "rest"
IRREGULAR = "irregular"
"""Kinds of attractors; an irregular one is chaotic, or its period is longer than
`LONGEST_CYCLE`.
"""

LONGEST_CYCLE = 64  # periods of the excitation
TRIES = (400, 4000, 30_000)  # impacts after which a period is looked for
SAME_STATE = 1e-8  # difference of states, relative to the largest, up to which they are the same
DECAYED = (
    1e-12  # displacements and speeds below which a motion is at rest in the middle of its gaps
)
# phases at which states are compared: at one of them an impact may be due
INSTANTS = (0.0, 1.0, 2.5, 4.5)
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


@jit
def _sample(c: Constants, step: float, s: Stretch, velocity: Floats) -> int:
    """Write the rates of all gaps at equal time steps of a stretch; returns how many rows."""
    n = 0
    t = 0.0
    for k in range(s.flight.size - 1):
        after = s.before[k].copy()
        strike(c, abs(s.code[k]), after)
        while t < s.flight[k + 1] and n < len(velocity):
            state = flow(c, s.phase[k], after, t)
            for i in range(velocity.shape[1]):
                velocity[n, i] = state[2 * i + 1]
            n += 1
            t += step
        t -= s.flight[k + 1]
    return n


class LongOrbit:
    """The deterministic orbit of a scene from one of many starts, followed a stretch at a time.

    `start`: 0 for the scene's own start; start number n is the same state at a phase later by n
    times 0.618 periods (the golden ratio, so that the phases of many starts are spread evenly).
    """

    def __init__(self, scene: Scene, start: int = 0) -> None:
        scene = scene.noise_free
        self.c = scene.constants
        self.last = begin(scene, 0)
        self.last.tau[0] = (scene.phase + start * PERIOD * GOLDEN) % PERIOD
        self.frame = np.eye(2 * scene.stages)
        self.ended = 1

    def stretch(self, impacts: int, tangent: bool = True) -> Stretch:
        """The next impacts of the orbit.

        Returns: Fewer impacts where the orbit has ended; the attribute `ended` is then a code of
        `rattle.scene.impact.MISSES`.
        """
        wheels = self.c.wheels.size
        at = Impacts.empty(impacts, wheels)
        for values, last in zip(at, self.last, strict=True):
            values[0] = last[0]
        legs = empty_legs(0, wheels)
        k = 0
        while self.ended > 0 and (k := fly(self.c, PERIOD, at, k)) < impacts:
            reached, sticking = stick(self.c, PERIOD, at, k, legs, 0)
            self.ended = REST if sticking else min(reached, 1)
            k += self.ended > 0
        if find_chatter(self.c, at, k)[0] < math.inf:
            self.ended = REST
        self.last = Impacts.of(at, slice(k, k + 1))
        part = Impacts.of(at, slice(1, k + 1))
        code = part.mesh * part.side
        s = Stretch(part.flight, part.tau, code, part.before, np.zeros((k, 2 * wheels)))
        if tangent:
            grow(self.c, self.frame, s)
        return s


def velocities(scene: Scene, s: Stretch, step: float) -> Floats:
    """The rates of all gaps at equal time steps from the first to the last impact of a stretch of
    the orbit.

    Shapes: result (steps, wheels).
    """
    velocity = np.empty((int(s.flight[1:].sum() / step) + 2, scene.stages))
    return velocity[: _sample(scene.noise_free.constants, step, s, velocity)]


@dataclass(frozen=True)
class Attractor:
    """Where an orbit ends."""

    kind: str  # `PERIODIC`, `REST_FOR_GOOD` or `IRREGULAR`
    reason: str  # the same as a clause
    periods: int  # length of a periodic orbit in periods of the excitation; 0 for others
    # times of the impacts of one cycle, the last of the cycle before it first; empty for others;
    # (impacts + 1,)
    tau: Floats
    flight: Floats  # time since the impact before; (impacts + 1,)
    mesh: Ints  # mesh, side: what is struck; (impacts + 1,)
    side: Ints
    before: Floats  # before, after: states just before and just after; (impacts + 1, 2 wheels)
    after: Floats
    contact: tuple[float, ...]  # share of the time in which each mesh is closed

    @property
    def impacts(self) -> int:
        """Impacts of a cycle."""
        return max(self.tau.size - 1, 0)

    @property
    def sticks(self) -> bool:
        """Whether a mesh is closed at times."""
        return max(self.contact) > 0.0

    def same(self, other: "Attractor") -> bool:
        """Whether this is the same attractor, at another time."""
        if (self.kind, self.periods, self.impacts) != (other.kind, other.periods, other.impacts):
            return False
        if self.impacts == 0:
            return bool(np.allclose(self.contact, other.contact))
        speeds, others = (np.sort(struck_speeds(a.mesh[1:], a.before[1:])) for a in (self, other))
        scale = float(np.abs(speeds).max())
        return bool(np.allclose(speeds, others, rtol=1e-5, atol=1e-5 * scale))


def struck_speeds(mesh: Ints, before: Floats) -> Floats:
    """Rate of the gap that is struck at each impact.

    Shapes: `mesh` (impacts,); `before` (impacts, 2 wheels); result (impacts,).
    """
    speeds: Floats = before[np.arange(mesh.size), 2 * mesh - 1]
    return speeds


def _none(kind: str, reason: str, contact: tuple[float, ...]) -> Attractor:
    nothing = Impacts.of(Impacts.empty(0, len(contact)), slice(0))
    return Attractor(kind, reason, 0, *nothing, contact)


def _repeats(orbit: Orbit, end: float, periods: int) -> bool:
    """Whether the orbit repeats itself after a number of periods, at the end."""
    same = 0
    for instant in INSTANTS:
        last, one, two = (orbit.state(end - instant - k * periods * PERIOD) for k in range(3))
        allowed = SAME_STATE * max(np.abs(last).max(), DECAYED)
        same += bool(max(np.abs(last - one).max(), np.abs(one - two).max()) <= allowed)
    return same >= len(INSTANTS) - 1


def attractor(scene: Scene, start: int = 0) -> Attractor:
    """Find where the orbit of a scene ends.

    `start`: 0 for the scene's own start; start number n is the same state at a phase later by n
    times 0.618 periods.
    """
    own = scene.phase_reduced.noise_free
    if start:
        own = replace(
            own, start=replace(own.start, tau=own.phase + start * GOLDEN * PERIOD % PERIOD)
        )
    for impacts in TRIES:
        orbit = follow(own, impacts)
        if orbit.stopped:
            return _end(orbit)
        end = float(orbit.tau[orbit.found])
        if np.abs(orbit.state(end)).max() < DECAYED:
            words = f"comes to rest for good: its motion decays (after impact {orbit.found})"
            return _none(REST_FOR_GOOD, words, (0.0,) * own.stages)
        for periods in range(1, LONGEST_CYCLE + 1):
            if end - own.phase < 4.0 * periods * PERIOD:
                break
            if _repeats(orbit, end, periods):
                return _cycle(orbit, end, periods)
    return _none(
        IRREGULAR,
        f"is chaotic, or has a period of more than {LONGEST_CYCLE} of the excitation",
        (0.0,) * own.stages,
    )


def _end(orbit: Orbit) -> Attractor:
    """An orbit that has no further impact."""
    for code in (REST, NONE):
        if orbit.stopped.startswith(MISSES[code]):
            closed = tuple(
                float(any(s.mesh == m and math.isinf(s.opened) for s in orbit.sticking))
                for m in range(1, orbit.constants.wheels.size + 1)
            )
            words = (
                "comes to rest for good: a mesh stays closed"
                if code == REST
                else "has no further impact"
            )
            return _none(REST_FOR_GOOD, f"{words} (after impact {orbit.found})", closed)
    open_all = (0.0,) * orbit.constants.wheels.size
    return _none(IRREGULAR, f"could not be followed: {orbit.stopped}", open_all)


def _cycle(orbit: Orbit, end: float, periods: int) -> Attractor:
    """One cycle at the end of an orbit."""
    # half a unit of time before an impact, so that none is at the ends of a cycle
    begin = end - 0.5 - periods * PERIOD
    first = last_until(orbit.tau, begin)
    last = last_until(orbit.tau, end - 0.5)
    part = slice(first, last + 1)
    closed = np.zeros(orbit.constants.wheels.size)
    for phase in orbit.sticking:
        closed[phase.mesh - 1] += max(min(phase.opened, end - 0.5) - max(phase.closed, begin), 0.0)
    contact = tuple((closed / (periods * PERIOD)).tolist())
    length = "the period" if periods == 1 else f"{periods} periods"
    impacts = "1 impact" if last - first == 1 else f"{last - first} impacts"
    reason = f"is periodic with {length} of the excitation and {impacts}"
    reason += ", closed at times" if max(contact) > 0.0 else ""
    return Attractor(PERIODIC, reason, periods, *Impacts.of(orbit, part), contact)
