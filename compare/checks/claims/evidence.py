"""The evidence for all claims, every simulation and measurement made once."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rattle.compare.chaos.effort import Effort
from rattle.compare.chaos.exponents import Exponents, Mean, drift_exponents, lyapunov, ratio_mean
from rattle.compare.chaos.measure import ChaosStudy, study
from rattle.compare.chaos.record import Regime, noisy_record, orbit_record
from rattle.compare.chaos.sweep import paper_noise, vary
from rattle.compare.validation.result import Validation
from rattle.compare.validation.validate import validate
from rattle.montecarlo import Ensemble, Record, Sampling, simulate
from rattle.montecarlo.statistics.intervals import widest
from rattle.scene import Scene, Start
from rattle.scene.tangent import Stretch

CLAIM_IMPACTS = 12  # of each validation
# times after the start at which a flight without walls is compared
COMPARED_TIMES = np.array([0.5, 1.5, 3.0])
CLAIM_STEP = 2e-3  # its time step
FEWEST_FOLLOWED = 2000  # paths whose mean velocity is followed in time, if `paths` are few
# impacts of the orbit, and steps of a noisy path, searched for repeated flanks
ORBIT_IMPACTS = 100_000
PATH_STEPS = 2_000_000
MEAN_STEP = math.pi / 96.0  # time step of the mean motion
EVERY = 12  # steps of it between two times: 16 a period
# periods after which the start is forgotten, and periods compared with each other
EVIDENCE_BURN_IN = 8
COMPARED_PERIODS = 3
ROOM_FOR_IMPACTS = 512  # more than any path has in these periods


class MeanMotion(NamedTuple):
    """The mean velocities of all paths at one time, over several periods of the excitation."""

    paths: int  # number of paths
    # largest, allowed: largest change of a mean from one period to the next in standard errors, and
    # its bound at 95 % confidence over all of them if the mean is periodic
    largest: float
    allowed: float
    # for each stage, the variance of the mean over a period over that of the velocity of single
    # paths
    share: tuple[float, ...]

    @property
    def periodic(self) -> bool:
        """Whether nothing but lines at multiples of the excitation frequency is left in the mean's
        spectrum."""
        return self.largest <= self.allowed


@dataclass(frozen=True)
class Evidence:
    """Measurements by which the claims are judged."""

    scene: Scene  # with the paper's noise
    validations: list[Validation]  # at increasing noise intensities, the last being the paper's
    chaos: ChaosStudy  # with its sweep over alpha
    single: dict[str, Exponents]  # exponents of the single-stage system: ``orbit`` and ``noisy``
    flight: Ensemble  # paths without walls
    open_space: Scene  # their scene
    # share of consecutive impacts at one mesh that are on the same flank: ``orbit`` and ``noisy``
    repeats: dict[str, Mean]
    mean: MeanMotion  # the mean velocity of an ensemble in time


def gather(
    scene: Scene,
    sigmas: Sequence[float],
    at: Sequence[float],
    paths: int,
    effort: Effort,
    progress: Callable[[str], None],
    folder: Path | None = None,
) -> Evidence:
    """Make all measurements that the claims need: validations with so many paths, and a study of
    chaos over alpha.

    `folder`: Where results of the sweep over alpha are stored.
    """
    seed = effort.seed
    workers = effort.workers
    scene = paper_noise(scene)
    levels = [*sorted(sigmas), scene.sigma]
    progress(f"closures compared with {paths:,} paths at {len(levels)} noise intensities")
    validations = [
        validate(
            scene.with_sigma(sigma),
            impacts=CLAIM_IMPACTS,
            paths=paths,
            rng=seed,
            workers=workers,
        )
        for sigma in levels
    ]
    single = replace(scene, stages=1, start=Start(0.0, scene.gap1, 2.0, 0.0, 0.0, mesh=1))
    open_space = replace(
        scene, gap1=1e6, gap2=1e6, tolerance=None, start=Start(0.3, 0.1, -0.4, -0.2, 0.5)
    )
    flight = simulate(
        open_space,
        paths=paths,
        impacts=1,
        dt=CLAIM_STEP,
        scheme="euler-maruyama",
        rng=seed,
        workers=workers,
        sampling=Sampling(horizon=COMPARED_TIMES[-1] + 1.0),
        record=Record(step_bias=True, times=open_space.start.tau + COMPARED_TIMES),
    )
    chaos = study(scene, vary(scene, "alpha", at, paper_noise), "alpha", effort, progress, folder)
    progress("a single stage, repeated flanks, the mean motion")
    alone = {
        "orbit": lyapunov(single, width=0.02),
        "noisy": drift_exponents(single, width=0.02, seed=seed),
    }
    noisy = (s for s, _ in noisy_record(scene, seed, Regime(), steps=PATH_STEPS, tangent=False))
    records = {"orbit": orbit_record(scene, ORBIT_IMPACTS, Regime(), tangent=False), "noisy": noisy}
    repeats = {of: _repeats(record) for of, record in records.items()}
    mean = mean_motion(scene, max(paths // 5, FEWEST_FOLLOWED), seed, workers)
    return Evidence(scene, validations, chaos, alone, flight, open_space, repeats, mean)


def _repeats(stretches: Iterable[Stretch]) -> Mean:
    """Share of consecutive impacts at one mesh that are on the same flank."""
    code = np.concatenate([s.code for s in stretches])
    at_mesh = [code[np.abs(code) == mesh] for mesh in np.unique(np.abs(code))]
    repeated = np.concatenate([flanks[1:] == flanks[:-1] for flanks in at_mesh]).astype(float)
    return ratio_mean(repeated, np.ones(repeated.size))


def mean_motion(scene: Scene, paths: int, seed: int, workers: int) -> MeanMotion:
    """Simulate the mean velocities after the start is forgotten."""
    period = round(2.0 * math.pi / MEAN_STEP)
    first = EVIDENCE_BURN_IN * period + EVERY
    steps = np.arange(first, first + COMPARED_PERIODS * period, EVERY)
    times = np.asarray(scene.start.tau + MEAN_STEP * steps, dtype=float)
    run = simulate(
        scene,
        paths=paths,
        impacts=ROOM_FOR_IMPACTS,
        dt=MEAN_STEP,
        rng=np.random.SeedSequence([seed, 11]),
        workers=workers,
        sampling=Sampling(horizon=float(times[-1] - scene.start.tau) + 1.0),
        record=Record(times=times),
    )
    table = run.at_times()
    largest = 0.0
    share = []
    for stage in range(1, scene.stages + 1):
        mean = table[f"y{stage}"].to_numpy().reshape(COMPARED_PERIODS, -1)
        se = table[f"se_y{stage}"].to_numpy().reshape(COMPARED_PERIODS, -1)
        change = np.abs(np.diff(mean, axis=0)) / np.hypot(se[1:], se[:-1])
        largest = max(largest, change.max())
        whole = table[f"cov_y{stage}_y{stage}"].mean() + mean.var()
        share.append(mean.mean(axis=0).var() / whole)
    compared = scene.stages * (len(steps) - len(steps) // COMPARED_PERIODS)
    return MeanMotion(run.paths, largest, widest(compared), tuple(share))
