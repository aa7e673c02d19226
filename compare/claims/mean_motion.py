"""The mean velocity of an ensemble of paths: whether it repeats itself with the excitation, and how large it is."""

import math
from typing import NamedTuple

import numpy as np

from rattle.compare.validation.verdict import widest
from rattle.montecarlo import Record, simulate
from rattle.scene.scene import Scene

STEP = math.pi / 96.0
EVERY = 12  # steps between two times: 16 a period
SETTLED, COMPARED = 8, 3  # periods after which the start is forgotten, and periods compared with each other
IMPACTS = 512  # more than any path has in these periods


class MeanMotion(NamedTuple):
    """The mean velocities of all paths at one time, over several periods of the excitation."""

    paths: int  # number of paths
    # largest, allowed: largest change of a mean from one period to the next in standard errors, and its bound at 95 %
    # confidence over all of them if the mean is periodic
    largest: float
    allowed: float
    # for each stage, the variance of the mean over a period over that of the velocity of single paths
    share: tuple[float, ...]

    @property
    def periodic(self) -> bool:
        """Whether nothing but lines at multiples of the excitation frequency is left in the mean's spectrum."""
        return self.largest <= self.allowed


def mean_motion(scene: Scene, paths: int, seed: int, workers: int) -> MeanMotion:
    """Simulate the mean velocities after the start is forgotten."""
    period = round(2.0 * math.pi / STEP)
    steps = np.arange(SETTLED * period, (SETTLED + COMPARED) * period, EVERY) + EVERY
    times = np.asarray(scene.start.tau + STEP * steps, dtype=float)
    run = simulate(
        scene,
        paths=paths,
        impacts=IMPACTS,
        dt=STEP,
        scheme="exact-flight",
        rng=np.random.SeedSequence([seed, 11]),
        workers=workers,
        horizon=float(times[-1] - scene.start.tau) + 1.0,
        record=Record(times=times),
    )
    table, largest, share = run.at_times(), 0.0, []
    for stage in range(1, scene.stages + 1):
        mean, se = (table[f"{prefix}y{stage}"].to_numpy().reshape(COMPARED, -1) for prefix in ("", "se_"))
        change = np.abs(np.diff(mean, axis=0)) / np.hypot(se[1:], se[:-1])
        largest = max(largest, float(change.max()))
        whole = table[f"cov_y{stage}_y{stage}"].mean() + mean.var()
        share.append(float((mean.mean(axis=0).var()) / whole))
    compared = scene.stages * (len(steps) - len(steps) // COMPARED)
    return MeanMotion(run.paths, largest, widest(compared), tuple(share))
