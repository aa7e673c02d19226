"""How long a step may be: the door, beyond which a scheme is unstable or blind, and the default behind it.

`rattle stability` measures both sides of these limits (reports/stability).
"""

import math
from typing import NamedTuple

from rattle.montecarlo.noise.philox import LEVELS
from rattle.montecarlo.schemes.table import SCHEMES
from rattle.scene.errors import InputError
from rattle.scene.impact import struck
from rattle.scene.scene import Scene
from rattle.scene.validate import finite

__all__ = ["Scales", "accurate_flight", "check_step", "default_step", "largest_step", "scales_of", "trusted_step"]

Limit = tuple[float, str]

MOST_PER_STEP = 10**7
"""Least step: so many of them make the longest that may be used."""

COARSEST = 2 ** (LEVELS - 1)
"""Step, in units of the finest, of those that run side by side for the step bias."""


class Scales(NamedTuple):
    """Times within which something happens that a step must not miss; infinite where it does not happen.

    Attributes
    ----------
    damping : float
        Memory of the faster damped wheel, ``1 / beta``.
    crossing : float
        The narrowest half gap at a typical speed: that of the start, or what the excitation and the drag make of a
        path within one crossing.
    shaking : float
        The noise alone takes a path across that half gap: ``(g / sigma)^(2/3)``, or by diffusion, ``(beta g /
        sigma)^2``, where damping is faster than that.
    turning : float
        The noise turns back a path that leaves its wall at the start: ``(speed / sigma)^2``.
    """

    damping: float
    crossing: float
    shaking: float
    turning: float


def scales_of(scene: Scene) -> Scales:
    """The time scales of a scene.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> [round(t, 3) for t in scales_of(Scene.from_gears(DAT21, sigma=0.5))]
    [7.5, 0.25, 0.998, 12.871]
    """
    c, start, tolerance = scene.constants, scene.start, scene.tolerance
    narrow = (0.0, 0.0)
    if (
        tolerance is not None and tolerance.distribution != "fixed"
    ):  # few paths have a gap below a tenth, however large c_max is
        narrow = min(tolerance.c1_max, 0.9 * c.wall1), min(tolerance.c2_max, 0.9 * c.wall2)
    gap = min((c.wall1 - narrow[0], c.wall2 - narrow[1])[: c.stages])
    damping = _over(1.0, max(c.beta1, c.beta2))
    most = math.hypot(1.0, c.beta1)  # of the modulation of excitation and noise in y1 (Eq. 5)
    shaken = min(c.alpha, 2.0 * math.sqrt(c.alpha * most * gap))  # in a narrow gap both flanks move together
    phi2 = (
        min(_over(gamma, beta), 2.0 * math.sqrt(gamma * gap))
        for gamma, beta in ((c.gamma1, c.beta1), (c.gamma2, c.beta2))
    )
    typical = max(shaken, *phi2, *(abs(start.y1), abs(start.y2))[: c.stages])
    noise = c.sigma * most
    shaking = _over(gap, noise) ** (2.0 / 3.0)
    if shaking > damping:
        shaking = max(damping, _over(gap, noise * damping) ** 2)
    return Scales(damping, _over(gap, typical), shaking, _over(_leaving(scene), noise) ** 2)


def _over(a: float, b: float) -> float:
    """``a / b``, infinite for b = 0."""
    return a / b if b > 0.0 else math.inf


def _leaving(scene: Scene) -> float:
    """Slowest speed with which a stage leaves a wall at the start; infinite if none does."""
    x1, y1, x2, y2 = scene.start_state
    c, mesh = scene.constants, scene.start.mesh
    if mesh:
        y1, y2 = struck(c, mesh, y1, y2)
    stages = ((x1, y1, c.wall1), (x2, y2, c.wall2))[: c.stages]
    return min((abs(y) for x, y, wall in stages if abs(x) >= wall), default=math.inf)


def accurate_flight(scene: Scene) -> Limit:
    """The longest step in which ``exact-flight`` may leave out what it leaves out of the noise, and what limits it.

    What is left out (a share of order h^4 of the variance) counts where the variance begins from nothing: at this limit
    0.8 % of sd(x1) after a flight of 0.2 from tau = 0, at half of it 0.05 %.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> accurate_flight(Scene.from_gears(DAT21))
    (0.1, "a longer step cannot follow the noise's modulation")
    """
    limits = {
        "a longer step cannot follow the damping": 0.2 * scales_of(scene).damping,
        "a longer step cannot follow the noise's modulation": 0.1,
    }
    return _least(limits)


def largest_step(scene: Scene, scheme: str = "euler-maruyama") -> Limit:
    """The longest step that the door lets through, and what limits it.

    A step of Euler and Maruyama must damp without overshoot (``beta dt <= 1``, well inside the stability bound 2),
    resolve the excitation (20 steps a period), not cross half of the narrowest half gap at a typical speed, and not be
    thrown through it by the noise.  A step of ``exact-flight`` sees every gap; but it must be accurate
    (`accurate_flight`), and beyond two half crossings it follows impacts that nobody asked for, to the 64 of a step.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> dt, why = largest_step(Scene.from_gears(DAT21))
    >>> round(dt, 3), why
    (0.125, 'a longer step cannot see the gap')
    >>> largest_step(Scene.from_gears(DAT21), "exact-flight")[1]
    "a longer step cannot follow the noise's modulation"
    """
    t = scales_of(scene)
    if SCHEMES[scheme].weak_order is None:
        accurate, why = accurate_flight(scene)
        return _least({why: accurate, "a longer step holds too many impacts": 2.0 * min(t.crossing, t.shaking)})
    return _least({
        "a longer step makes the damping unstable": t.damping,
        "a longer step cannot follow the excitation": 2.0 * math.pi / 20.0,
        "a longer step cannot see the gap": 0.5 * t.crossing,
        "a longer step lets the noise throw a path through the gap": 0.25 * t.shaking,
    })  # fmt: skip


def trusted_step(scene: Scene, scheme: str) -> Limit:
    """The longest step at which what the noise does within a step biases no mean by 5 % of its sd; and what limits it.

    What the step does to the noise-free motion is not in it: `rattle.montecarlo.diagnostics` measures that.  The shares
    are those that `rattle stability` finds to hold over all of its axes.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> round(trusted_step(Scene.from_gears(DAT21, sigma=0.5), "euler-maruyama")[0], 4)
    0.01
    """
    if SCHEMES[scheme].weak_order is None:
        return largest_step(scene, scheme)
    t, (seen, phi1) = scales_of(scene), SEEN[scheme]
    return _least({
        "a longer step changes the spread of the damped speeds": 0.3 * t.damping,
        "a longer step sees the impacts of a shaken path late": seen * t.shaking,
        "a longer step loses paths that the noise turns back to their wall": phi1 * t.turning,
    })  # fmt: skip


SEEN = {"euler-maruyama": (0.01, 0.03), "euler-maruyama-located": (0.04, 0.05)}
"""Shares of `Scales.shaking` and `Scales.turning` in a trusted step: detection at its end is late by half a step."""


def _least(limits: dict[str, float]) -> Limit:
    reason = min(limits, key=lambda name: limits[name])
    return limits[reason], reason


def default_step(scene: Scene, scheme: str, step_bias: bool = False) -> float:
    """The scheme's own step, or a shorter one where the door wants it, for the multiples of it that have a bias too.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> default_step(Scene.from_gears(DAT21), "euler-maruyama")
    0.002
    >>> round(default_step(Scene.from_gears(DAT21, sigma=1e4), "euler-maruyama"), 6)
    0.000339
    """
    coarsest = COARSEST if step_bias and SCHEMES[scheme].weak_order is not None else 1
    return min(SCHEMES[scheme].step, largest_step(scene, scheme)[0] / coarsest)


def check_step(scene: Scene, dt: float, scheme: str, coarsest: int = 1) -> float:
    """The step as a float, if it may be used, and its `coarsest` multiple too where that has a bias to be measured.

    Raises
    ------
    InputError
        Says how long or short the step may be, and why.
    """
    if not finite("dt", dt) > 0.0:
        raise InputError("dt", dt, "must be greater than 0")
    largest, reason = largest_step(scene, scheme)
    if dt < largest / MOST_PER_STEP:
        raise InputError(
            "dt", dt, f"must be at least {largest / MOST_PER_STEP:.3g}: {MOST_PER_STEP:.0e} shorter steps, after which "
            "a path is given up by default, do not make one of the longest that may be used",
        )  # fmt: skip
    coarsest = 1 if SCHEMES[scheme].weak_order is None else coarsest
    if dt * coarsest > largest:
        with_bias = f" ({coarsest} dt is run beside it for the step bias)" if coarsest > 1 else ""
        raise InputError("dt", dt, f"must be at most {largest / coarsest:.3g}{with_bias}: {reason}")
    return float(dt)
