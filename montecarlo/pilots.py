"""What an accuracy takes, from small runs sent ahead: which scheme, what step, how many paths.

A pilot follows a few scouts that show what a path takes, so that a budget is not spent on a scene of slow paths unseen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from rattle.montecarlo.accuracy import LEAST, sampling_error, small_noise, step_error
from rattle.montecarlo.budget import Budget, clock
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.reach import Candidate
from rattle.montecarlo.result import Ensemble
from rattle.montecarlo.schemes.step_size import largest_step
from rattle.montecarlo.schemes.table import SCHEMES
from rattle.montecarlo.settings import computed, default_horizon, is_random
from rattle.scene.scene import Scene

__all__ = ["COARSEST", "ROUGHEST", "Sent", "Simulate", "chosen", "pilot"]

SCOUTS = (8, 256)  # paths sent before a pilot: their time tells whether more can be paid
PILOT = 4 * BLOCK
COARSEST = 4  # of the steps that run side by side for the bias, in units of the finest
FIRST_STEP = 0.01  # of the pilots of Euler and Maruyama, if the scene lets it through
ENOUGH = 5.0  # core-seconds of exact flights below which nothing cheaper is looked for: pilots take as long
GLANCE = 0.01  # share of the horizon in which the first scouts are looked at
ALONE = 32.0  # paths that, side by side, take a step in the time of one path
STICKING_NS = 110.0  # of a step in which a mesh is held shut, measured
ROUGHEST = 1e3  # accuracy, in sds, beyond which there is none

Simulate = Callable[..., Ensemble]


def pilot(scene: Scene, scheme: str, simulate: Simulate) -> Ensemble:
    """A small run that shows what accuracy takes: spread, and for a scheme with a step bias that bias."""
    return simulate(paths=PILOT, **_pilot_settings(scene, scheme))


def _pilot_settings(scene: Scene, scheme: str) -> dict[str, Any]:
    exact = SCHEMES[scheme].weak_order is None
    levels = 1 if exact else COARSEST
    dt = min(SCHEMES[scheme].step if exact else FIRST_STEP, 0.99 * largest_step(scene, scheme)[0] / levels)
    return {"scheme": scheme, "dt": dt, "step_bias": not exact, "control": exact and small_noise(scene)}


@dataclass(frozen=True)
class Sent:
    """What was sent ahead by a scheme, and what it says of any accuracy.

    Attributes
    ----------
    run : Ensemble
        The pilot; where the budget had none for it, the last scout that it had.
    path_seconds : float
        What a path of it took, or on one core should have if that is more.
    whole : bool
        Whether it is the pilot.
    """

    run: Ensemble
    path_seconds: float
    whole: bool

    @cached_property
    def errors(self) -> tuple[float, float]:
        """Largest standard error, and largest bias of the step."""
        exact = SCHEMES[self.run.scheme].weak_order is None
        return sampling_error(self.run)[0], 0.0 if exact else step_error(self.run)[0]

    def at(self, accuracy: float) -> Candidate:
        """Step, paths and work that an accuracy takes."""
        run, (error, bias) = self.run, self.errors
        dt = run.dt
        if SCHEMES[run.scheme].weak_order is not None:  # half of what is allowed: order 1 is that of the limit dt -> 0
            dt *= min(1.0, max(0.5 * accuracy / max(bias, 1e-300), 1e-100))
        share = min(error / accuracy, 1e100)
        paths = max(LEAST // BLOCK, math.ceil(run.paths * share**2 / BLOCK)) * BLOCK
        paths = computed(run.scene, paths)
        return Candidate(run.scheme, dt, paths, 1e-9 * _nanoseconds(run, dt) * paths)

    def within(self, core_seconds: float, accuracy: float) -> float:
        """The finest accuracy, not below this one, that so much work is expected to give; infinite if none."""
        while (share := self.at(accuracy).core_seconds / max(core_seconds, 1e-9)) > 1.0:
            accuracy *= max(1.01, share ** (1.0 / 3.0))  # work grows with a power of 2 or 3: this stays below
            if accuracy > ROUGHEST:
                return math.inf
        return accuracy


def _nanoseconds(run: Ensemble, dt: float) -> float:
    """Nominal time of a path like those of a run, at a step; the same on every machine."""
    kind, finer = SCHEMES[run.scheme], run.dt / dt
    steps = run.path_steps / run.plan.paths * run.dt / dt  # of all step sizes
    steps *= ALONE if run.plan.paths == 1 else 1.0
    work = steps * kind.step_ns + run.impacts * kind.impact_ns * (1.0 if kind.weak_order is None else 3.0)
    return work + run.sticking_steps / run.plan.paths * finer * STICKING_NS


def sent_ahead(scene: Scene, scheme: str, simulate: Simulate, budget: Budget, workers: int) -> Sent:
    """Send a scheme's pilot, after scouts, each if the budget is expected to last for it."""
    settings = _pilot_settings(scene, scheme)
    with budget.uncounted():
        simulate(paths=1, **settings | {"impacts": 1, "horizon": settings["dt"]})  # compiles

    def timed(**changed: Any) -> tuple[Ensemble, float]:
        began = clock()
        return simulate(**settings | changed), clock() - began

    for _ in range(2):  # what a run takes before its first path, once its plan is made
        run, before = timed(paths=1, horizon=settings["dt"])
    horizon = default_horizon(run.impacts, run.dt * (COARSEST if settings["step_bias"] else 1))
    glance, _ = timed(paths=computed(scene, SCOUTS[0]), horizon=GLANCE * horizon)
    slow = 1e-9 * _nanoseconds(glance, glance.dt) / GLANCE
    if glance.unfinished and slow * glance.paths > budget.left:
        return Sent(glance, slow, False)
    followed, sent = 0, None
    for paths in (*SCOUTS, PILOT) if is_random(scene) else (1,):
        if sent is not None and sent.path_seconds * paths / min(workers, -(-paths // BLOCK)) > budget.left:
            break
        run, seconds = timed(paths=paths)
        took = max(1e-9 * _nanoseconds(run, run.dt), (seconds - before) / (paths - followed))
        sent = Sent(run, took, run.paths == computed(scene, PILOT))
        before, followed = seconds, paths
    assert sent is not None
    return sent


def chosen(
    scene: Scene, names: Sequence[str], accuracy: float, simulate: Simulate, budget: Budget, workers: int
) -> tuple[Sent, list[Candidate]]:
    """The scheme that is expected to cost least, and what each that was tried is."""
    sent = [sent_ahead(scene, names[0], simulate, budget, workers)]
    if sent[0].whole and sent[0].at(accuracy).core_seconds > ENOUGH:
        for name in names[1:]:
            if budget.left > 0.0:
                sent.append(sent_ahead(scene, name, simulate, budget, workers))
    tried = [sent[0], *(s for s in sent[1:] if s.whole)]
    candidates = [s.at(accuracy) for s in tried]
    return min(zip(tried, candidates, strict=True), key=lambda pair: pair[1].core_seconds)[0], candidates
