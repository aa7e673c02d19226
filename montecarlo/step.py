"""How long a step may be before a scheme is unstable or blind."""

import math

from montecarlo.schemes import SCHEMES
from scene.errors import InputError
from scene.scene import Scene
from scene.validate import finite

__all__ = ["check_step", "largest_step"]


def largest_step(scene: Scene, scheme: str = "euler-maruyama") -> tuple[float, str]:
    """The longest step that the door lets through, and what limits it.

    A step of Euler and Maruyama must damp without overshoot (``beta dt <= 1``, well inside the stability bound 2),
    resolve the excitation (20 steps a period), and not cross half of the narrowest half gap at a typical speed.  A step
    of ``exact-flight`` sees every gap, but what it leaves out of the noise (a share of order h^4 of the variance)
    counts where the variance begins from nothing: at this limit 0.8 % of sd(x1) after a flight of 0.2 from tau = 0, at
    half of it 0.05 %.

    Examples
    --------
    >>> from scene import DAT21, Scene
    >>> dt, why = largest_step(Scene.from_gears(DAT21))
    >>> round(dt, 3), why
    (0.125, 'a longer step cannot see the gap')
    >>> largest_step(Scene.from_gears(DAT21), "exact-flight")[1]
    "a longer step cannot follow the noise's modulation"
    """
    c, start, tolerance = scene.constants, scene.start, scene.tolerance
    fastest = max(c.beta1, c.beta2)
    damped = 1.0 / fastest if fastest > 0.0 else math.inf
    if SCHEMES[scheme].weak_order is None:
        limits = {
            "a longer step cannot follow the damping": 0.2 * damped,
            "a longer step cannot follow the noise's modulation": 0.1,
        }
    else:
        c_max = (tolerance.c1_max, tolerance.c2_max) if tolerance else (0.0, 0.0)
        gaps = [scene.gap1 - c_max[0], scene.gap2 - c_max[1]]
        speeds = [abs(start.y1), abs(start.y2)]
        narrowest = min(gaps[: scene.stages])
        typical = max(c.alpha + c.sigma, *speeds[: scene.stages])
        limits = {
            "a longer step makes the damping unstable": damped,
            "a longer step cannot follow the excitation": 2.0 * math.pi / 20.0,
            "a longer step cannot see the gap": 0.5 * narrowest / typical if typical > 0.0 else math.inf,
        }
    reason = min(limits, key=lambda name: limits[name])
    return limits[reason], reason


def check_step(scene: Scene, dt: float, scheme: str, coarsest: int = 1) -> float:
    """The step as a float, if it may be used, and its `coarsest` multiple too where that has a bias to be measured.

    Raises
    ------
    InputError
        Says how long the step may be, and why.
    """
    if not finite("dt", dt) > 0.0:
        raise InputError("dt", dt, "must be greater than 0")
    largest, reason = largest_step(scene, scheme)
    coarsest = 1 if SCHEMES[scheme].weak_order is None else coarsest
    if dt * coarsest > largest:
        with_bias = f" ({coarsest} dt is run beside it for the step bias)" if coarsest > 1 else ""
        raise InputError("dt", dt, f"must be at most {largest / coarsest:.3g}{with_bias}: {reason}")
    return float(dt)
