"""What everything here works with: arrays, names of the state, and the numbers of a scene for
compiled code."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

STATE = ("x1", "y1", "x2", "y2")
SECTION = ("tau", "flight", *STATE)
"""The section quantities: those of a path just before its own k-th impact (a Poincaré section at
the impacts)."""

CUT = 2.0  # c_max in standard deviations of the normal distribution that is truncated there


class Orders(NamedTuple):
    """The driver's motion ``f(tau) = sum_j a_j sin(j tau + phi_j)`` for compiled code
    (docs/model.md section 1)."""

    order: Floats  # j, ascending; (orders,)
    gap: Ints  # j less the order before it, or 0 where that is too far; (orders,)
    odd: Floats  # odd, even: a_j cos phi_j and a_j sin phi_j, of sin j tau and cos j tau; (orders,)
    even: Floats
    highest: float  # the largest j
    most1: float  # most1, most2, most3: bounds of the first three derivatives of f
    most2: float
    most3: float
    # scratch of `rattle.scene.drive.begin_derivatives`: of one thread, so `Scene.constants` makes
    # a new one each time; (2, orders)
    waves: Floats


SINE: tuple[()] = ()
"""The drive ``f = sin tau``, in place of `Orders`: another type, so that its machine code knows no
sum."""


class Constants(NamedTuple):
    """The numbers of a scene, as a named tuple for compiled code (dimensionless)."""

    # alpha, epsilon, beta1, beta2, gamma1, gamma2, mu, sigma, stages: as of `Scene`; ``beta2 =
    # gamma2 = mu = 0`` for a single stage
    alpha: float
    epsilon: float
    beta1: float
    beta2: float
    gamma1: float
    gamma2: float
    mu: float
    wall1: float  # wall1, wall2: half gaps of the deterministic orbit
    wall2: float
    sigma: float
    stages: int
    drive: Any = SINE  # `SINE` or `Orders`
    memory: float = 0.0  # correlation time of the noise; 0 for white noise
