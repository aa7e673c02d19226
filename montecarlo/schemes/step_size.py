"""The schemes, the longest admissible step of each, beyond which it is unstable or misses impacts,
and its default.

`rattle check stability` measures both sides of these limits (reports/stability).
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rattle.montecarlo.noise.philox import LEVELS
from rattle.montecarlo.schemes.control_variate import orbit_impacts
from rattle.montecarlo.schemes.short_flight import kick
from rattle.scene import InputError, Scene, finite
from rattle.scene.drive import highest_order, most_modulation, most_velocity
from rattle.scene.flight import jacobian, noise_covariance
from rattle.scene.linear_algebra import transform
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.orbit import first_state


@dataclass(frozen=True)
class Scheme:
    """A way to advance paths and to detect impacts."""

    code: int  # its number in compiled code
    # weak order of convergence in the step; None for a scheme without step bias
    weak_order: int | None
    normals: int  # standard normals of a path per step without an impact
    step: float  # default step
    # step_ns, impact_ns: cost model for the choice of a scheme: time of a path-step and of an
    # impact on one core in ns, with statistics. Measured once, on an Intel Xeon with AVX-512 (12
    # impacts on DAT21 with two steps each, the least of interleaved slices), and constant, so that
    # the choice does not depend on the machine
    step_ns: float
    impact_ns: float

    @property
    def has_step_bias(self) -> bool:
        """Whether its results are biased by the length of the step; ``exact-flight`` has no such
        bias."""
        return self.weak_order is not None


SCHEMES = {
    "euler-maruyama": Scheme(0, 1, 1, 2e-3, 3.9, 130.0),
    "euler-maruyama-located": Scheme(1, 1, 1, 2e-3, 5.1, 250.0),
    "exact-flight": Scheme(2, None, 2, math.pi / 96.0, 5.1, 740.0),
}
"""All schemes by name, in the order of increasing accuracy."""

Limit = tuple[float, str]

LEFT_OUT = 2e-4
"""Largest share of an sd that the noise left out by a default step may have."""

MOST_PER_STEP = 10**7
"""Longest admissible step over the shortest."""

COARSEST = 2 ** (LEVELS - 1)
"""Coarsest step over the finest: dt, 2 dt and 4 dt share one Brownian path (Richardson
extrapolation)."""


# impacts and time after the start at which noise is looked for that a step leaves out
IMPACTS = 4
TIME = 0.5
STEPS = 32  # of a flight from which on it has no effect: 1 / (6 * 32^4) of the variance


class TimeScales(NamedTuple):
    """Time scales that a step must resolve; infinite where there is no such process."""

    damping: float  # relaxation time of the faster damped wheel, ``1 / beta``
    # time to cross the narrowest half gap at a typical speed: that of the start, or what excitation
    # and drag make of a path within one crossing
    crossing: float
    # time in which noise alone takes a path across that half gap: ``(g / sigma)^(2/3)``, or by
    # diffusion ``(beta g / sigma)^2`` where damping is faster than that
    shaking: float
    # time in which noise reverses the velocity of a path that leaves its wall at the start:
    # ``(speed / sigma)^2``
    turning: float


def time_scales(scene: Scene) -> TimeScales:
    """The time scales of a scene."""
    c = scene.constants
    start = scene.start
    tolerance = scene.tolerance
    narrow = (0.0, 0.0)
    if tolerance is not None and tolerance.distribution != "fixed":
        # at most to a tenth: few paths have a narrower gap, however large c_max is
        narrow = min(tolerance.c1_max, 0.9 * c.wall1), min(tolerance.c2_max, 0.9 * c.wall2)
    gap = min((c.wall1 - narrow[0], c.wall2 - narrow[1])[: c.stages])
    damping = _over(1.0, max(c.beta1, c.beta2))
    # largest modulation of excitation and noise in y1 (Eq. 5)
    most = math.hypot(1.0, c.beta1) if not c.drive else most_modulation(c.drive, c.beta1)
    # a narrow gap bounds the relative speed
    driven = min(c.alpha * most_velocity(c.drive), 2.0 * math.sqrt(c.alpha * most * gap))
    drags = (c.gamma1, c.beta1), (c.gamma2, c.beta2)
    dragged = (min(_over(gamma, beta), 2.0 * math.sqrt(gamma * gap)) for gamma, beta in drags)
    typical = max(driven, *dragged, *(abs(start.y1), abs(start.y2))[: c.stages])
    noise = c.sigma * most
    shaking = _over(gap, noise) ** (2.0 / 3.0)
    if shaking > damping:
        shaking = max(damping, _over(gap, noise * damping) ** 2)
    return TimeScales(damping, _over(gap, typical), shaking, _over(_leaving(scene), noise) ** 2)


MEMORY = "a longer step cannot follow the memory of the noise"


def _memory(scene: Scene) -> float:
    """The longest step for noise with a memory, a tenth of it; infinite for white noise."""
    return 0.1 * scene.correlation_time if scene.correlation_time else math.inf


def _over(a: float, b: float) -> float:
    """``a / b``, infinite for b = 0."""
    return a / b if b > 0.0 else math.inf


def _leaving(scene: Scene) -> float:
    """Slowest speed with which a stage leaves a wall at the start; infinite if none does."""
    c = scene.constants
    x1, y1, x2, y2 = first_state(scene)
    stages = ((x1, y1, c.wall1), (x2, y2, c.wall2))[: c.stages]
    return min((abs(y) for x, y, wall in stages if abs(x) >= wall), default=math.inf)


def accurate_flight(scene: Scene) -> Limit:
    """The longest accurate step of ``exact-flight``, which neglects part of the noise within a
    step; and its reason.

    The neglected part (of relative order h^4 of the variance) matters where the variance grows from
    zero: at this limit 0.8 % of sd(x1) after a flight of 0.2 from tau = 0, at half of it 0.05 %.
    """
    limits = {
        MEMORY: _memory(scene),
        "a longer step cannot follow the damping": 0.2 * time_scales(scene).damping,
        "a longer step cannot follow the noise's modulation": (
            0.1 / highest_order(scene.constants.drive)
        ),
    }
    return _least(limits)


@numpy_defaults
def largest_step(scene: Scene, scheme: str = "euler-maruyama") -> Limit:
    """The longest admissible step of a scheme, and the reason for the limit.

    An Euler-Maruyama step must damp without overshoot (``beta dt <= 1``, well inside the stability
    bound 2), resolve the excitation (20 steps a period), not cross half of the narrowest half gap
    at a typical speed, nor be carried through it by the noise.  A step of ``exact-flight`` resolves
    every gap; but it must be accurate (`accurate_flight`), and not be longer than two half
    crossings, since the impacts in one step are limited to 64.

    Parameters
    ----------
    scene : Scene
        What is simulated.
    scheme : str
        Name in `SCHEMES`.

    Returns
    -------
    limit : float
        Step.
    why : str
        The reason, as part of a message.

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> dt, why = largest_step(Scene.from_gears(DAT21))
    >>> round(dt, 3), why
    (0.125, 'a longer step may jump across the gap')
    >>> largest_step(Scene.from_gears(DAT21), "exact-flight")[1]
    "a longer step cannot follow the noise's modulation"
    """
    t = time_scales(scene)
    if not SCHEMES[scheme].has_step_bias:
        accurate, why = accurate_flight(scene)
        return _least(
            {
                why: accurate,
                "a longer step holds too many impacts": 2.0 * min(t.crossing, t.shaking),
            }
        )
    limits = {
        "a longer step makes the damping unstable": t.damping,
        MEMORY: _memory(scene),
        "a longer step cannot follow the excitation": (
            2.0 * math.pi / 20.0 / highest_order(scene.constants.drive)
        ),
        "a longer step may jump across the gap": 0.5 * t.crossing,
        "a longer step lets the noise throw a path through the gap": 0.25 * t.shaking,
    }
    return _least(limits)


def trusted_step(scene: Scene, scheme: str) -> Limit:
    """The longest step at which noise within a step biases no mean by 5 % of its sd, and the reason
    for the limit.

    The effect of the step on the noise-free motion is not included: that is measured by
    `rattle.montecarlo.diagnostics.diagnostics`.
    `rattle check stability` finds these limits to hold over all of its axes.
    """
    if not SCHEMES[scheme].has_step_bias:
        return largest_step(scene, scheme)
    t = time_scales(scene)
    late, reversal = TRUSTED_SHARES[scheme]
    limits = {
        "a longer step changes the spread of the damped speeds": 0.3 * t.damping,
        "a longer step detects the impacts of a noisy path late": late * t.shaking,
        "a longer step misses paths that the noise returns to the wall they leave": (
            reversal * t.turning
        ),
    }
    return _least(limits)


TRUSTED_SHARES = {"euler-maruyama": (0.01, 0.03), "euler-maruyama-located": (0.04, 0.05)}
"""Trusted step over `TimeScales.shaking` and over `TimeScales.turning`: at-end detection is late by
half a step."""


def _least(limits: dict[str, float]) -> Limit:
    reason = min(limits, key=lambda name: limits[name])
    return limits[reason], reason


@lru_cache(maxsize=256)
def neglected_noise(scene: Scene, dt: float) -> float:
    """Largest share of an sd of the section that steps of ``exact-flight`` leave out, at the
    orbit's first impacts.

    A step keeps two Legendre coefficients of its noise.  The third matters where the variance grows
    from zero and the modulation crosses zero within a flight of about a step: of ``x`` after a
    flight of n steps from there it is a share ``1 / (6 n^4)`` of the variance.
    """
    if scene.sigma == 0.0 or scene.correlation_time:
        return 0.0
    c = scene.constants
    tau = scene.phase
    worst = 0.0
    # covariances
    whole = np.zeros((5, 5))
    missing = np.zeros((5, 5))
    for impact in orbit_impacts(scene, IMPACTS):
        if impact.tau - scene.phase > min(TIME, STEPS * dt):
            break
        while tau < impact.tau:
            end = min(
                impact.tau, scene.phase + (math.floor((tau - scene.phase) / dt + 1e-9) + 1) * dt
            )
            end = max(end, math.nextafter(tau, math.inf))
            h = end - tau
            carry = np.eye(5)
            exact = np.zeros((5, 5))
            carry[:4, :4], exact[:4, :4] = jacobian(c, h), noise_covariance(c, tau, h)
            whole = transform(carry, whole) + exact
            missing = transform(carry, missing) + exact
            for kept in (
                kick(c, tau, h, math.sqrt(h), 0.0),
                kick(c, tau, h, 0.0, math.sqrt(h / 12.0)),
            ):
                missing[:4, :4] -= np.multiply.outer(kept, kept)
            tau = end
        variance, left_out = (np.diagonal(transform(impact.read, v)) for v in (whole, missing))
        varies = variance > 0.0
        share = float(np.max(left_out[varies] / variance[varies], initial=0.0))
        worst = max(worst, 1.0 - math.sqrt(max(1.0 - share, 0.0)))
        whole = transform(impact.carry, whole)
        missing = transform(impact.carry, missing)
    return worst


def resolve_start(scene: Scene, dt: float, most: float = LEFT_OUT) -> float:
    """A step of ``exact-flight``, halved until `neglected_noise` is within `most`."""
    while neglected_noise(scene, dt) > most:
        dt *= 0.5
    return dt


def usual_step(scene: Scene, scheme: str, step_bias: bool = False) -> Limit:
    """As `default_step`, with the reason for which it is shorter than the scheme's, if it is."""
    kind = SCHEMES[scheme]
    largest, why = largest_step(scene, scheme)
    if kind.has_step_bias:
        return min(kind.step, largest / (COARSEST if step_bias else 1)), why
    longest = min(kind.step, largest)
    dt = resolve_start(scene, longest)
    return dt, why if dt == longest else "a longer step leaves out noise of the first flight"


@numpy_defaults
def default_step(scene: Scene, scheme: str, step_bias: bool = False) -> float:
    """The scheme's default step, or a shorter one where the scene requires it.

    The longest admissible step may be shorter, and ``exact-flight`` must not leave out noise where
    a short first flight begins or ends with none.

    Parameters
    ----------
    scene : Scene
        What is simulated.
    scheme : str
        Name in `SCHEMES`.
    step_bias : bool
        Whether 4 dt must be admissible too, for the step bias.

    Returns
    -------
    float

    Examples
    --------
    >>> from rattle.scene import DAT21, Scene
    >>> default_step(Scene.from_gears(DAT21), "euler-maruyama")
    0.002
    >>> round(default_step(Scene.from_gears(DAT21, sigma=1e4), "euler-maruyama"), 6)
    0.000339
    """
    return usual_step(scene, scheme, step_bias)[0]


def check_step(scene: Scene, dt: float, scheme: str, coarsest: int = 1) -> float:
    """The step as a float, if it is admissible, and with it its multiple `coarsest`.

    `coarsest`: Largest multiple of dt that is run too; ignored for a scheme without step bias.
    """
    if not finite("dt", dt) > 0.0:
        raise InputError("dt", dt, "must be greater than 0")
    largest, reason = largest_step(scene, scheme)
    least = largest / MOST_PER_STEP
    if dt < least:
        why = (
            f"must be at least {least:.3g}: {MOST_PER_STEP:.0e} shorter steps, the default limit of"
            " a path, "
        )
        raise InputError("dt", dt, why + "do not add up to one longest admissible step")
    coarsest = 1 if not SCHEMES[scheme].has_step_bias else coarsest
    if dt * coarsest > largest:
        with_bias = f" ({coarsest} dt is run beside it for the step bias)" if coarsest > 1 else ""
        raise InputError("dt", dt, f"must be at most {largest / coarsest:.3g}{with_bias}: {reason}")
    return float(dt)


def is_admissible(scene: Scene, dt: float, scheme: str, coarsest: int = 1) -> bool:
    """Whether `check_step` takes a step."""
    try:
        check_step(scene, dt, scheme, coarsest)
    except InputError:
        return False
    return True
