"""Paths of which a part is drawn near the rare branches that matter."""

from __future__ import annotations

from dataclasses import replace

from rattle.montecarlo.branches.choose import choose_mixture
from rattle.montecarlo.diagnostics.unseen import find_unseen, unseen_columns
from rattle.montecarlo.ensemble.result import Ensemble
from rattle.montecarlo.ensemble.simulate import extend, simulate
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.kernel.blocks import Blocks, in_threads
from rattle.montecarlo.schemes.control_variate import no_control
from rattle.montecarlo.seed import Rng, child_seed
from rattle.montecarlo.settings import is_random
from rattle.montecarlo.statistics.records import Batches
from rattle.scene import InputError, Scene, check_scene
from rattle.scene.numpy_errors import numpy_defaults

CHOOSING_PATHS = 32 * BLOCK  # plain paths from which branches are chosen
RARE_KEY = 0x7A5  # spawn key of the random numbers of a run that samples rare branches


def begin_rare(run: Ensemble, paths: int, blocks: Blocks) -> Ensemble | None:
    """A run that samples on purpose the rare branches that matter to a plain run; None where none
    is worth it."""
    mixture = choose_mixture(run)
    if mixture is None:
        return None
    seed = child_seed(run.seed, RARE_KEY)
    plan = run.plan._replace(mixture=mixture, seed=seed, control=no_control(), keep=False, paths=0)
    batches = None if run.batches is None else Batches.empty(run.impacts, 2 + 2 * run.scene.stages)
    return extend_rare(replace(run, plan=plan, paths=0, batches=batches), paths, blocks)


def extend_rare(run: Ensemble, paths: int, blocks: Blocks, progress: str | None = None) -> Ensemble:
    """Add paths to such a run, and say what branches it may still miss could change."""
    run = extend(run, -(-paths // BLOCK) * BLOCK, blocks, progress)
    hidden = find_unseen(
        run.scene, replace(run, unseen={}).columns, run.paths, run.plan.mixture, run.dt
    )
    return replace(run, unseen=unseen_columns(hidden))


@numpy_defaults
def simulate_rare(
    scene: Scene, *, paths: int, impacts: int = 12, rng: Rng = 0, workers: int = 1
) -> Ensemble:
    """Simulate exact flights of which a part is drawn near the rare branches that matter.

    `rattle.montecarlo.simulate_to` does so by itself where an accuracy waits for such branches.
    The step, and the distribution that is sampled, are those of `simulate` with
    ``scheme="exact-flight"``.

    Parameters
    ----------
    scene : Scene
        What is modelled.
    paths : int
        Number of paths, rounded up to whole blocks of 1024.  A plain run of 32 blocks chooses the
        branches.
    impacts : int
        Impacts of each path.
    rng : int, SeedSequence, Generator or BitGenerator
        Seed.  The result is the same bit for bit for any number of workers.  A generator of numpy
        gives a child of its seed sequence, another one each time that it is passed.
    workers : int
        Threads.

    Returns
    -------
    Ensemble
        Of weighted paths; of plain ones where no branch is worth it.

    Raises
    ------
    InputError
        For settings that cannot be run, and for noise with a correlation time.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> run = simulate_rare(Scene.from_gears(DAT21, sigma=0.1), paths=32_768, impacts=3, rng=1)
    >>> plain = simulate(run.scene, paths=32_768, impacts=3, rng=1)
    >>> bool(run.section["se_sd_y2"][3] < 0.2 * plain.section["se_sd_y2"][3])
    True
    """
    check_scene(scene)
    if scene.correlation_time:
        why = "rare branches are searched for with white noise only, 0"
        raise InputError("correlation_time", scene.correlation_time, why)
    blocks = in_threads(workers)
    run = simulate(
        scene, paths=min(paths, CHOOSING_PATHS), impacts=impacts, rng=rng, workers=workers
    )
    rare = begin_rare(run, paths, blocks) if is_random(scene) and scene.sigma > 0.0 else None
    return rare or (extend(run, paths, blocks) if paths > CHOOSING_PATHS else run)
