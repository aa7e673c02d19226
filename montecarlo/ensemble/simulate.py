"""The public entry of the Monte Carlo: validate, run blocks, merge them in order."""

import time
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace

import numpy as np

from rattle.montecarlo.ensemble.result import Ensemble
from rattle.montecarlo.kernel.block import BLOCK, Plan, Reduced
from rattle.montecarlo.kernel.blocks import Blocks, in_threads
from rattle.montecarlo.schemes.step_size import SCHEMES, default_step, is_admissible
from rattle.montecarlo.seed import Rng, read_seed
from rattle.montecarlo.settings import Record, Sampling, count_followed, plan_of
from rattle.montecarlo.statistics.records import Batches, Histograms
from rattle.scene import InputError, Scene, check_scene, choice
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.progress import ProgressBar


@numpy_defaults
def simulate(
    scene: Scene,
    *,
    paths: int,
    impacts: int = 12,
    dt: float | None = None,
    scheme: str = "exact-flight",
    rng: Rng = 0,
    workers: int = 1,
    record: Record | None = None,
    progress: str | None = None,
    sampling: Sampling | None = None,
) -> Ensemble:
    """Simulate an ensemble of paths of Eqs. 5 and 6 with both impact rules.

    `rattle.montecarlo.simulate_to` chooses scheme, step and number of paths for an accuracy.

    Parameters
    ----------
    scene : Scene
        What is modelled.
    paths : int
        Number of independent paths.
    impacts : int
        Impacts of each path after the start.
    dt : float
        Step, at most `rattle.montecarlo.largest_step`; by default that of the scheme (pi / 96 for
        exact flights, 0.002 for Euler-Maruyama), shortened where the scene demands it.
        `Ensemble.diagnostics` says what it may do.
    scheme : {"exact-flight", "euler-maruyama-located", "euler-maruyama"}
        Name of one of `rattle.montecarlo.SCHEMES`.  The bias of an Euler-Maruyama step is measured
        and stands beside the moments, unless ``record=Record(step_bias=False)``.
    rng : int, SeedSequence, Generator or BitGenerator
        Seed.  The result is the same bit for bit for any number of workers.  A generator of numpy
        gives a child of its seed sequence, another one each time that it is passed.
    workers : int
        Threads.
    record : Record
        What is recorded beside the section moments; nothing by default.
    progress : str
        Label of a progress bar on a terminal or in a notebook; none by default, and none in a pipe.
    sampling : Sampling
        What few runs need: a control variate, two-point increments, a time limit, or who runs
        blocks of paths.

    Returns
    -------
    Ensemble
        Section moments with standard errors, and what was asked for by `record`.

    Raises
    ------
    InputError
        For any setting that cannot be run, before any path is followed.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> run = simulate(Scene.from_gears(DAT21, sigma=0.01), paths=1000, impacts=2, rng=7)
    >>> run.section[["mesh", "side", "paths", "agreement"]].loc[2].tolist()
    [2.0, 1.0, 1000.0, 1.0]
    """
    check_scene(scene)
    record = Record() if record is None else record
    if not isinstance(record, Record):
        raise InputError("record", record, "give a Record, as in record=Record(times=[1.0, 2.0])")
    scheme = choice("scheme", scheme, SCHEMES)
    sampling = Sampling() if sampling is None else sampling
    if not isinstance(sampling, Sampling):
        why = "give a Sampling, as in sampling=Sampling(control=True)"
        raise InputError("sampling", sampling, why)
    if record.step_bias is None and SCHEMES[scheme].has_step_bias:
        record = replace(record, step_bias=dt is None or is_admissible(scene, dt, scheme))
    dt = default_step(scene, scheme, bool(record.step_bias)) if dt is None else dt
    plan = plan_of(scene, paths, impacts, dt, scheme, read_seed(rng), workers, record, sampling)
    blocks = sampling.blocks or in_threads(workers)
    return _gather(plan, paths, blocks(plan, 0), record, progress)


def _gather(
    plan: Plan,
    paths: int,
    results: Iterator[Reduced],
    record: Record,
    progress: str | None,
    begun: Ensemble | None = None,
) -> Ensemble:
    """Merge the results of blocks of paths, in order, with those of a run that was begun."""
    started = time.perf_counter()
    quantities = 2 + 2 * plan.scene.stages
    done = 0 if begun is None else begun.plan.blocks
    merged = begun.result if begun is not None and done else None
    batched = (
        (deepcopy(begun.batches) if begun else Batches.empty(plan.impacts, quantities))
        if record.batches
        else None
    )
    histograms: Histograms | None = None
    kept = []
    with ProgressBar(
        label=progress, total=plan.paths - done * BLOCK, unit="path", unit_scale=True
    ) as bar:
        for result, rows in results:
            merged = result if merged is None else merged.merge(result)
            if batched is not None:
                batched.add(done, result.sums)
            if record.histogram and rows is not None:
                histograms = histograms or Histograms.for_sample(rows[:, :, :-1])
                histograms.add(rows[:, :, :-1])
            if record.raw and rows is not None:
                kept.append(rows)
            bar.update(min(BLOCK, plan.paths - done * BLOCK))
            done += 1
    assert merged is not None
    if done * BLOCK < plan.paths:  # the blocks ended early
        paths = done * BLOCK
        plan = plan._replace(paths=paths)
    whole = np.concatenate(kept) if kept else None
    if whole is not None and plan.paths < paths:
        whole = np.broadcast_to(whole, (paths, *whole.shape[1:]))
    seconds = time.perf_counter() - started + (begun.wall_seconds if begun else 0.0)
    return Ensemble(plan, paths, merged, histograms, whole, seconds, batched)


def extend(run: Ensemble, paths: int, blocks: Blocks, progress: str | None = None) -> Ensemble:
    """Add paths to a run; what is there is not computed again.

    Where nothing is random, the one path that is there stands for the others too.

    Returns: Equal bit for bit to a run of that many paths from the start; without histograms and
    single paths.
    """
    plan = run.plan._replace(paths=count_followed(run.scene, paths))
    record = Record(batches=run.batches is not None)
    return _gather(plan, paths, blocks(plan, run.plan.blocks), record, progress, begun=run)
