"""What an animation shows: the noise-free orbit and one noisy path over the same time, with their
impacts."""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np

from rattle.montecarlo import Record, Sampling, default_step, simulate
from rattle.montecarlo.settings import is_random, most_impacts
from rattle.scene import Floats, InputError, Ints, Scene, Start, count, state_names
from rattle.scene.drive import PERIOD
from rattle.scene.orbit import Orbit, follow
from rattle.scene.parts import move_to_flanks

Refuse: TypeAlias = Callable[[str], InputError]
"""Makes the error that names what was asked for."""

ANIMATED_SCHEME = "exact-flight"
SHOWN_PERIODS = 4  # by default: 40 s to watch
SETTLED_PERIODS = 64
"""Periods of the noise-free orbit before a settled start: twice the shortest burn-in that a long
run tries."""
MOST_PERIODS = 60  # ten minutes to watch
FEWEST_INSTANTS = 200
MANY_INSTANTS = 1200
INSTANTS_PER_PERIOD = 200
MOST_INSTANTS = 6000
"""Instants between which the drawing goes in straight lines, beside those of the impacts: at least,
of a short time, in a period, at the most."""
MOST_MARKED = 600
"""Impacts of a path that are drawn, the hardest ones: with the instants they leave a file of less
than 1 MB."""
MOST_FOLLOWED = 10**6  # impacts of a path; seconds
MOST_STEPS_SHOWN = 10**7  # some seconds
# what is shown after the last impact: at the most this share of a mean flight, or of the way to the
# next
SHARE_AFTER_LAST = 0.5


@dataclass(frozen=True)
class Motion:
    """One path, as it is drawn: its displacements at instants, and its hardest impacts."""

    # time since the start, increasing; the instants of the impacts are among them; (instants,)
    time: Floats
    x: Floats  # displacement in each gap; (instants, wheels)
    # time of each impact since the start; that of the start itself is not among them; (marked,)
    impact_time: Floats
    impact_x: Floats  # displacement of the mesh that is struck; (marked,)
    code: Ints  # ``mesh * side`` of each impact; (marked,)
    number: Ints  # which impact it is, from 1; (marked,)
    impacts: int  # of all impacts, how many there are


@dataclass(frozen=True)
class Recording:
    """Both paths of an animation."""

    scene: Scene  # what is modelled, with the start of what is shown
    seed: int  # of the noisy path
    settled: int  # periods after the start of the scene at which it begins
    span: float  # time that is shown, from the start on
    step: float  # time between two recorded instants of flight
    orbit: Motion  # orbit, path: the noise-free orbit, and the noisy path
    path: Motion
    agreement: int  # impacts for which both strike the same flanks in the same order

    @property
    def sentence(self) -> str:
        """How many impacts there are, and how long both go together."""
        return (
            f"{self.orbit.impacts} impacts without noise, {self.path.impacts} with noise in the"
            f" same time; the same {self.scene.words.flank}s up to impact {self.agreement}"
        )


def check_recording(scene: Scene, periods: int | None, impacts: int | None, seed: int) -> None:
    """Refuse settings that `record` could not take, before any work."""
    if periods is not None and impacts is not None:
        raise InputError("impacts", impacts, "goes without periods; give one of them")
    if impacts is not None:
        count("impacts", impacts, most=MOST_FOLLOWED)
    count("periods", SHOWN_PERIODS if periods is None else periods, most=MOST_PERIODS)
    count("seed", seed, least=0)
    if not is_random(scene):
        raise InputError(
            "sigma",
            scene.sigma,
            "nothing is random, so both paths are the same; give noise, such as 0.1",
        )


def record(
    scene: Scene, *, periods: int | None = None, impacts: int | None = None, seed: int = 0
) -> Recording:
    """Follow the noise-free orbit, and one noisy path over the same time from the same start.

    The orbit is exact. The noisy path is a sample by exact flights, which have no step bias; its
    state is taken at fixed times and just before each impact.

    `periods`: Of the excitation, from a settled start on; `SHOWN_PERIODS` by default. `impacts`: In
    place of it, the first impacts of the orbit after the start of the scene.
    """
    check_recording(scene, periods, impacts, seed)
    if impacts is None:
        settled = SETTLED_PERIODS
        refuse = partial(InputError, "periods", periods or SHOWN_PERIODS)
        scene = settle(scene, refuse)
        span = PERIOD * (periods or SHOWN_PERIODS)
        orbit = follow_until(scene, span)
        shown = int((orbit.tau[1 : orbit.found + 1] - scene.phase <= span).sum())
    else:
        settled = 0
        shown = impacts
        refuse = partial(InputError, "impacts", impacts)
        orbit = follow(scene.noise_free, impacts + 1)  # one more: the time shown ends before it
        span = _span_of(orbit, scene, impacts, refuse)
    dt = min(default_step(scene, ANIMATED_SCHEME), span / FEWEST_INSTANTS)
    if span / dt > MOST_STEPS_SHOWN:
        raise refuse(f"take {span / dt:.2g} steps of the noisy path; ask for fewer")
    most = min(max(INSTANTS_PER_PERIOD * span / PERIOD, MANY_INSTANTS), MOST_INSTANTS)
    step = dt * math.ceil(span / dt / most)
    instants = step * np.arange(1.0, math.ceil(span / step))
    of_path = _path(scene, seed, shown, span, dt, instants, refuse)
    of_orbit = _orbit(orbit, scene, shown, np.append(instants, span))
    codes = of_orbit.code, of_path.code
    both = min(map(len, codes))
    agreement = int(np.logical_and.accumulate(codes[0][:both] == codes[1][:both]).sum())
    return Recording(
        *(scene, seed, settled, span, step),
        _motion(of_orbit),
        _motion(of_path),
        agreement,
    )


def follow_until(scene: Scene, span: float) -> Orbit:
    """The noise-free orbit through a time from its start on, or as far as it goes."""
    impacts = 256
    while True:
        orbit = follow(scene.noise_free, impacts)
        reached = float(orbit.tau[-1]) - scene.phase
        if orbit.stopped or reached > span or impacts > MOST_FOLLOWED:
            return orbit
        # as its impacts so far have it, and a fourth more; four times as many at the most
        impacts = math.ceil(1.25 * impacts * span / max(reached, 0.3125 * span))


def settle(scene: Scene, refuse: Refuse) -> Scene:
    """The scene from an impact of its noise-free orbit on, `SETTLED_PERIODS` after its start."""
    span = PERIOD * SETTLED_PERIODS
    orbit = follow_until(scene, span + PERIOD)
    walls = orbit.constants.wheels["wall"].tolist()
    for k in np.flatnonzero(orbit.tau[: orbit.found + 1] - scene.phase > span).tolist():
        tau = float(scene.to_absolute_time(orbit.tau[k]))
        start = Start(tau, state=orbit.before[k].tolist(), mesh=int(orbit.mesh[k]))
        with suppress(InputError):  # a state that a random flank could be in
            return replace(scene, start=move_to_flanks(start, walls, _half_gaps(scene)))
    why = orbit.stopped or "no impact of it can be a start"
    remedy = "give a scene that rattles, such as a larger alpha"
    if orbit.found:
        remedy = f"its first impacts can be shown: give impacts, at most {orbit.found}"
    raise refuse(f"the noise-free orbit ends before it settles ({why}); {remedy}")


def _span_of(orbit: Orbit, scene: Scene, impacts: int, refuse: Refuse) -> float:
    """The time that shows some impacts of an orbit, and a little of what comes next."""
    if orbit.found < impacts:
        remedy = "give a scene that rattles, such as a larger alpha"
        if orbit.found:
            remedy = f"give at most {orbit.found}"
        why = orbit.stopped.replace(" after impact 0", "")
        raise refuse(f"the noise-free orbit has {orbit.found} ({why}); {remedy}")
    times = orbit.tau - scene.phase
    tail = SHARE_AFTER_LAST * times[impacts] / impacts
    if orbit.found > impacts:
        tail = min(tail, SHARE_AFTER_LAST * (times[impacts + 1] - times[impacts]))
    span = float(times[impacts] + tail)
    if not span > 0.0:
        raise refuse("the noise-free orbit has all of them at the start; ask for more")
    longest = PERIOD * MOST_PERIODS
    if times[impacts] > longest:
        fewer = max(int((times[1 : impacts + 1] <= longest).sum()), 1)
        raise refuse(f"take over {MOST_PERIODS} periods; give at most {fewer}")
    return min(span, longest)


class RecordedPath(NamedTuple):
    """A path as it was followed: states at instants, and every impact."""

    at: Floats
    x: Floats
    times: Floats
    before: Floats  # states just before the impacts; (impacts, 2 wheels)
    code: Ints


def _orbit(orbit: Orbit, scene: Scene, impacts: int, instants: Floats) -> RecordedPath:
    """The orbit at instants, at its impacts, and where a mesh begins or ceases to stick."""
    sides = orbit.legs[:, 1 + 2 * scene.stages :]
    closed = np.abs(sides).sum(axis=1)
    changing = np.flatnonzero(closed + np.append(0.0, closed[:-1]))
    changes = orbit.legs[changing, 0] - scene.phase
    inside = changes[(changes > 0.0) & (changes < instants[-1])]
    at = np.unique(np.concatenate([[0.0], instants, inside]))
    x = np.array([orbit.state(t + scene.phase)[::2] for t in at])
    shown = slice(1, impacts + 1)
    code = orbit.mesh[shown] * orbit.side[shown]
    return RecordedPath(at, x, orbit.tau[shown] - scene.phase, orbit.before[shown], code)


def _path(
    scene: Scene,
    seed: int,
    impacts: int,
    span: float,
    dt: float,
    instants: Floats,
    refuse: Refuse,
) -> RecordedPath:
    """One noisy path over a time; how many impacts it has in it shows only then.

    White noise after an impact does not depend on what was before: a long path is sampled in parts,
    from the last impact of one to that of the next.
    """
    local = scene.phase_reduced  # its times keep their digits, however late the start is
    gaps = scene.tolerance
    fixed = gaps is None or gaps.distribution == "fixed"
    in_parts = fixed and scene.correlation_time == 0.0
    most = most_impacts(scene)
    room = min(2 * impacts + 200, most) if in_parts else most
    # on the nominal flank, even where the path's own has a tolerance
    at = [np.zeros(1)]
    x = [scene.start_state[None, ::2]]
    displacements = state_names(scene.stages)[::2]
    parts: list[Floats] = []
    begin = 0.0
    while True:
        rest = instants[instants > begin + dt] - begin
        run = simulate(
            local,
            paths=1,
            impacts=room,
            dt=dt,
            scheme=ANIMATED_SCHEME,
            rng=np.random.SeedSequence([seed, len(parts)]) if parts else seed,
            sampling=Sampling(horizon=span - begin + dt),
            # the instants are rounded to the step
            record=Record(times=tuple(local.phase + rest + 1e-6 * dt), raw=True),
        )
        assert run.raw is not None
        rows = run.raw[0].copy()
        rows[:, 0] += begin - local.phase
        states = np.empty((0, scene.stages))
        if rest.size:
            states = run.at_times()[list(displacements)].to_numpy()
        times = run.fixed_times - local.phase + begin
        ends = not rows[-1, 0] <= span  # the path ended, or has all its impacts in that time
        seen = ~np.isnan(states[:, 0]) & (times <= (math.inf if ends else rows[-1, 0]))
        at.append(times[seen])
        x.append(states[seen])
        parts.append(rows[rows[:, 0] <= span])
        if ends:
            break
        room = most
        if not in_parts or len(parts) * room >= MOST_FOLLOWED:
            raise refuse(f"the noisy path has over {sum(map(len, parts))} impacts; ask for fewer")
        begin = float(rows[-1, 0])
        local = _begin_at(local, begin, rows[-1])
    rows = np.concatenate(parts)
    code = rows[:, -1].astype(np.int64)
    return RecordedPath(np.concatenate(at), np.concatenate(x), rows[:, 0], rows[:, 2:-1], code)


def _half_gaps(scene: Scene) -> list[float]:
    """The nominal half gap of each wheel."""
    return [wheel.gap for wheel in scene.tree]


def _begin_at(scene: Scene, begin: float, row: Floats) -> Scene:
    """The scene from an impact of a path on, whose row has the state just before it."""
    mesh = abs(int(row[-1]))
    walls = scene.constants.wheels["wall"].tolist()
    state = row[2:-1].tolist()
    at = 2 * mesh - 2
    state[at] = math.copysign(walls[mesh - 1], state[at])
    struck = Start(begin, state=state, mesh=mesh)
    start = move_to_flanks(struck, walls, _half_gaps(scene))
    return replace(scene, start=start).phase_reduced


def _motion(path: RecordedPath) -> Motion:
    """A path as it is drawn: of the impacts the hardest, and of two states at one time that of the
    impact."""
    number = np.arange(len(path.times))
    mesh = np.abs(path.code) - 1
    speed = np.abs(path.before[number, 2 * mesh + 1])
    marked = np.sort(np.argsort(-speed, kind="stable")[:MOST_MARKED])
    before = path.before[marked, ::2]
    times = path.times[marked]
    together = np.concatenate([times, path.at])
    order = np.unique(together, return_index=True)[1]
    struck = before[np.arange(len(marked)), mesh[marked]]
    return Motion(
        *(together[order], np.concatenate([before, path.x])[order], times, struck),
        path.code[marked],
        marked + 1,
        len(path.times),
    )
