"""Twelve random gear sets on which the branching closure is tuned (the first six) and judged (the last six)."""

import math
from dataclasses import replace

import numpy as np

from rattle.scene import Scene, Start

__all__ = ["NOISE", "TUNED", "gear_sets", "noisy"]

SEED = 17
TUNED = 6
NOISE = (0.01, 0.03, 0.1, 0.3, 1.0)
"""``sigma / sqrt(alpha)``."""


def gear_sets(seed: int = SEED, sets: int = 12) -> list[Scene]:
    """One and two stages in turn, restitution 0.3 to 0.95, unequal gaps, excitation 0.5 to 3; without noise."""
    rng, found = np.random.default_rng(seed), []
    for i in range(sets):
        alpha, gap2 = rng.uniform(0.5, 3.0), rng.uniform(0.25, 1.0)
        rates = {f"beta{k}": 10.0 ** rng.uniform(-1.5, -0.5) for k in (1, 2)}
        drags = {f"gamma{k}": 10.0 ** rng.uniform(-2.0, -0.7) for k in (1, 2)}
        epsilon, mu = rng.uniform(0.3, 0.95), rng.uniform(0.3, 0.8)
        speed1, speed2 = rng.uniform(0.5, 1.5, 2) * alpha
        start = Start(rng.uniform(0.0, 2.0 * np.pi), 0.5, speed1, rng.uniform(-0.8, 0.8) * gap2, speed2, 1)
        found.append(
            Scene(
                alpha=alpha, epsilon=epsilon, mu=mu, gap2=gap2, start=start, stages=1 + i % 2, **rates, **drags
            )
        )  # fmt: skip
    return found


def noisy(scene: Scene, noise: float) -> Scene:
    """A gear set with noise ``sigma = noise sqrt(alpha)``."""
    return replace(scene, sigma=noise * math.sqrt(scene.alpha))
