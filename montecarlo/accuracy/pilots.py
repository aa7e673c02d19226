"""Pilot runs: which scheme, what step and how many paths an accuracy takes.

A pilot run is preceded by short probe runs that measure the time of a path, so that slow paths
cannot use up the budget before their cost is known.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from rattle.montecarlo.accuracy.cost import cost_of, cost_to, expect_paths
from rattle.montecarlo.diagnostics.accuracy import FEWEST_PATHS, small_noise
from rattle.montecarlo.diagnostics.reach import Candidate
from rattle.montecarlo.ensemble.result import Ensemble
from rattle.montecarlo.ensemble.simulate import extend
from rattle.montecarlo.ensemble.simulate_rare import begin_rare
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.kernel.blocks import Blocks, Budget, clock
from rattle.montecarlo.schemes.step_size import (
    COARSEST,
    MOST_LEFT_OUT_NOISE,
    SCHEMES,
    largest_step,
    resolve_start,
)
from rattle.montecarlo.settings import Record, Sampling, count_followed, default_horizon, is_random
from rattle.montecarlo.statistics.section_statistics import stack_section
from rattle.scene import Scene

# paths of the probe runs before a pilot: each shows whether the next run fits the budget
PROBE_PATHS = (
    8,
    256,
)
PILOT_RUN_PATHS = 4 * BLOCK  # paths of a pilot run
FIRST_STEP = 0.01  # dt of the Euler-Maruyama pilots, where it is admissible
# core-seconds of exact flights below which no other scheme is tried: its pilot would take as long
CHEAP_SECONDS = 5.0
PROBE_SPAN = 0.01  # share of the horizon over which the first probe is run
ROUGHEST = 1e3  # the least accuracy that is considered, in sds
# share of an accuracy that noise left out by exact flights may take, and its least
NEGLECT = 0.1
LEAST_NEGLECT = 1e-7

Simulate = Callable[..., Ensemble]


def pilot(scene: Scene, scheme: str, simulate: Simulate) -> Ensemble:
    """A small run that shows what an accuracy takes: the spread, and the step bias of a scheme that
    has one."""
    return simulate(paths=PILOT_RUN_PATHS, **_pilot_settings(scene, scheme))


def _pilot_settings(scene: Scene, scheme: str, accuracy: float = math.inf) -> dict[str, Any]:
    exact = not SCHEMES[scheme].has_step_bias
    levels = 1 if exact else COARSEST
    dt = min(
        SCHEMES[scheme].step if exact else FIRST_STEP,
        0.99 * largest_step(scene, scheme)[0] / levels,
    )
    sampling = Sampling(control=exact and small_noise(scene))
    if exact:
        dt = resolve_start(
            scene, dt, min(MOST_LEFT_OUT_NOISE, max(NEGLECT * accuracy, LEAST_NEGLECT))
        )
    return {"scheme": scheme, "dt": dt, "record": Record(step_bias=not exact), "sampling": sampling}


@dataclass(frozen=True)
class PilotRun:
    """The pilot run of one scheme, and the cost of any accuracy estimated from it."""

    run: Ensemble  # the pilot; the last probe run where the budget had no room for the pilot
    path_seconds: float  # core time of a path: as measured, or by the cost model if that is more
    whole: bool  # whether `run` is the pilot
    _expected: dict[float, Candidate] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def of(cls, run: Ensemble) -> PilotRun:
        """Any run as a pilot, at the nominal time of its counted work."""
        return cls(run, cost_of(run, 1).core_seconds, True)

    def at(self, accuracy: float) -> Candidate:
        """Step, paths and work that an accuracy is expected to take."""
        if accuracy not in self._expected:
            self._expected[accuracy] = cost_to(self.run, accuracy)
        return self._expected[accuracy]

    def within(self, core_seconds: float, accuracy: float) -> float:
        """The finest accuracy, not below a given one, that an amount of work is expected to
        reach."""
        while (share := self.at(accuracy).core_seconds / max(core_seconds, 1e-9)) > 1.0:
            # work ~ accuracy^-2 or ^-3: the cube root never overshoots
            accuracy *= max(1.01, share ** (1.0 / 3.0))
            if accuracy > ROUGHEST:
                return math.inf
        return accuracy


# core-seconds of plain paths from which on rare branches are sampled on purpose, where that takes
# less
WAIT = 2.0
CHEAPER = 0.6  # share of the core-seconds of plain paths that it may take
HEAVY = 20.0  # kurtosis of a row from which on a rare branch may be what an accuracy waits for


def sample_branches(
    plain: PilotRun, accuracy: float, begin: Callable[[], Ensemble | None]
) -> PilotRun:
    """A pilot run that samples rare branches on purpose where an accuracy waits for them; else the
    same one.

    `begin`: Starts such a run, at least `FEWEST_PATHS` paths, see `begin_rare`; called only where
    plain paths are expensive.
    """
    run = plain.run
    cost = plain.at(accuracy).core_seconds
    if SCHEMES[run.scheme].has_step_bias or run.scene.sigma == 0.0 or cost < WAIT:
        return plain
    heavy = np.nanmax(stack_section(run.columns, "kurt_"), initial=0.0)
    if heavy < HEAVY and not expect_paths(run, accuracy).branch:
        return plain
    rare = begin()
    if rare is None or rare.paths < FEWEST_PATHS:
        return plain
    near = PilotRun(rare, max(plain.path_seconds, cost_of(rare, 1).core_seconds), True)
    return near if near.at(accuracy).core_seconds < CHEAPER * cost else plain


def _pilot_within(
    scene: Scene, scheme: str, accuracy: float, simulate: Simulate, budget: Budget
) -> PilotRun:
    """Probe runs and the pilot run of a scheme, each only if the budget is expected to cover it."""
    settings = _pilot_settings(scene, scheme, accuracy)
    one_step = replace(settings["sampling"], horizon=settings["dt"])
    with budget.pause():
        simulate(paths=1, **settings | {"impacts": 1, "sampling": one_step})  # compiles

    def time_run(**changed: Any) -> tuple[Ensemble, float]:
        began = clock()
        return simulate(**settings | changed), clock() - began

    for _ in range(2):  # overhead of a run besides its paths; the second time its plan is cached
        run, before = time_run(paths=1, sampling=one_step)
    longest_step = run.dt * (COARSEST if settings["record"].step_bias else 1)
    horizon = default_horizon(scene, run.impacts, longest_step)
    early = replace(one_step, horizon=PROBE_SPAN * horizon)
    probe, _ = time_run(paths=count_followed(scene, PROBE_PATHS[0]), sampling=early)
    slow = cost_of(probe, 1).core_seconds / PROBE_SPAN
    if probe.unfinished and slow * probe.paths > budget.remaining:
        return PilotRun(probe, slow, False)
    followed = 0
    latest = None
    for paths in (*PROBE_PATHS, PILOT_RUN_PATHS) if is_random(scene) else (1,):
        if latest is not None and latest.path_seconds * paths > budget.remaining:
            break
        run, seconds = time_run(paths=paths)
        took = max(cost_of(run, 1).core_seconds, (seconds - before) / (paths - followed))
        latest = PilotRun(run, took, run.paths == count_followed(scene, PILOT_RUN_PATHS))
        before = seconds
        followed = paths
    assert latest is not None
    return latest


def choose_scheme(
    scene: Scene,
    names: Sequence[str],
    accuracy: float,
    simulate: Simulate,
    blocks: Blocks,
    budget: Budget,
    progress: str | None = None,
) -> tuple[PilotRun, list[Candidate]]:
    """The scheme that is expected to cost least at an accuracy, and what each that was tried is
    expected to cost.

    Schemes after the first are tried only if the first is expensive (`CHEAP_SECONDS`) and the
    budget lasts.  Expensive exact flights are drawn near rare branches where that takes less.
    """
    pilots = [_pilot_within(scene, names[0], accuracy, simulate, budget)]
    if pilots[0].whole and pilots[0].at(accuracy).core_seconds > CHEAP_SECONDS:
        for name in names[1:]:
            if budget.remaining > 0.0:
                pilots.append(_pilot_within(scene, name, accuracy, simulate, budget))
    tried = [pilots[0], *(p for p in pilots[1:] if p.whole)]
    place = int(np.argmin([p.at(accuracy).core_seconds for p in tried]))
    best = tried[place]
    if (
        best.whole
        and not SCHEMES[best.run.scheme].has_step_bias
        and best.at(accuracy).core_seconds > WAIT
    ):
        longer = extend(best.run, count_followed(scene, FEWEST_PATHS), blocks, progress)
        tried[place] = PilotRun(longer, best.path_seconds, True)
        if budget.remaining > 0.0:
            tried[place] = sample_branches(
                tried[place], accuracy, partial(begin_rare, longer, FEWEST_PATHS, blocks)
            )
    return tried[place], [p.at(accuracy) for p in tried]
