"""What a run-up computes within its budget, decided by counted work: impacts at a nominal time.

So a result does not depend on the machine; the clock only ends what a plan has underestimated.
"""

from typing import NamedTuple

import numpy as np

from rattle.compare.ramp.speed import SpeedRamp
from rattle.montecarlo.long_run.paths import IMPACT_SECONDS
from rattle.montecarlo.long_run.sums import NUMBER, new_sums, no_scales
from rattle.montecarlo.long_run.walk import Walk
from rattle.montecarlo.schemes.quiet import quiet_of
from rattle.scene import Constants, Scene, duration_text

RAMP_PLANNED_SHARE = 0.85  # of the budget: the rest is for the counting itself, figures and tables
RAMP_SHARE = 0.45  # of what is planned, for the ramp and its coarser copy
PERIOD_SECONDS = 1e-5
"""Nominal processor time of a period of a path without impacts."""
RAMP_PILOT_PATHS = 4
PILOT_PERIODS = 2  # in which impacts are counted
PILOT_SETTLING = 8  # periods before, a multiple of these: chatter builds up in a few
FEWEST_STEADY_PATHS = 16  # of a constant speed: fewest that a long run takes
FEWEST_RAMP_PATHS = 8
MOST_RUN_UP_PATHS = 128
SETTLING = 64  # periods of burn-in and pilot run of a constant speed, at the least
STEADY_PERIODS = (64, 512)  # fewest and most periods of a constant speed
RAMP_BURN_IN = 64  # periods at the first speed before the ramp begins
RAMP_COPIES = 2  # the ramp, and the same in stretches of twice the length


class RunUpPlan(NamedTuple):
    """What is computed."""

    speeds: list[float]  # constant speeds, 1/min, the cheapest first
    left_out: list[float]
    paths: int  # of a constant speed
    periods: int
    ramp_paths: int  # 0 where the ramp is left out
    ramp_seconds: float  # nominal processor time of the ramp and its coarser copy
    seconds: float  # nominal processor time of all that is computed
    complete: float  # budget from which on nothing is left out

    @property
    def sentence(self) -> str:
        """What is computed and about how long it takes, as text."""
        ramp = f"then the ramp with {self.ramp_paths}" if self.ramp_paths else "no ramp"
        return (
            f"{len(self.speeds)} constant speeds with {self.paths} paths, {ramp}; about"
            f" {duration_text(self.seconds, 2)} of processor time"
        )


def count_period(
    scene: Scene, slow: float, seed: np.random.SeedSequence, constants: Constants
) -> float:
    """Nominal processor time of a period of a path of a scene with these constants."""
    walk = Walk(scene, seed, 0, RAMP_PILOT_PATHS)
    walk.change_constants(constants, quiet_of(scene, slow, None))
    sums = new_sums(
        RAMP_PILOT_PATHS, 1 + PILOT_SETTLING // PILOT_PERIODS, no_scales(scene.stages, slow), False
    )
    walk.follow(sums, PILOT_SETTLING + PILOT_PERIODS, PILOT_PERIODS)
    impacts = float(sums.main[:, -1, NUMBER].sum()) / (RAMP_PILOT_PATHS * PILOT_PERIODS)
    return PERIOD_SECONDS + IMPACT_SECONDS * impacts


def coarse_to_fine(number: int) -> list[int]:
    """The places in a list in an order in which every beginning is spread over the whole."""
    order = [0, number - 1]
    gaps = [(0, number - 1)]
    for low, high in gaps:
        middle = (low + high) // 2
        if middle > low:
            order.append(middle)
            gaps += [(low, middle), (middle, high)]
    return order


def plan_work(
    ramp: SpeedRamp, speeds: list[float], budget: float, seed: np.random.SeedSequence
) -> RunUpPlan:
    """Share a budget among constant speeds and the ramp; of both the least comes first."""
    costs = []
    for rpm in speeds:
        scene = ramp.scene_at(rpm)
        motions = scene.constants, ramp.constants_at(rpm)  # chatter may be in one of them alone
        costs.append([count_period(scene, ramp.slow_at(rpm), seed, c) for c in motions])
    cost, cost_in_ramp = np.array(costs).T
    ascending = np.argsort(speeds)
    passed = ramp.rpm_at(np.arange(0.5, ramp.periods))
    of_ramp = np.interp(passed, np.array(speeds)[ascending], cost_in_ramp[ascending])
    ramp_cost = RAMP_COPIES * float(of_ramp.sum() + RAMP_BURN_IN * cost[0])  # of a path
    planned = RAMP_PLANNED_SHARE * budget
    ramp_paths = min(int(RAMP_SHARE * planned / ramp_cost), MOST_RUN_UP_PATHS)
    if ramp_paths < FEWEST_RAMP_PATHS:
        ramp_paths = 0
    rest = planned - ramp_paths * ramp_cost
    least = FEWEST_STEADY_PATHS * (SETTLING + STEADY_PERIODS[0]) * cost
    order = coarse_to_fine(len(speeds))
    fitting = int((np.cumsum(least[order]) <= rest).sum())
    chosen = order[: max(fitting, 1)]
    whole = float(cost[chosen].sum())
    fewest = (SETTLING + STEADY_PERIODS[0]) * whole
    paths = int(np.clip(rest / fewest, FEWEST_STEADY_PATHS, MOST_RUN_UP_PATHS))
    periods = int(np.clip(rest / (paths * whole) - SETTLING, *STEADY_PERIODS))
    ramp_seconds = ramp_paths * ramp_cost
    return RunUpPlan(
        speeds=[speeds[i] for i in sorted(chosen, key=lambda i: cost[i])],
        left_out=[rpm for i, rpm in enumerate(speeds) if i not in chosen],
        paths=paths,
        periods=periods,
        ramp_paths=ramp_paths,
        ramp_seconds=ramp_seconds,
        seconds=ramp_seconds + paths * (SETTLING + periods) * whole,
        complete=max(
            FEWEST_RAMP_PATHS * ramp_cost / RAMP_SHARE,
            float(least.sum()) / (1.0 - RAMP_SHARE),
        )
        / RAMP_PLANNED_SHARE,
    )
