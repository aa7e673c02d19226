"""What an animation shows: the noise-free orbit and one noisy path over the same time, with their
impacts."""

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from rattle.montecarlo import Record, Sampling, default_step, simulate
from rattle.montecarlo.settings import is_random
from rattle.scene import Floats, InputError, Ints, Scene, count
from rattle.scene.orbit import Orbit, follow

ANIMATED_SCHEME = "exact-flight"
MOST_IMPACTS_SHOWN = 200
"""Most impacts of the orbit that an animation shows; more would take minutes to watch."""
FEWEST_INSTANTS = 200
MOST_INSTANTS = 1200
"""Instants between which the drawing goes in straight lines, beside those of the impacts: at least,
at the most."""
# impacts that still leave a file of less than 1 MB; steps of some seconds
MOST_DRAWN = 2000
MOST_STEPS_SHOWN = 10**7
# what is shown after the last impact: at the most this share of a mean flight, or of the way to the
# next
SHARE_AFTER_LAST = 0.5


@dataclass(frozen=True)
class Motion:
    """One path, as it is drawn: its displacements at instants, and its impacts."""

    # time since the start, increasing; the instants of the impacts are among them; (instants,)
    time: Floats
    x1: Floats  # x1, x2: relative displacements; `x2` is NaN for a single stage; (instants,)
    x2: Floats
    # time of each impact since the start; that of the start itself is not among them; (impacts,)
    impact_time: Floats
    impact_x: Floats  # displacement of the mesh that is struck; (impacts,)
    code: Ints  # ``mesh * side`` of each impact; (impacts,)

    @property
    def impacts(self) -> int:
        """Number of impacts."""
        return len(self.impact_time)


@dataclass(frozen=True)
class Recording:
    """Both paths of an animation."""

    scene: Scene  # what is modelled
    seed: int  # of the noisy path
    span: float  # time that is shown, from the start on
    step: float  # time between two recorded instants of flight
    orbit: Motion  # orbit, path: the noise-free orbit, and the noisy path
    path: Motion

    @property
    def agreement(self) -> int:
        """Number of impacts for which both strike the same flanks in the same order."""
        both = min(self.orbit.impacts, self.path.impacts)
        return int(np.logical_and.accumulate(self.orbit.code[:both] == self.path.code[:both]).sum())

    @property
    def sentence(self) -> str:
        """How many impacts there are, and how long both go together."""
        return (
            f"{self.orbit.impacts} impacts without noise, {self.path.impacts} with noise in the"
            f" same time; the same flanks up to impact {self.agreement}"
        )


def check_recording(scene: Scene, impacts: int, seed: int) -> None:
    """Refuse settings that `record` could not take, before any work."""
    count("impacts", impacts, most=MOST_IMPACTS_SHOWN)
    count("seed", seed, least=0)
    if not is_random(scene):
        raise InputError(
            "sigma",
            scene.sigma,
            "nothing is random, so both paths are the same; give noise, such as 0.1",
        )


def record(scene: Scene, *, impacts: int = 24, seed: int = 0) -> Recording:
    """Follow the noise-free orbit through a number of impacts, and one noisy path over the same
    time.

    The orbit is exact. The noisy path is a sample by exact flights, which have no step bias; its
    state is taken at fixed times and just before each impact.

    `impacts`: Impacts of the orbit after the start, at most `MOST_IMPACTS_SHOWN`; the path has as
    many as it has in that time.
    """
    check_recording(scene, impacts, seed)
    refuse = partial(InputError, "impacts", impacts)
    orbit = follow(scene.noise_free, impacts + 1)  # one more: the time shown ends before it
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
    dt = min(default_step(scene, ANIMATED_SCHEME), span / FEWEST_INSTANTS)
    if span / dt > MOST_STEPS_SHOWN:
        raise refuse(f"take {span / dt:.2g} steps of the noisy path; ask for fewer")
    step = dt * math.ceil(span / dt / MOST_INSTANTS)
    instants = step * np.arange(1.0, MOST_INSTANTS + 1.0)
    instants = instants[instants < span]
    path = _path(scene, seed, impacts, span, dt, instants)
    if path.impacts > MOST_DRAWN:
        fewer = max(int((times[1 : impacts + 1] + tail <= path.impact_time[MOST_DRAWN]).sum()), 1)
        raise refuse(
            f"the other path has over {MOST_DRAWN} impacts in that time, more than can be told"
            f" apart; give {fewer if fewer < impacts else 'a larger epsilon'}"
        )
    drawn = _orbit(orbit, scene, impacts, np.append(instants, span))
    return Recording(scene, seed, span, float(instants[0]), drawn, path)


def _orbit(orbit: Orbit, scene: Scene, impacts: int, instants: Floats) -> Motion:
    """The orbit at instants, at its impacts, and where a mesh begins or ceases to stick."""
    legs = orbit.legs[:, 0] - scene.phase
    at = np.unique(np.concatenate([[0.0], instants, legs[(legs > 0.0) & (legs < instants[-1])]]))
    x = np.array([orbit.state(t + scene.phase)[::2] for t in at])
    shown = slice(1, impacts + 1)
    code = orbit.mesh[shown] * orbit.side[shown]
    return _motion(scene, at, x, orbit.tau[shown] - scene.phase, orbit.before[shown, ::2], code)


def _path(
    scene: Scene, seed: int, impacts: int, span: float, dt: float, instants: Floats
) -> Motion:
    """One noisy path over a time; how many impacts it has in it shows only then.

    With more than `MOST_DRAWN` it may end before.
    """
    local = scene.phase_reduced  # its times keep their digits, however late the start is
    # on the nominal flank, even where the path's own has a tolerance
    start = np.array(scene.start_state)[::2]
    room = 2 * impacts + 20
    while True:
        run = simulate(
            local,
            paths=1,
            impacts=room,
            dt=dt,
            scheme=ANIMATED_SCHEME,
            rng=seed,
            sampling=Sampling(horizon=span + dt),
            # the instants are rounded to the step
            record=Record(times=tuple(local.phase + instants + 1e-6 * dt), raw=True),
        )
        assert run.raw is not None
        rows = run.raw[0]
        # the path ended, or has all its impacts in that time, or more than are drawn
        if not rows[-1, 0] - scene.phase <= span or room > MOST_DRAWN:
            break
        room *= 3
    rows = rows[rows[:, 0] - scene.phase <= span]
    states = run.at_times()[["x1", "x2"]].to_numpy()
    seen = np.flatnonzero(~np.isnan(states[:, 0]))
    at = np.concatenate([[0.0], run.fixed_times[seen] - local.phase])
    x = np.vstack([start, states[seen]])
    code = rows[:, 6].astype(np.int64)
    return _motion(scene, at, x, rows[:, 0] - scene.phase, rows[:, [2, 4]], code)


def _motion(
    scene: Scene, at: Floats, x: Floats, times: Floats, before: Floats, code: Ints
) -> Motion:
    """States at instants and at impacts, in order of time; of two at one time the impact's is
    kept."""
    together = np.concatenate([times, at])
    order = np.unique(together, return_index=True)[1]
    states = np.concatenate([before, x])[order]
    x1, x2 = states.T
    struck = before[np.arange(len(times)), np.abs(code) - 1]
    if scene.stages == 1:
        x2 = np.full(len(order), np.nan)
    return Motion(together[order], x1, x2, times, struck, code)
