"""Ask for accuracy, not for settings: scheme, step and number of paths from pilot runs, then paths
until it is there.

Where nothing is random one path is the answer, and only the bias of the step is left to be made
small.  A budget of processor time bounds all of it, and is looked at between runs and between
blocks of paths.  Without one, an answer that is expected to cost more than an hour is refused as
soon as pilots have shown it, or cut to an amount of counted work.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from functools import partial
from typing import Any

from rattle.montecarlo.accuracy.cost import (
    cost_of,
    expect_paths,
    find_missed_rows,
    name_dearest_row,
    step_error,
)
from rattle.montecarlo.accuracy.pilots import (
    ROUGHEST,
    PilotRun,
    Simulate,
    choose_scheme,
    sample_branches,
)
from rattle.montecarlo.diagnostics.accuracy import (
    FEWEST_PATHS,
    error_bound,
    sampling_error,
    small_noise,
)
from rattle.montecarlo.diagnostics.reach import AccuracyWarning, Reach
from rattle.montecarlo.ensemble.result import Ensemble
from rattle.montecarlo.ensemble.simulate import extend, simulate
from rattle.montecarlo.ensemble.simulate_rare import begin_rare, extend_rare
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.kernel.blocks import HOUR, Blocks, Budget, clock, in_threads
from rattle.montecarlo.looks import grow, share_of_look
from rattle.montecarlo.schemes.step_size import COARSEST, SCHEMES
from rattle.montecarlo.seed import Rng, read_seed
from rattle.montecarlo.settings import (
    MOST_STEPS_OF_A_PATH,
    Record,
    Sampling,
    check_settings,
    count_followed,
    default_horizon,
    is_random,
)
from rattle.scene import InputError, Scene, duration_text, positive
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.progress import ESTIMATES

MOST_BIAS = 0.6  # share of an accuracy that the bias of the step may take; pilots aim at half
LAST_LOOK_SPARE = 1.05  # paths that are run over those foreseen, so that the next look is the last
# nominal core-seconds of an answer in place of one that would take more than an hour
INSTEAD = 20.0
LEAST_ROOM = 0.2  # share that is left to the error of sampling while the step is too long
# most by which the number of paths grows at once: the spread of heavy tails is found late
MOST_GROWTH = 8


def _expect_seconds(pilot_run: PilotRun, accuracy: float) -> float:
    """Core-seconds that an accuracy is expected to take; those of the fewest paths where there was
    no whole pilot."""
    least = 0.0 if pilot_run.whole else pilot_run.path_seconds * FEWEST_PATHS
    return max(pilot_run.at(accuracy).core_seconds, least)


def _refuse(pilot_run: PilotRun, accuracy: float) -> None:
    """Refuse what is expected to take longer than an hour where no budget is given."""
    expected = pilot_run.at(accuracy)
    seconds = _expect_seconds(pilot_run, accuracy)
    gives = pilot_run.within(HOUR, accuracy) if pilot_run.whole else math.inf
    instead = ""
    if gives < math.inf:
        instead = f"ask for {_round_up(gives):g}, which an hour is expected to give, or "
    raise InputError(
        "accuracy",
        accuracy,
        f"is expected to take {duration_text(seconds)} ({expected.sentence}), and without a budget"
        f" the limit is one hour{_most_for(pilot_run, accuracy)}: {instead}give the seconds that it"
        " may take as budget",
    )


def _most_for(pilot_run: PilotRun, accuracy: float) -> str:
    """Which rare branch most of the paths are for, as a clause."""
    branch = expect_paths(pilot_run.run, accuracy).branch
    return f"; most paths are for {branch}" if branch else ""


def _round_up(accuracy: float) -> float:
    """To two digits."""
    unit = 10.0 ** (math.floor(math.log10(accuracy)) - 1)
    return math.ceil(accuracy / unit) * unit


@numpy_defaults
def simulate_to(
    scene: Scene,
    accuracy: float,
    *,
    impacts: int = 12,
    scheme: str | None = None,
    rng: Rng = 0,
    workers: int = 1,
    budget: float | None = None,
    record: Record | None = None,
    progress: str | None = None,
    sampling: Sampling | None = None,
    refuse: bool = True,
) -> Ensemble:
    """Simulate until all section means and sds are known to an accuracy.

    They are within it with a probability of 95 % for all of them at once.

    Parameters
    ----------
    scene : Scene
        What is modelled.
    accuracy : float
        Largest error of all section means and sds, in units of each quantity's sd (absolute where
        it does not vary): with 95 % probability none is larger.  Sampling, bias of the step and
        branches that the sample cannot have seen count.
    impacts : int
        Impacts of each path after the start.
    scheme : str
        Name of one of `rattle.montecarlo.SCHEMES`; by default the one that pilot runs expect to
        cost least.
    rng : int, SeedSequence, Generator or BitGenerator
        Seed.  The result is the same bit for bit for any number of workers.  A generator of numpy
        gives a child of its seed sequence, another one each time that it is passed.
    workers : int
        Threads.
    budget : float
        Seconds of processor time that it may take, all threads together, looked at between blocks
        of paths.  When they are spent, the best answer so far is returned and
        `Ensemble.diagnostics` says what is missing.  Without it, what pilot runs expect to take
        more than an hour is refused before the work.  Compiling is not counted.
    record : Record
        ``energy`` and ``batches`` are recorded where they are asked for; nothing else can be.
    progress : str
        Label of a progress bar on a terminal or in a notebook; none by default, and none in a pipe.
    sampling : Sampling
        ``blocks`` alone can be given: who runs the blocks of paths; by default threads of this
        process.
    refuse : bool
        Whether what is expected to take more than an hour is refused where no budget is given.
        Otherwise the answer is what about 20 seconds of counted work give, on every machine the
        same; `Ensemble.reach` has the rows that miss.

    Returns
    -------
    Ensemble
        With `Ensemble.reach`: how far it got.

    Raises
    ------
    InputError
        For a setting that cannot be run, and for an accuracy that is refused; no more than pilot
        runs has started then.

    Warns
    -----
    AccuracyWarning
        Where the accuracy was not reached.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> run = simulate_to(Scene.from_gears(DAT21, sigma=0.01), 0.05, impacts=2)
    >>> run.scheme, run.reach.reached
    ('exact-flight', True)
    """
    wanted = Record() if record is None else record
    sampling = Sampling() if sampling is None else sampling
    _check_choices(wanted, sampling)
    rng = read_seed(rng)
    check_settings(
        scene, 1, impacts, None, "exact-flight" if scheme is None else scheme, rng, workers
    )
    accuracy = float(positive("accuracy", accuracy))
    if budget is not None and budget != math.inf:
        budget = float(positive("budget", budget))
    left = Budget(HOUR if budget is None else budget)
    blocks = left.limit(sampling.blocks or in_threads(workers))

    def again(record: Record, sampling: Sampling, **settings: Any) -> Ensemble:
        return simulate(
            scene,
            rng=rng,
            record=replace(wanted, step_bias=record.step_bias),
            sampling=replace(sampling, blocks=blocks),
            **({"impacts": impacts} | settings),
        )

    names = [scheme] if scheme else sorted(SCHEMES, key=lambda name: SCHEMES[name].has_step_bias)
    pilot_run, candidates = choose_scheme(scene, names, accuracy, again, blocks, left, progress)
    short = budget is None and _expect_seconds(pilot_run, accuracy) > HOUR
    if short and refuse:
        _refuse(pilot_run, accuracy)
    ESTIMATES.info("Accuracy %g sd: %s.", accuracy, _describe_effort(pilot_run, accuracy, short))
    if budget is None:
        left.ends = math.inf  # from here on no clock decides
    run, more, look = (_cut_short if short else _follow_up)(
        pilot_run, again, blocks, accuracy, left, progress
    )
    enough = pilot_run.whole and run.paths >= count_followed(scene, FEWEST_PATHS)
    reach = _state_reach(run, accuracy, share_of_look(look))
    reach = reach._replace(candidates=candidates, more_seconds=more, enough=enough)
    if not reach.reached:
        reach = reach._replace(missed=find_missed_rows(run, accuracy, share_of_look(look)))
        warnings.warn(reach.sentence, AccuracyWarning, stacklevel=3)
    return replace(run, reach=reach)


def _state_reach(run: Ensemble, accuracy: float, share: float) -> Reach:
    """How far a run got, at the share of a look."""
    bound = error_bound(run, share)
    step = step_error(run)[0]
    return Reach(
        asked=accuracy,
        sampling=sampling_error(run)[0],
        step=step,
        bound=bound.error + step,
        worst=bound.where + ("" if is_random(run.scene) else ": one path is the answer"),
        candidates=(),
        more_seconds=0.0,
        remark=bound.remark,
    )


def _check_choices(record: Record, sampling: Sampling) -> None:
    """Refuse what `simulate_to` chooses itself."""
    why = (
        "cannot be recorded by simulate_to, which chooses its own runs; leave it out, or give paths"
        " to simulate"
    )
    for name in ("times", "step_bias", "itineraries", "histogram", "raw"):
        value = getattr(record, name)
        if len(value) if name in ("times", "itineraries") else value:
            raise InputError(f"record.{name}", value, why)
    if not isinstance(sampling, Sampling) or sampling != Sampling(blocks=sampling.blocks):
        raise InputError(
            "sampling", sampling, "give a Sampling with blocks alone: simulate_to chooses the rest"
        )


def _describe_effort(pilot_run: PilotRun, accuracy: float, short: bool) -> str:
    """What an accuracy is expected to take, and for which branch and row.

    `short`: Whether that is more than an hour, so that the answer takes less.
    """
    effort = pilot_run.at(accuracy).sentence + _most_for(pilot_run, accuracy)
    if pilot_run.whole and (dearest := name_dearest_row(pilot_run.run, accuracy, share_of_look(1))):
        effort += f"; {dearest}"
    if short:
        effort += (
            f". That is more than an hour: the answer is what about {INSTEAD:g} s give, or give a"
            " budget in seconds"
        )
    return effort


def _extend(run: Ensemble, paths: int, blocks: Blocks, progress: str | None) -> Ensemble:
    """Add paths to a run."""
    if paths <= run.paths:
        return run
    return (extend if run.plan.mixture is None else extend_rare)(run, paths, blocks, progress)


def _cut_short(
    pilot_run: PilotRun,
    simulate: Simulate,
    blocks: Blocks,
    accuracy: float,
    budget: Budget,
    progress: str | None,
) -> tuple[Ensemble, float, int]:
    """As `_follow_up`, but what `INSTEAD` core-seconds of counted work give."""
    run = pilot_run.run
    more = _expect_seconds(pilot_run, accuracy)
    if not pilot_run.whole:
        return run, more, 1
    if SCHEMES[run.scheme].has_step_bias:
        aim = min(pilot_run.within(INSTEAD, accuracy), ROUGHEST)
        run, _, look = _follow_up(pilot_run, simulate, blocks, aim, budget, progress)
        return run, more, look
    grain = count_followed(run.scene, BLOCK)
    paths = int(INSTEAD / cost_of(run, 1).core_seconds) // grain * grain
    return (
        _extend(run, max(paths, count_followed(run.scene, FEWEST_PATHS)), blocks, progress),
        more,
        1,
    )


def _look_at(run: Ensemble, accuracy: float, look: int, grain: int) -> tuple[int, bool]:
    """Bound the errors of a run with the share of a look, and foresee the next one.

    Returns: Paths that the next look should suffice with, those of the run where it suffices; and
    whether the bias of the step is shown to take too much of the accuracy.
    """
    step, se_step = step_error(run)
    too_long = (
        SCHEMES[run.scheme].has_step_bias and step > MOST_BIAS * accuracy and step > 3.0 * se_step
    )
    if error_bound(run, share_of_look(look)).error + step <= accuracy:
        return run.paths, too_long
    room = max(accuracy - step, LEAST_ROOM * accuracy)  # for the error of sampling
    needed = expect_paths(run, room, share_of_look(look + 1)).paths
    # more also where a bias may be noise
    return grow(run.paths, needed, LAST_LOOK_SPARE, grain), too_long


def _follow_up(
    pilot_run: PilotRun,
    simulate: Simulate,
    blocks: Blocks,
    accuracy: float,
    budget: Budget,
    progress: str | None,
) -> tuple[Ensemble, float, int]:
    """The pilot's scheme until its errors are within the accuracy, or the budget is spent; seconds
    missing, looks."""
    run = pilot_run.run
    expected = pilot_run.at(accuracy)
    if not pilot_run.whole or budget.remaining <= 0.0:
        missing = max(expected.core_seconds, pilot_run.path_seconds * expected.paths)
        return run, missing, 1
    exact = not SCHEMES[run.scheme].has_step_bias
    fewest = count_followed(run.scene, FEWEST_PATHS)
    grain = count_followed(run.scene, BLOCK)
    horizon = default_horizon(run.scene, run.impacts, run.dt * (1 if exact else COARSEST))
    shortest = horizon / MOST_STEPS_OF_A_PATH
    settings = {
        "scheme": run.scheme,
        "record": Record(step_bias=not exact),
        "progress": progress,
        "sampling": Sampling(control=exact and small_noise(run.scene), horizon=horizon),
    }
    began = clock()
    before = 0
    tried = run.paths
    if not exact:
        aim = min(pilot_run.within(budget.remaining, accuracy), ROUGHEST)
        run = simulate(paths=fewest, dt=max(pilot_run.at(aim).dt, shortest), **settings)
    elif run.paths < fewest:
        before = run.paths
        run = _extend(run, fewest, blocks, progress)
    look = 0
    while True:
        look += 1
        took = (clock() - began) / (run.paths - before) if run.paths > pilot_run.run.paths else 0.0
        seconds_per_path = took or pilot_run.path_seconds
        wanted, too_long = _look_at(run, accuracy, look, grain)
        late = exact and run.plan.mixture is None and run.paths > MOST_GROWTH * tried
        if late and budget.remaining > 0.0:  # a spread that was found late
            begin = partial(begin_rare, run, run.paths, blocks)
            tried = run.paths
            rare = sample_branches(PilotRun(run, seconds_per_path, True), accuracy, begin)
            if rare.run is not run:
                run = rare.run
                before = 0
                began = clock()
                continue
        shorter = 0.5 * run.dt
        if too_long and shorter < shortest:
            return run, math.inf, look
        # half the step takes as long as twice the paths
        more = 2 * run.paths if too_long else max(wanted, fewest) - run.paths
        seconds = max(budget.remaining, 0.0)
        affordable = int(min(seconds / seconds_per_path, 1e15)) // grain * grain
        if more == 0 or affordable <= 0 or (too_long and affordable < more):
            missing = 0.0 if exact or more == 0 else expected.core_seconds
            return run, max(more * seconds_per_path, missing), look
        began = clock()
        before = 0 if too_long else run.paths
        if too_long:
            run = simulate(paths=run.paths, dt=shorter, **settings)
        else:
            paths = min(run.paths + min(more, affordable), MOST_GROWTH * run.paths)
            run = _extend(run, paths, blocks, progress)
