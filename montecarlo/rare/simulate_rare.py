"""Simulation with rare branches: importance sampling directed at design points."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.kernel.block import BLOCK, Plan, start_state
from rattle.montecarlo.kernel.kernel import COLUMNS, EXACT, Job
from rattle.montecarlo.kernel.lanes import lanes_of
from rattle.montecarlo.noise.backlash import backlash_of
from rattle.montecarlo.noise.philox import key_of
from rattle.montecarlo.rare.design_points import RareBranch, find_branches, pilot_of
from rattle.montecarlo.rare.kernel import run_weighted
from rattle.montecarlo.rare.mixture import BranchMixture, choose_branches, mixture_of, targets
from rattle.montecarlo.rare.weighted_moments import ORDERS, add, moments
from rattle.montecarlo.schemes.step_size import default_step
from rattle.montecarlo.settings.plan import NOISE_FREE, plan_of
from rattle.scene.errors import InputError
from rattle.scene.moments import SECTION
from rattle.scene.scene import Scene
from rattle.scene.section_result import SectionResult

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["RareEnsemble", "run_block", "simulate_rare"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RareEnsemble(SectionResult):
    """Section moments of weighted paths.

    Attributes
    ----------
    scene : Scene
        What was simulated.
    paths : int
        Number of paths, a multiple of the block.
    found : tuple of RareBranch
        Branches whose design points were found, the one that adds most to a kurtosis first.
    sampled : tuple of RareBranch
        Those of them that have paths of their own.
    unresolved : tuple of (impact, code)
        Events near the orbit whose design point the search did not find: unknown, not absent.
    unfinished : int
        Paths given up before their last impact; the rows that they lack are NaN.
    mean, se_mean, sd, se_sd : ndarray, shape (impacts, 6)
        Moments of the section quantities and their standard errors.

    Examples
    --------
    >>> from rattle import DAT21, Scene
    >>> rare = simulate_rare(Scene.from_gears(DAT21, sigma=0.1), paths=1000, impacts=2, rng=7)
    >>> rare.mean.shape
    (2, 6)
    """

    scene: Scene
    paths: int
    found: tuple[RareBranch, ...]
    sampled: tuple[RareBranch, ...]
    unresolved: tuple[tuple[int, int], ...]
    unfinished: int
    mean: Floats
    se_mean: Floats
    sd: Floats
    se_sd: Floats

    def __repr__(self) -> str:
        """What was simulated, and which branches were found, on a few lines."""
        return (
            f"RareEnsemble: {self.paths:,} paths, impacts 1 to {len(self.mean)}, sigma = {self.scene.sigma:.4g}\n"
            f"  rare branches: {len(self.found)} found, {len(self.sampled)} of them with paths of their own, "
            f"{len(self.unresolved)} not resolved\n"
            f"  {self.unfinished:,} paths did not finish before the time limit"
        )

    @property
    def _title(self) -> str:
        return f"{self.paths:,} paths"

    @property
    def section(self) -> pd.DataFrame:
        """Means, sds and their standard errors by impact, named as in `rattle.montecarlo.Ensemble.section`."""
        import pandas as pd

        columns: dict[str, Floats] = {}
        for prefix, values in (("", self.mean), ("se_", self.se_mean), ("sd_", self.sd), ("se_sd_", self.se_sd)):
            columns |= {prefix + name: values[:, q] for q, name in enumerate(SECTION[: 2 + 2 * self.scene.stages])}
        return pd.DataFrame(columns, index=pd.RangeIndex(1, len(self.mean) + 1, name="impact"))

    @property
    def branches(self) -> pd.DataFrame:
        """One row for each branch that was found: where it leaves the orbit, its index and probability, if sampled."""
        import pandas as pd

        rows = [
            (b.impact, abs(b.code), 1 if b.code > 0 else -1, b.beta, b.probability, b.kurtosis, b in self.sampled)
            for b in self.found
        ]
        return pd.DataFrame(rows, columns=["impact", "mesh", "side", "beta", "probability", "kurtosis", "sampled"])


def simulate_rare(
    scene: Scene, *, paths: int, impacts: int = 12, rng: int | np.random.SeedSequence = 0, workers: int = 1
) -> RareEnsemble:
    """Simulate exact flights of which a fifth is drawn near the design points of rare branches.

    Worth it where few paths carry most of a variance; elsewhere `simulate` does the same with a quarter fewer paths.
    The step, and the distribution that is sampled, are those of `simulate` with ``scheme="exact-flight"``.

    Parameters
    ----------
    scene : Scene
        What is modelled; its gaps are not random.
    paths : int
        Number of paths, rounded up to whole blocks of 1024.
    impacts : int
        Impacts of each path; other events are looked for at the first 16.
    rng : int or SeedSequence
        Seed.  The result is the same bit for bit for any number of workers.
    workers : int
        Threads.

    Returns
    -------
    RareEnsemble

    Raises
    ------
    InputError
        For settings that cannot be run, and for random gaps.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> run = simulate_rare(Scene.from_gears(DAT21, sigma=0.1), paths=2048, impacts=3, rng=1)
    >>> worst = run.branches.iloc[0]
    >>> int(worst["impact"]), round(float(worst["beta"]), 1), bool(worst["sampled"])
    (1, 3.3, True)
    """
    if not isinstance(scene, Scene):
        raise InputError("scene", scene, "give a Scene")
    if scene.tolerance is not None and scene.tolerance.distribution != "fixed":
        raise InputError("scene.tolerance", scene.tolerance, "the search for rare branches needs gaps that do not vary")
    plan = plan_of(
        scene,
        paths=paths,
        impacts=impacts,
        dt=default_step(scene, "exact-flight"),
        scheme="exact-flight",
        rng=rng,
        workers=workers,
    )
    codes = np.array(plan.itineraries[NOISE_FREE])
    pilot = pilot_of(plan, codes)
    found, unresolved = find_branches(plan, codes, pilot.sd) if scene.sigma > 0.0 else ([], [])
    sampled = choose_branches(found)
    mixture = mixture_of(sampled)
    counts = np.append(mixture.counts.ravel(), BLOCK - mixture.counts.sum())
    sums, unfinished, blocks = np.zeros((counts.size, impacts, 6, ORDERS)), 0, -(-paths // BLOCK)
    with ThreadPoolExecutor(workers) as pool:
        for part, lost in pool.map(partial(_block, plan, mixture, counts, pilot.mean), range(blocks)):
            sums += part
            unfinished += lost
    kept = counts > 0
    estimates = moments(sums[kept], blocks * counts[kept].astype(float), pilot.mean)
    return RareEnsemble(scene, blocks * BLOCK, tuple(found), tuple(sampled), tuple(unresolved), unfinished, *estimates)


def _block(
    plan: Plan, mixture: BranchMixture, counts: NDArray[np.int64], centre: Floats, block: int
) -> tuple[Floats, int]:
    """Sums of one block by parts, and its unfinished paths."""
    rows, weights = run_block(plan, mixture, block)
    sums = np.zeros((counts.size, *centre.shape, ORDERS))
    ends = np.cumsum(counts)
    for k, end in enumerate(ends):
        add(rows[end - counts[k] : end], weights[end - counts[k] : end], centre, sums[k])
    return sums, int(np.isnan(weights[:, -1]).sum())


def run_block(plan: Plan, mixture: BranchMixture, block: int) -> tuple[Floats, Floats]:
    """Run the paths of a block.

    Returns: Likelihood ratio of the plain distribution to the mixture, given the steps up to the impact. Shapes:
    `rows` (BLOCK, impacts, COLUMNS); `weights` (BLOCK, impacts).
    """
    scene, c, first = plan.scene, plan.scene.constants, block * BLOCK
    walls = np.repeat([[c.wall1], [c.wall1], [c.wall2], [c.wall2]], BLOCK, axis=1)
    rows, weights = np.full((1, BLOCK, plan.impacts, COLUMNS), np.nan), np.full((BLOCK, plan.impacts), np.nan)
    job = Job(c, backlash_of(scene), key_of(plan.seed), scene.phase, plan.dt, EXACT, False, plan.most_steps)
    every, room = lanes_of(1, first, start_state(scene, walls), walls, scene.phase)
    lanes = every.w.shape[1]
    part, ahead = np.full(lanes, -1), np.zeros(lanes)
    part[:BLOCK], ahead[:BLOCK] = targets(mixture, plan.seed, block)
    done = np.zeros((len(mixture.unit), lanes))
    run_weighted(job, mixture, first, every, room, part, ahead, done, rows, weights)
    return rows[0], weights
