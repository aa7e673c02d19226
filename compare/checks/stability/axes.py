"""The axes of the map: one field varies over its whole range; the others are those of DAT21 at moderate noise."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from rattle.scene import DAT21, Scene, Start

SIGMA, HALF_GAP = 0.3, 0.5
PHASE, INSIDE = 1.0, 0.2  # of the start: its phase, and x2 over the half gap
SPEED = 2.0  # speed of the start in the half gap of DAT21


def moderate(*, beta: float | None = None, gap: float = HALF_GAP, sigma: float = SIGMA, epsilon: float = 0.9) -> Scene:
    """Build DAT21 with some fields changed, and a start at a matching speed.

    The start is just before an impact at mesh 1, at a phase where the noise acts; the second stage is inside its gap,
    so that the two meshes are not struck together.  The speed is proportional to the square root of the gap g, as under
    constant acceleration.  It is at least ``(g sigma^2)^(1/3)``, which noise creates in a crossing, and at least g, so
    that a wide gap is crossed before the velocity is damped.

    Examples
    --------
    >>> moderate(gap=0.5).start.y1, round(moderate(gap=1e-8).start.y1, 6)
    (2.0, 0.000965)
    """
    pair = Scene.from_gears(DAT21)
    speed = max(SPEED * math.sqrt(gap / HALF_GAP), (gap * sigma**2) ** (1.0 / 3.0), gap)
    beta1, beta2 = (pair.beta1, pair.beta2) if beta is None else (beta, beta * pair.beta2 / pair.beta1)
    start = Start(PHASE, gap, speed, INSIDE * gap, speed, mesh=1)
    return replace(
        pair, gears=None, start=start, beta1=beta1, beta2=beta2, gap1=gap, gap2=gap, sigma=sigma, epsilon=epsilon
    )


class MapAxis(NamedTuple):
    """An axis of the map."""

    symbol: str  # for the figure
    values: tuple[float, ...]
    scene: Callable[[float], Scene]  # gives the scene at a value


AXES = {
    "beta": MapAxis(r"damping $\beta_1$", (0.0, 1e-3, 0.1, 1.0, 10.0, 100.0, 1e3), lambda v: moderate(beta=v)),
    "gap": MapAxis("half gap $g$", (1e-8, 1e-6, 1e-4, 1e-2, 0.5, 30.0, 1e4), lambda v: moderate(gap=v)),
    "sigma": MapAxis(r"noise $\sigma$", (0.0, 1e-3, 0.03, 0.3, 3.0, 100.0, 1e4), lambda v: moderate(sigma=v)),
    "epsilon": MapAxis(r"restitution $\epsilon$", (0.0, 0.1, 0.3, 0.6, 0.9, 0.99, 1.0), lambda v: moderate(epsilon=v)),
}
"""All axes by name."""
