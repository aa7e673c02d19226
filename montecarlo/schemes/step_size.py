"""The schemes, the longest admissible step of each, beyond which it is unstable or misses impacts,
and its default.

`rattle check stability` measures both sides of these limits (reports/stability).
"""

import math
from functools import lru_cache

import numpy as np

from rattle.montecarlo.noise.philox import LEVELS
from rattle.montecarlo.schemes.control_variate import orbit_impacts
from rattle.montecarlo.schemes.euler import EULER
from rattle.montecarlo.schemes.euler_located import LOCATED
from rattle.montecarlo.schemes.exact_flight import EXACT
from rattle.montecarlo.schemes.short_flight import pushed_by
from rattle.montecarlo.schemes.time_scales import Limit
from rattle.scene import InputError, Scene, positive
from rattle.scene.flight import COMMON, jacobian, noise_covariance
from rattle.scene.linear_algebra import transform
from rattle.scene.numpy_errors import numpy_defaults

SCHEMES = {
    "euler-maruyama": EULER,
    "euler-maruyama-located": LOCATED,
    "exact-flight": EXACT,
}
"""All schemes by name, in the order of increasing accuracy."""

MOST_LEFT_OUT_NOISE = 2e-4
"""Largest share of an sd that the noise left out by a default step may have."""

MOST_PER_STEP = 10**7
"""Longest admissible step over the shortest."""

COARSEST = 2 ** (LEVELS - 1)
"""Coarsest step over the finest: dt, 2 dt and 4 dt share one Brownian path (Richardson
extrapolation)."""


# impacts and time after the start at which noise is looked for that a step leaves out
LOOKED_AT_IMPACTS = 4
TIME = 0.5
# of a flight from which on it has no effect: 1 / (6 * 32^4) of the variance
STEPS_WITHOUT_EFFECT = 32


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
    return SCHEMES[scheme].longest_step(scene)


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
    # covariance, and what steps leave out of it
    size = 2 * c.wheels.size
    parts = np.zeros((2, size + 1, size + 1))
    for impact in orbit_impacts(scene, LOOKED_AT_IMPACTS):
        if impact.tau - scene.phase > min(TIME, STEPS_WITHOUT_EFFECT * dt):
            break
        while tau < impact.tau:
            end = min(
                impact.tau, scene.phase + (math.floor((tau - scene.phase) / dt + 1e-9) + 1) * dt
            )
            end = max(end, math.nextafter(tau, math.inf))
            h = end - tau
            carry = np.eye(size + 1)
            exact = np.zeros((size + 1, size + 1))
            carry[:size, :size] = jacobian(c, h)
            exact[:size, :size] = noise_covariance(c, tau, h)
            parts = transform(carry, parts) + exact
            for source in range(COMMON, c.wheels.size):
                for kept in (
                    pushed_by(c, tau, h, math.sqrt(h), 0.0, source),
                    pushed_by(c, tau, h, 0.0, math.sqrt(h / 12.0), source),
                ):
                    parts[1, :size, :size] -= np.multiply.outer(kept, kept)
            tau = end
        variance, left_out = np.diagonal(transform(impact.read, parts), axis1=1, axis2=2)
        varies = variance > 0.0
        share = float(np.max(left_out[varies] / variance[varies], initial=0.0))
        worst = max(worst, 1.0 - math.sqrt(max(1.0 - share, 0.0)))
        parts = transform(impact.carry, parts)
    return worst


def resolve_start(scene: Scene, dt: float, most: float = MOST_LEFT_OUT_NOISE) -> float:
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
    positive("dt", dt)
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


def is_admissible(scene: Scene, dt: float, scheme: str) -> bool:
    """Whether `check_step` takes a step and its multiple `COARSEST`."""
    try:
        check_step(scene, dt, scheme, COARSEST)
    except InputError:
        return False
    return True
