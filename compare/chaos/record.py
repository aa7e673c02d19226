"""Long records of the orbit or of a noisy path, in stretches: without transients, with completed
chatter recognised.

Chatter is an infinite sequence of impacts at one mesh in finite time; when it is completed, the
mesh sticks.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from rattle.compare.report.render import render_text
from rattle.montecarlo.coupling.paths import LongPath
from rattle.scene import Floats, InputError, RattleError, Scene, count
from rattle.scene.impact import MISSES, NONE
from rattle.scene.long_orbit import LongOrbit
from rattle.scene.orbit import follow
from rattle.scene.tangent import Stretch
from rattle.scene.text import line

T = TypeVar("T")
R = TypeVar("R")
DISCARD = 1000  # impacts after each start that are discarded as a transient
ORBIT_CHUNK = 50_000  # impacts of an orbit at a time
STEPS_AT_A_TIME = 100_000  # steps of a noisy path at a time
SETTLE = 500.0  # time after which a noisy path is recorded
TRIAL = 20_000  # computed impacts after which an orbit with too few recorded ones is given up
# speed below which rounding breaks the monotonic decrease of impact speeds in chatter
SLOWEST_IN_CHATTER = 1e-6
# smallest share of the computed impacts that must have been recorded by then
LEAST_RECORDED_SHARE = 0.25

RUNS = "runs"
STICKS_AT_TIMES = "sticks at times"
STICKS_OFTEN = "sticks often"
STICKS_FOR_GOOD = "sticks for good"
SILENT = "silent"
NOT_FOLLOWED = "not followed"
"""Kinds of motion: impacts go on; so they do between rare sticking phases; between phases so
frequent that there is no record of the motion between; a mesh stays closed; there is no further
impact; this method cannot follow it."""


class NoRecord(RattleError):
    """A result that the motion of these gears does not have; the message is the reason, as a
    clause."""


@contextmanager
def leave_out(missing: dict[str, str] | None, what: str) -> Iterator[None]:
    """Note what these gears do not have, with the reason, in place of an error."""
    try:
        yield
    except (InputError, NoRecord) as reason:
        if missing is not None:
            missing[what] = str(reason)


def in_threads(workers: int, work: Callable[[T], R], given: Iterable[T]) -> list[R]:
    """The results of some work on each of what is given, in order, whatever the number of
    threads."""
    with ThreadPoolExecutor(count("workers", workers)) as pool:
        return list(pool.map(work, given))


@dataclass
class Regime:
    """What an orbit or a path did while it was recorded; filled in as the record is read."""

    # recorded impacts: after transients, and without chatter that ends in sticking
    impacts: int = 0
    computed: int = 0  # all impacts that were computed
    starts: int = 0  # starts, stuck: number of starts, and of those that ended in sticking
    stuck: int = 0
    steps: int = 0  # steps, sticking_steps: steps of a noisy path, and those that it spent sticking
    sticking_steps: int = 0
    end: str = ""  # the kind of motion of which there is no record; empty if there is one
    # of an orbit that was given up: share of the time in which a mesh is closed
    closed: float = 0.0
    transient: int = 0  # impacts that were removed later as a transient
    who: str = "orbit"  # what moves: the orbit, or a noisy path
    unfollowed: str = ""  # why this method cannot follow the motion; empty if it can

    def give_up(self) -> None:
        """Leave out a record in whose growth rates rounding shows."""
        self.end = STICKS_OFTEN if self.sticking_steps > 0 else NOT_FOLLOWED
        self.unfollowed = "brings neighbours together faster than double precision resolves"

    @property
    def kind(self) -> str:
        """The kind of motion, from `RUNS` to `NOT_FOLLOWED`."""
        return self.end or (STICKS_AT_TIMES if self.stuck or self.sticking_steps else RUNS)

    @property
    def has_record(self) -> bool:
        """Whether enough was recorded: impacts go on, and sticking phases are far apart or
        absent."""
        return not self.end

    @property
    def reason(self) -> str:
        """The kind of motion as a clause with numbers."""
        noisy = self.sticking_steps > 0 and self.kind in (STICKS_AT_TIMES, STICKS_OFTEN)
        text = render_text("chaos/motion.j2", r=self, noisy=noisy, silent=MISSES[NONE])
        return line(text)

    @property
    def brief(self) -> str:
        """The reason in few words where sticking is one."""
        return self.reason if self.end in (SILENT, NOT_FOLLOWED) else self.kind

    def require(self) -> None:
        """Raise the reason where there is no record."""
        if not self.has_record:
            raise NoRecord(f"the {self.who} {self.brief}")


def orbit_record(
    scene: Scene, impacts: int, regime: Regime, *, tangent: bool = True
) -> Iterator[Stretch]:
    """Record the orbit of a scene in stretches; after sticking it is restarted at another phase."""
    while regime.impacts < impacts:
        orbit = LongOrbit(scene, regime.starts)
        regime.starts += 1
        regime.computed += orbit.stretch(DISCARD, tangent).flight.size
        while regime.impacts < impacts and orbit.ended > 0:
            s = orbit.stretch(min(ORBIT_CHUNK, impacts - regime.impacts), tangent)
            regime.computed += s.flight.size
            if orbit.ended <= 0 and s.flight.size:
                s = s.first(_accumulating(s))
            regime.impacts += s.flight.size
            if s.flight.size:
                yield s
        regime.stuck += orbit.ended < 0
        if orbit.ended == NONE:
            regime.end = SILENT
            return
        if regime.computed >= TRIAL and regime.impacts < LEAST_RECORDED_SHARE * regime.computed:
            regime.closed, regime.end = _measure_sticking(scene)
            return


def _measure_sticking(scene: Scene) -> tuple[float, str]:
    """Largest share of the time in which a mesh is closed along the orbit, and whether it sticks
    often or for good."""
    orbit = follow(scene, TRIAL)
    if orbit.stopped:
        return math.nan, STICKS_FOR_GOOD
    end = orbit.tau[-1]
    closed = [
        sum(min(s.opened, end) - s.closed for s in orbit.sticking if s.mesh == mesh)
        for mesh in range(1, scene.stages + 1)
    ]
    return max(closed) / (end - orbit.tau[0]), STICKS_OFTEN


def _accumulating(s: Stretch) -> int:
    """Number of impacts before the final chatter, in which each impact is slower than the last on
    the same flank."""
    last = s.code[-1]
    speed = np.abs(s.before[:, 2 * abs(last) - 1])
    same = np.flatnonzero((s.code == last) & (speed > SLOWEST_IN_CHATTER))
    rising = np.flatnonzero(np.diff(speed[same]) >= 0.0)
    return same[rising[-1] + 1] if rising.size else 0


def noisy_record(
    scene: Scene,
    seed: int,
    regime: Regime,
    *,
    impacts: int = 0,
    steps: int = 0,
    path: int = 0,
    tangent: bool = True,
) -> Iterator[tuple[Stretch, Floats]]:
    """Record a noisy path of a scene in stretches, with its velocities at each step.

    `impacts`, `steps`: Least impacts and steps to record in all. A step is 2 pi / 128, or less for
    strong damping (`rattle.montecarlo.coupling.dyadic`). Shapes: `velocities` (steps,
    wheels).
    """
    regime.who = "noisy path"
    if scene.tolerance is not None and scene.tolerance.distribution != "fixed":
        regime.unfollowed = "has random gaps; long paths need fixed ones"
    elif scene.correlation_time:
        regime.unfollowed = "has noise with memory; long paths need white noise"
    if regime.unfollowed:
        regime.end = NOT_FOLLOWED
        return
    walker = LongPath(scene, seed, path)
    walker.stretch(math.ceil(SETTLE / walker.step), tangent, velocities=False)
    settled = walker.sticking_steps
    regime.starts += 1
    while regime.impacts < impacts or regime.steps < steps:
        s, velocity = walker.stretch(STEPS_AT_A_TIME, tangent)
        regime.computed += s.flight.size
        regime.impacts += s.flight.size
        regime.steps += len(velocity)
        regime.sticking_steps = walker.sticking_steps - settled
        if s.flight.size == 0:
            regime.end = SILENT
            return
        yield s, velocity


def read_orbit(scene: Scene, impacts: int) -> Iterator[Stretch]:
    """The record of an orbit without tangents; raises the reason where it has none."""
    regime = Regime()
    yield from orbit_record(scene, impacts, regime, tangent=False)
    regime.require()


def read_path(
    scene: Scene, seed: int, path: int, *, impacts: int, steps: int = 0
) -> Iterator[tuple[Stretch, Floats]]:
    """The record of a noisy path without tangents; raises the reason where it has none."""
    regime = Regime()
    yield from noisy_record(
        scene, seed, regime, impacts=impacts, steps=steps, path=path, tangent=False
    )
    regime.require()
