"""Long records of the orbit or of a noisy path, in stretches: without transients, with completed chatter recognised.

Chatter is an infinite sequence of impacts at one mesh in finite time; when it is completed, the mesh sticks.
"""

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

DISCARD = 1000  # impacts after each start that are discarded as a transient
CHUNK = 50_000  # impacts of an orbit at a time
STEPS = 100_000  # steps of a noisy path at a time
TRIAL = 20_000  # computed impacts after which an orbit with too few recorded ones is given up
ROUNDED = 1e-6  # speed below which rounding breaks the monotonic decrease of impact speeds in chatter
WORTH = 0.25  # smallest share of the computed impacts that must have been recorded by then


@dataclass
class Regime:
    """What an orbit or a path did while it was recorded; filled in as the record is read.

    Attributes
    ----------
    impacts : int
        Recorded impacts: after transients, and without chatter that ends in sticking.
    computed : int
        All impacts that were computed.
    starts, stuck : int
        Number of starts, and of those that ended in sticking.
    silent : bool
        Whether the motion ended without a further impact.
    sticking_steps : int
        Steps of a noisy path that it spent sticking.
    gave_up : bool
        Whether the record was given up because too few impacts could be recorded.
    transient : int
        Impacts that were removed later as a transient.
    """

    impacts: int = 0
    computed: int = 0
    starts: int = 0
    stuck: int = 0
    silent: bool = False
    sticking_steps: int = 0
    gave_up: bool = False
    transient: int = 0

    @property
    def kind(self) -> str:
        """``runs`` (impacts go on), ``sticks at times``, ``sticks`` (for good) or ``silent`` (no further impact)."""
        if self.silent:
            return "silent"
        if self.gave_up:
            return "sticks"
        return "sticks at times" if self.stuck else "runs"

    @property
    def reason(self) -> str:
        """The kind of motion as a clause with numbers."""
        life = f"{self.computed / max(self.stuck, 1):,.0f} impacts"
        transient = f", the first {self.transient:,} of them a transient" if self.transient else ""
        return {
            "runs": f"ran through all {self.computed:,} impacts{transient}",
            "sticks at times": f"completes chatter and sticks once in {life}; restarted {self.starts - 1} times, the "
            f"exponents are those of the motion between{transient}",
            "sticks": f"completes chatter and sticks after {life} on average, from each of {self.starts} starts: "
            "there is no stationary motion to measure",
            "silent": f"ends: {MISSES[NONE]}",
        }[self.kind]


def check_finite(name: str, values: Floats, offset: int = 0) -> Floats:
    """Return an array unchanged if all of its values are finite.

    Parameters
    ----------
    name : str
        Name of the array in the error message.
    values : ndarray
        The values.
    offset : int
        Added to the first index in the error message, for arrays that are parts of a record.

    Returns
    -------
    ndarray
        `values`.

    Raises
    ------
    InputError
        If a value is not finite; the message names its index.

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
    """Record the orbit of a scene in stretches; after sticking it is restarted at another phase.

    Parameters
    ----------
    scene : Scene
        Its noise is not used.
    impacts : int
        Impacts to record in all.
    regime : Regime
        Filled in while the stretches are read.
    tangent : bool
        Whether tangent vectors are propagated too.

    Yields
    ------
    Stretch

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
        regime.computed += orbit.stretch(DISCARD, tangent).flight.size
        while regime.impacts < impacts and orbit.ended > 0:
            s = orbit.stretch(min(CHUNK, impacts - regime.impacts), tangent)
            regime.computed += s.flight.size
            if orbit.ended <= 0:
                s = s.first(_accumulating(s))
            regime.impacts += s.flight.size
            if s.flight.size:
                yield s
        regime.stuck += orbit.ended < 0
        if orbit.ended == NONE:
            regime.silent = True
            return
        if regime.computed >= TRIAL and regime.impacts < WORTH * regime.computed:
            regime.gave_up = True
            return


def _accumulating(s: Stretch) -> int:
    """Number of impacts before the final chatter, in which each impact is slower than the last on the same flank."""
    if s.code.size == 0:
        return 0
    every = np.abs(s.before[:, 1 if abs(s.code[-1]) == 1 else 3])
    same = np.flatnonzero((s.code == s.code[-1]) & (every > ROUNDED))
    rising = np.flatnonzero(every[same][1:] >= every[same][:-1])
    return int(same[rising[-1] + 1]) if rising.size else 0


def noisy_record(
    scene: Scene, steps: int, seed: int, regime: Regime, *, path: int = 0, tangent: bool = True, settle: float = 500.0
) -> Iterator[tuple[Stretch, Floats]]:
    """Record a noisy path of a scene in stretches.

    Parameters
    ----------
    scene : Scene
        What is modelled.
    steps : int
        Steps to record in all; 2 pi / 128 each, or less for strong damping (`rattle.montecarlo.coupling.dyadic`).
    seed, path : int
        Seed of the noise, and index of the path.
    regime : Regime
        Filled in while the stretches are read.
    tangent : bool
        Whether tangent vectors of the drift's linearisation are propagated too.
    settle : float
        Initial time that is discarded as a transient.

    Yields
    ------
    stretch : Stretch
    velocities : ndarray, shape (steps, 2)
        ``(y1, y2)`` at the start of each step.
    """
    walker = LongPath(scene, seed, path)
    walker.stretch(math.ceil(settle / walker.step), tangent, velocities=False)
    regime.starts += 1
    done = 0
    while done < steps:
        before = walker.steps
        s, velocity = walker.stretch(min(STEPS, steps - done), tangent)
        done += walker.steps - before
        regime.computed += s.flight.size
        regime.impacts += s.flight.size
        regime.sticking_steps = walker.sticking_steps
        if s.flight.size == 0:
            regime.silent = True
            return
        yield s, velocity
