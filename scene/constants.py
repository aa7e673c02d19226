"""The numbers of a scene, and of its model, as compiled code takes them."""

from typing import NamedTuple

CUT = 2.0  # c_max in standard deviations of the normal distribution that is truncated there


class Constants(NamedTuple):
    """The numbers of a scene, as a named tuple for compiled code (dimensionless)."""

    # alpha, epsilon, beta1, beta2, gamma1, gamma2, mu, sigma, stages: as of `Scene`; ``beta2 = gamma2 = mu = 0`` for
    # a single stage
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
