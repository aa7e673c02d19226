"""The axes of the map: one field of the scene over its whole range, the others those of DAT21 at moderate noise."""

import math
from collections.abc import Callable
from typing import NamedTuple

from rattle.scene import DAT21, Scene, Start

__all__ = ["AXES", "Axis", "moderate"]

SIGMA, HALF_GAP, PHASE, INSIDE = 0.3, 0.5, 1.0, 0.2
SPEED = 2.0  # of the start in the half gap of DAT21


def moderate(*, beta: float | None = None, gap: float = HALF_GAP, sigma: float = SIGMA, epsilon: float = 0.9) -> Scene:
    """DAT21 with one thing changed, and a start that suits it.

    The start is just before an impact at mesh 1, at a phase where the noise is at work; the second stage is within its
    gap, so that both do not arrive together.  The speed goes with the root of the gap, as that of a path that is
    carried across it by one acceleration; it is not less than the noise makes in a crossing, ``(g sigma^2)^(1/3)``,
    nor than what takes a path through a wide gap before it is damped.

    Examples
    --------
    >>> moderate(gap=0.5).start.y1, round(moderate(gap=1e-8).start.y1, 6)
    (2.0, 0.000965)
    """
    pair = Scene.from_gears(DAT21)
    speed = max(SPEED * math.sqrt(gap / HALF_GAP), (gap * sigma**2) ** (1.0 / 3.0), gap)
    beta1, beta2 = (pair.beta1, pair.beta2) if beta is None else (beta, beta * pair.beta2 / pair.beta1)
    return Scene(
        alpha=pair.alpha, epsilon=epsilon, beta1=beta1, beta2=beta2, gamma1=pair.gamma1, gamma2=pair.gamma2,
        mu=pair.mu, gap1=gap, gap2=gap, sigma=sigma, start=Start(PHASE, gap, speed, INSIDE * gap, speed, mesh=1),
    )  # fmt: skip


class Axis(NamedTuple):
    """A field that is varied: its symbol, its values, and the scene at a value."""

    symbol: str
    values: tuple[float, ...]
    scene: Callable[[float], Scene]


AXES = {
    "beta": Axis(r"damping $\beta_1$", (0.0, 1e-3, 0.1, 1.0, 10.0, 100.0, 1e3), lambda v: moderate(beta=v)),
    "gap": Axis("half gap $g$", (1e-8, 1e-6, 1e-4, 1e-2, 0.5, 30.0, 1e4), lambda v: moderate(gap=v)),
    "sigma": Axis(r"noise $\sigma$", (0.0, 1e-3, 0.03, 0.3, 3.0, 100.0, 1e4), lambda v: moderate(sigma=v)),
    "epsilon": Axis(r"restitution $\epsilon$", (0.0, 0.1, 0.3, 0.6, 0.9, 0.99, 1.0), lambda v: moderate(epsilon=v)),
}
"""By name."""
