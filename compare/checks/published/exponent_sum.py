"""The sum of all Lyapunov exponents is the rate at which damping and impacts contract volumes of state space."""

import math

from rattle.compare.chaos.exponents import Exponents, drift_exponents, lyapunov
from rattle.compare.checks.published.result import Check, Measured, NegativeControl
from rattle.scene import DAT21, Scene

IMPACTS = 20_000
ROUNDING = 1e-10
SIGMA = 0.1  # noise intensity of the noisy path


def _check(scene: Scene, found: Exponents, power: float, damping: float) -> Check:
    truth = -damping + found.rate * power * math.log(scene.epsilon)
    return Check(f"sum of exponents, {found.of}", float(found.value.sum()), truth, 0.0, ROUNDING)


def exponent_sum(seed: int = 0, workers: int = 2) -> Measured:
    """Check the sum of the four exponents of DAT21: of the orbit, and of the drift along a noisy path.

    Examples
    --------
    >>> [check.holds(4.5) for check in exponent_sum().checks]
    [True, True]
    """
    scene = Scene.from_gears(DAT21)
    records = lyapunov(scene, impacts=IMPACTS), drift_exponents(scene.with_sigma(SIGMA), impacts=IMPACTS, seed=seed)
    both = scene.beta1 + scene.beta2

    def checks(power: float, damping: float) -> list[Check]:
        return [_check(scene, found, power, damping) for found in records]

    return Measured(
        "exponent sum",
        "Liouville; Mueller 1995 (saltation)",
        "the exponents of four-dimensional frames add up to -(beta1 + beta2) + rate 2 ln epsilon: orbit and noisy path",
        checks(2.0, both),
        [
            NegativeControl("epsilon to the first power", checks(1.0, both)),
            NegativeControl("damping of one stage alone", checks(2.0, scene.beta1)),
            NegativeControl("1 % more damping", checks(2.0, 1.01 * both)),
        ],
    )
