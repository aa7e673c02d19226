"""What noise makes of a mesh that is pressed shut, and down to which speed that is followed.

A wheel that is pressed against its wall with an acceleration a bounces there under white noise of
intensity s.  In units of its own speed ``s^2 / a`` and time ``s^2 / a^2`` that motion depends on
restitution alone.  What it loses is what the noise supplies, ``s^2 / 2`` for each unit of mass and
time.  Impacts faster than w have a rate below ``2 exp(-tail w)``, where the tail is that of the
likeliest way to such an impact (`tail_exponent`).
"""

import numpy as np

from rattle.montecarlo.schemes.step_state import Quiet
from rattle.scene import Scene
from rattle.scene.errors import non_negative

QUIET_SHARE = 0.125  # of the speed below which impacts are slow: followed down to that by default
# rate of impacts that are not slow up to which a mesh is held closed: at first, and later as a
# share of the rate of those that were followed
FIRST_LEFT_OUT = 1e-3
LEFT_OUT_SHARE = 2e-3
RELAXATIONS = 15.0
"""Times ``s^2 / a^2 / (1 - epsilon)``, in which a motion at the wall forgets its start, that a mesh
must stay closed at least to be held closed now."""


def tail_exponent(epsilon: float) -> float:
    """The exponent of the distribution of fast impacts, in units of ``a / s^2``.

    The likeliest noise that takes a wheel from its wall at speed v back to it at speed w, against
    the push, has the probability ``exp(-(2 sqrt(w^2 - w v + v^2) - w - v))``; v is epsilon times
    the speed of the impact before, which has the same tail.  1 up to a restitution of 0.5, and
    about ``3 (1 - epsilon)`` near 1.
    """
    before = np.linspace(0.0, 1.0, 4001)[:-1]
    leaves = epsilon * before
    exponent = 2.0 * np.sqrt(1.0 - leaves + leaves**2) - 1.0 - leaves
    return float((exponent / (1.0 - before)).min())


def quiet_of(scene: Scene, slow: float, resolve: float | None) -> Quiet:
    """Down to which speed a long run follows the motion at closed meshes: `resolve`, 0 for all of
    it, by default a share of `slow`."""
    speed = QUIET_SHARE * slow if resolve is None else non_negative("resolve", resolve)
    epsilon = float(scene.constants.wheels["epsilon"].max())
    if speed == 0.0 or epsilon == 1.0:
        return Quiet()
    relaxed = RELAXATIONS / (1.0 - epsilon)
    return Quiet(speed, slow, tail_exponent(epsilon), FIRST_LEFT_OUT, relaxed)
