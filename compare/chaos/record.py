"""Long records of either side, a stretch at a time: transients left out, rests recognised and counted."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rattle.closure.long_orbit import LongOrbit
from rattle.montecarlo.coupling.long_path import LongPath
from rattle.scene.errors import InputError
from rattle.scene.impact import MISSES, NONE
from rattle.scene.scene import Scene
from rattle.scene.tangent import Stretch

__all__ = ["DISCARD", "Regime", "check_finite", "noisy_record", "orbit_record"]

Floats = NDArray[np.float64]

DISCARD = 1000  # impacts after each start that are not looked at
CHUNK = 50_000  # impacts of an orbit at a time
STEPS = 100_000  # of a noisy path at a time
TRIAL = 20_000  # impacts after which an orbit that is at rest most of its time is given up
ROUNDED = 1e-6  # speed below which impacts that accumulate no longer slow down one by one, for rounding
WORTH = 0.25  # share of the impacts that must be of use by then


@dataclass
class Regime:
    """What an orbit or a path did while it was recorded; filled in as the record is read.

    Attributes
    ----------
    impacts : int
        Recorded, after transients and without what leads to a rest.
    launched : int
        All impacts that were computed.
    starts, stuck : int
        Starts, and how many of them ended sticking for good.
    silent : bool
        Whether an orbit ended without a next impact.
    sticking_steps : int
        Steps of a noisy path in which it was held at a wall.
    gave_up : bool
        Whether the record was given up because next to nothing of it was of use.
    transient : int
        Impacts that were left out later, because the motion had not settled.
    """

    impacts: int = 0
    launched: int = 0
    starts: int = 0
    stuck: int = 0
    silent: bool = False
    sticking_steps: int = 0
    gave_up: bool = False
    transient: int = 0

    @property
    def kind(self) -> str:
        """``runs``, ``rests at times``, ``rests`` or ``silent``."""
        if self.silent:
            return "silent"
        if self.gave_up:
            return "rests"
        return "rests at times" if self.stuck else "runs"

    @property
    def reason(self) -> str:
        """The same as a sentence."""
        life = f"{self.launched / max(self.stuck, 1):,.0f} impacts"
        settled = f", the first {self.transient:,} of them another motion" if self.transient else ""
        return {
            "runs": f"ran through all {self.launched:,} impacts{settled}",
            "rests at times": f"impacts accumulate and a mesh rests closed once in {life}; begun anew "
            f"{self.starts - 1} times, exponents hold while it runs{settled}",
            "rests": f"impacts accumulate and a mesh rests closed after {life} on average, from each of {self.starts} "
            "starts: there is no stationary motion to measure",
            "silent": f"{MISSES[NONE]}: it no longer strikes",
        }[self.kind]


def check_finite(name: str, values: Floats, offset: int = 0) -> Floats:
    """The values, if all are finite.

    Raises
    ------
    InputError
        Names the first place at which one is not.

    Examples
    --------
    >>> check_finite("y1", np.array([0.0, np.nan]))
    Traceback (most recent call last):
        ...
    rattle.scene.errors.InputError: y1[1] = nan: give finite values
    """
    bad = ~np.isfinite(values)
    if bad.any():
        place = tuple(int(i[0]) for i in np.nonzero(bad))
        shown = ", ".join(str(i + (offset if n == 0 else 0)) for n, i in enumerate(place))
        raise InputError(f"{name}[{shown}]", float(values[place]), "give finite values")
    return values


def orbit_record(scene: Scene, impacts: int, regime: Regime, *, tangent: bool = True) -> Iterator[Stretch]:
    """Stretches of the orbit of a scene, `impacts` impacts in all, begun anew at another phase where it comes to rest.

    Parameters
    ----------
    scene : Scene
        Noise is not used.
    impacts : int
    regime : Regime
        Output.
    tangent : bool
        Whether neighbours are followed too.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> regime = Regime()
    >>> sum(s.flight.size for s in orbit_record(Scene.from_gears(DAT21), 5000, regime)), regime.kind
    (5000, 'runs')
    """
    while regime.impacts < impacts:
        orbit = LongOrbit(scene, regime.starts)
        regime.starts += 1
        regime.launched += orbit.stretch(DISCARD, tangent).flight.size
        while regime.impacts < impacts and orbit.ended > 0:
            s = orbit.stretch(min(CHUNK, impacts - regime.impacts), tangent)
            regime.launched += s.flight.size
            if orbit.ended <= 0:
                s = s.first(_accumulating(s))
            regime.impacts += s.flight.size
            if s.flight.size:
                yield s
        regime.stuck += orbit.ended < 0
        if orbit.ended == NONE:
            regime.silent = True
            return
        if regime.launched >= TRIAL and regime.impacts < WORTH * regime.launched:
            regime.gave_up = True
            return


def _accumulating(s: Stretch) -> int:
    """Number of impacts before those that accumulate at the end: each slower than the last one on the same flank."""
    if s.code.size == 0:
        return 0
    every = np.abs(s.before[:, 1 if abs(s.code[-1]) == 1 else 3])
    same = np.flatnonzero((s.code == s.code[-1]) & (every > ROUNDED))
    rising = np.flatnonzero(every[same][1:] >= every[same][:-1])
    return int(same[rising[-1] + 1]) if rising.size else 0


def noisy_record(
    scene: Scene, steps: int, seed: int, regime: Regime, *, path: int = 0, tangent: bool = True, settle: float = 500.0
) -> Iterator[tuple[Stretch, Floats]]:
    """Stretches of a noisy path of a scene, `steps` steps in all, each with the velocities at the start of its steps.

    Parameters
    ----------
    scene : Scene
    steps : int
        2 pi / 128 each, or less where damping asks for it (`rattle.montecarlo.coupling.dyadic`).
    seed, path : int
        Which path.
    regime : Regime
        Output.
    tangent : bool
        Whether the frame of the drift's linearisation is followed too.
    settle : float
        Time that is not looked at.
    """
    walker = LongPath(scene, seed, path)
    walker.stretch(math.ceil(settle / walker.step), tangent, velocities=False)
    regime.starts += 1
    done = 0
    while done < steps:
        before = walker.steps
        s, velocity = walker.stretch(min(STEPS, steps - done), tangent)
        done += walker.steps - before
        regime.launched += s.flight.size
        regime.impacts += s.flight.size
        regime.sticking_steps = walker.sticking_steps
        if s.flight.size == 0:
            regime.silent = True
            return
        yield s, velocity
