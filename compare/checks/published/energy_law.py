"""The energy lost in impacts is that which noise and drive supply, whatever the restitution and the gaps."""

import math
from dataclasses import replace
from typing import Any

from rattle.compare.checks.check import Check, Result
from rattle.montecarlo.long_run import LongRun, long_run
from rattle.montecarlo.long_run.control import corrections
from rattle.montecarlo.long_run.noise_work import CONTROLS
from rattle.montecarlo.long_run.sums import NOISE
from rattle.scene import DAT21, Scene

UNDRIVEN: dict[str, Any] = {"alpha": 0.0, "beta1": 0.0, "gamma1": 0.0, "sigma": 1.0}

SCENES = {
    "one stage, eps 0.3": (Scene(epsilon=0.3, gap1=1.0, stages=1, **UNDRIVEN), 64),
    "one stage, eps 0.5": (Scene(epsilon=0.5, stages=1, **UNDRIVEN), 64),
    "one stage, eps 0.9": (Scene(epsilon=0.9, stages=1, **UNDRIVEN), 64),
    "two stages, eps 0.5": (Scene(epsilon=0.5, mu=0.6, **UNDRIVEN), 64),
    "two stages, eps 0.8": (Scene(epsilon=0.8, mu=0.3, gap2=0.8, **UNDRIVEN), 64),
    "driven, damped, dragged": (Scene(alpha=1.0, epsilon=0.7, beta1=0.3, gamma1=0.1, sigma=1.0, stages=1), 128),
    "driven, weak noise": (Scene(alpha=1.5, epsilon=0.6, beta1=0.1, gamma1=0.05, sigma=0.3, stages=1), 64),
    "DAT21 at sigma 0.5": (Scene.from_gears(DAT21, sigma=0.5), 64),
}
"""Scenes, and the periods for which each is followed."""


def _check(name: str, run: LongRun, kept: float = 1.0, noise: float = 1.0) -> Check:
    """Loss against supply; `kept` of the loss is counted, and the noise supplies `noise` times what it does.

    Of their difference, the noise's own work, whose mean is zero, explains most of the variance.
    """
    lost, supplied = run.energy_balance()
    more = (noise - 1.0) * _by_noise(run.scene)
    difference, work = kept * lost - supplied, run.sums.main[:, :, NOISE : NOISE + CONTROLS].sum(axis=1)
    difference -= (work[:, :, None] * corrections(difference[:, None], work)).sum(axis=(1, 2))
    se = float(difference.std(ddof=1)) / math.sqrt(run.paths)
    closed = max(run.estimates[f"contact_share_mesh{m}"].value for m in range(1, run.scene.stages + 1))
    return Check(
        f"loss per time, {name}",
        float((supplied + difference).mean()),
        float(supplied.mean()) + more,
        se,
        2.0 * closed * _by_noise(run.scene),
    )


def _by_noise(scene: Scene) -> float:
    """What the noise supplies per unit of time."""
    mass = scene.mu / (1.0 - scene.mu) if scene.stages == 2 else 0.0
    return 0.25 * scene.sigma**2 * (1.0 + scene.beta1**2 + mass * (1.0 + scene.beta2**2))


def energy_law(seed: int = 0, workers: int = 2) -> Result:
    """Check the energy balance of eight long runs, driven and not, of one stage and of two."""
    runs = {
        name: long_run(scene, periods=periods, rng=seed + 31 * i, workers=workers)
        for i, (name, (scene, periods)) in enumerate(SCENES.items())
    }
    two = {name: run for name, run in runs.items() if run.scene.stages == 2}
    light = {name: replace(run, scene=replace(run.scene, mu=0.98 * run.scene.mu)) for name, run in two.items()}
    return Result(
        "energy law",
        "energy balance (Itô), docs/model.md section 10",
        "the energy lost in impacts per unit of time is what noise and drive supply less what damping takes; without "
        "drive and damping sigma^2 / 4, and sigma^2 / (4 (1 - mu)) with two stages: long_run()",
        [_check(name, run) for name, run in runs.items()],
        {
            **{f"2 % of the loss missing, {n}": [_check(n, run, 0.98)] for n, run in runs.items()},
            "2 % less mass of wheel 2": [_check(name, run) for name, run in light.items()],
            "noise of 2 % more energy": [_check(name, run, 1.0, 1.02) for name, run in runs.items()],
        },
    )
