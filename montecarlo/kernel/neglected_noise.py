"""The noise that steps of ``exact-flight`` leave out, at the first impacts of the noise-free orbit.

A step keeps two Legendre coefficients of its noise.  The third matters where the variance grows from zero and the
modulation crosses zero within a flight of about a step: of ``x`` after a flight of n steps from there it is a share
``1 / (6 n^4)`` of the variance.
"""

import math
from functools import lru_cache

import numpy as np

from rattle.montecarlo.kernel.control_variate import orbit_impacts
from rattle.montecarlo.schemes.short_flight import kick
from rattle.scene.flight import jacobian, noise_covariance
from rattle.scene.linear_algebra import transform
from rattle.scene.scene import Scene

IMPACTS, TIME = 4, 0.5  # impacts and time after the start that are looked at: later the variance is large
STEPS = 32  # of a flight from which on it has no effect: 1 / (6 * 32^4) of the variance


@lru_cache(maxsize=256)
def neglected_noise(scene: Scene, dt: float) -> float:
    """Largest share of an sd of the section that steps of ``exact-flight`` leave out.

    Examples
    --------
    >>> from rattle.scene import Scene, Start
    >>> start = Start(0.07, 0.5, 17.0, 0.0, 0.0, mesh=1)
    >>> scene = Scene(alpha=1.5, epsilon=0.9, beta1=0.08, gamma1=0.06, stages=1, sigma=0.1, start=start)
    >>> [f"{neglected_noise(scene, dt):.0e}" for dt in (0.05, 0.025, 0.0125)]
    ['5e-02', '3e-03', '2e-04']
    """
    if scene.sigma == 0.0 or scene.correlation_time:
        return 0.0
    c, tau, worst = scene.constants, scene.phase, 0.0
    whole, missing = np.zeros((5, 5)), np.zeros((5, 5))  # covariances
    for impact in orbit_impacts(scene, IMPACTS):
        if impact.tau - scene.phase > min(TIME, STEPS * dt):
            break
        while tau < impact.tau:
            end = min(impact.tau, scene.phase + (math.floor((tau - scene.phase) / dt + 1e-9) + 1) * dt)
            end = max(end, math.nextafter(tau, math.inf))
            h, carry, exact = end - tau, np.eye(5), np.zeros((5, 5))
            carry[:4, :4], exact[:4, :4] = jacobian(c, h), noise_covariance(c, tau, h)
            whole, missing = transform(carry, whole) + exact, transform(carry, missing) + exact
            for kept in (kick(c, tau, h, math.sqrt(h), 0.0), kick(c, tau, h, 0.0, math.sqrt(h / 12.0))):
                missing[:4, :4] -= np.multiply.outer(kept, kept)
            tau = end
        variance, left_out = (np.diagonal(transform(impact.read, v)) for v in (whole, missing))
        varies = variance > 0.0
        share = float(np.max(left_out[varies] / variance[varies], initial=0.0))
        worst = max(worst, 1.0 - math.sqrt(max(1.0 - share, 0.0)))
        whole, missing = transform(impact.carry, whole), transform(impact.carry, missing)
    return worst
