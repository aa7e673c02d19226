"""Ask for accuracy, not for settings: scheme, step and number of paths from pilot runs, then paths until it is there.

Where nothing is random one path is the answer, and only the bias of the step is left to be made small.

A budget bounds all of it, and an answer that is expected to cost more than the default one is refused as soon as pilots
have shown it.  The budget is looked at between runs and between blocks of paths: a block that runs is not cut short.
"""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from functools import partial

from rattle.montecarlo.accuracy import LEAST, sampling_error, small_noise, step_error
from rattle.montecarlo.budget import HOUR, Budget, clock, in_words
from rattle.montecarlo.ensemble import Blocks, extended
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.pilots import COARSEST, ROUGHEST, Sent, Simulate, chosen
from rattle.montecarlo.reach import Reach
from rattle.montecarlo.result import Ensemble
from rattle.montecarlo.schemes.table import SCHEMES
from rattle.montecarlo.settings import MOST_STEPS, computed, default_horizon, is_random
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene

__all__ = ["ESTIMATES", "simulate_to"]

ESTIMATES = logging.getLogger("rattle.estimate")
"""What an accuracy is expected to take is said here (level INFO) before the work starts."""

GROWTH = 8  # most by which the number of paths grows at once: the spread of heavy tails is found late


def _check_affordable(sent: Sent, accuracy: float, workers: int) -> None:
    """Refuse what is expected to take longer than where no budget is given."""
    expected = sent.at(accuracy)
    seconds = max(expected.core_seconds, 0.0 if sent.whole else sent.path_seconds * LEAST) / workers
    if seconds <= HOUR:
        return
    gives = sent.within(HOUR * workers, accuracy) if sent.whole else math.inf
    threads = f"{workers} thread{'s' if workers > 1 else ''}"
    instead = f"ask for {_rounded_up(gives):g}, which an hour is expected to give, or " if gives < math.inf else ""
    raise InputError(
        "accuracy", accuracy, f"is expected to take {in_words(seconds)} on {threads} ({expected.sentence}), and where "
        f"no budget is given an hour is the most: {instead}give the seconds that it may take as budget",
    )  # fmt: skip


def _rounded_up(accuracy: float) -> float:
    """To two digits."""
    unit = 10.0 ** (math.floor(math.log10(accuracy)) - 1)
    return math.ceil(accuracy / unit) * unit


def simulate_to(
    scene: Scene, simulate: Simulate, *, accuracy: float, scheme: str | None, blocks: Blocks, workers: int,
    budget: float | None, progress: str | None,
) -> Ensemble:  # fmt: skip
    """Simulate until both errors are within `accuracy`, or the budget is spent.

    Parameters
    ----------
    scene : Scene
    simulate : callable
        `montecarlo.simulate` with all that does not change: scene, impacts, seed.
    accuracy : float
    scheme : str or None
        The one to use; None for the one that pilot runs expect to cost least.
    blocks : callable
        Who runs the blocks.
    workers : int
        How many they are run by at a time.
    budget : float or None
        Seconds; None for an hour, and what is expected to take longer is refused.
    progress : str or None

    Returns
    -------
    Ensemble
        With `Ensemble.reach`.

    Raises
    ------
    InputError
        Where no budget is given and more than an hour is expected.
    """
    left = Budget(HOUR if budget is None else budget)
    blocks = left.limited(blocks)
    simulate = partial(simulate, blocks=blocks)
    names = [scheme] if scheme else sorted(SCHEMES, key=lambda name: SCHEMES[name].weak_order is not None)
    sent, candidates = chosen(scene, names, accuracy, simulate, left, workers)
    ESTIMATES.info("Accuracy %g sd: %s.", accuracy, sent.at(accuracy).sentence)
    if budget is None:
        _check_affordable(sent, accuracy, workers)
    run, more = _followed_up(sent, simulate, blocks, accuracy, left, workers, progress)
    error, worst = sampling_error(run)
    step = 0.0 if SCHEMES[run.scheme].weak_order is None else step_error(run)[0]
    worst += "" if is_random(scene) else ": one path is the answer"
    enough = sent.whole and run.paths >= computed(scene, LEAST)
    return replace(run, reach=Reach(accuracy, error, step, worst, candidates, more, enough))


def _followed_up(
    sent: Sent, simulate: Simulate, blocks: Blocks, accuracy: float, budget: Budget, workers: int, progress: str | None
) -> tuple[Ensemble, float]:  # fmt: skip
    """The pilot's scheme until its errors are within the accuracy, or the budget is spent; and the seconds missing."""
    run, scene, expected = sent.run, sent.run.scene, sent.at(accuracy)
    if not sent.whole or budget.left <= 0.0:
        missing = max(expected.core_seconds, sent.path_seconds * expected.paths) / workers
        return run, missing
    exact, fewest, grain = SCHEMES[run.scheme].weak_order is None, computed(scene, LEAST), computed(scene, BLOCK)
    horizon = default_horizon(run.impacts, run.dt * (1 if exact else COARSEST))
    shortest = horizon / MOST_STEPS
    settings = {
        "scheme": run.scheme, "control": exact and small_noise(scene), "step_bias": not exact, "progress": progress,
        "horizon": horizon,
    }  # fmt: skip
    began, before = clock(), 0
    if not exact:
        aim = min(sent.within(budget.left * workers, accuracy), ROUGHEST)
        run = simulate(paths=fewest, dt=max(sent.at(aim).dt, shortest), **settings)
    elif run.paths < fewest:
        run, before = extended(run, fewest, blocks, progress), run.paths
    while True:
        seconds_per_path = max(clock() - began, 1e-9) / (run.paths - before)
        error, _ = sampling_error(run)
        step, se_step = (0.0, 0.0) if exact else step_error(run)
        wanted = math.ceil(run.paths * min(error / accuracy, 1e100) ** 2 / grain) * grain
        shorten = step > accuracy and step > 3.0 * se_step
        if step > accuracy and not shorten:  # a bias that may be noise
            wanted = max(wanted, 2 * run.paths)
        more = 2 * run.paths if shorten else max(wanted - run.paths, fewest - run.paths, 0)
        if shorten and 0.5 * run.dt < shortest:
            return run, math.inf
        affordable = int(min(max(budget.left, 0.0) / seconds_per_path, 1e15)) // grain * grain
        if more == 0 or affordable <= 0 or (shorten and affordable < more):
            missing = 0.0 if exact or more == 0 else expected.core_seconds / workers
            return run, max(more * seconds_per_path, missing)
        began, before = clock(), run.paths
        if shorten:
            run, before = simulate(paths=run.paths, dt=0.5 * run.dt, **settings), 0
        else:
            run = extended(run, run.paths + min(more, affordable, (GROWTH - 1) * run.paths), blocks, progress)
