"""The steps of the saltation closure: derivatives of the section map and noise of the flights, white or with a memory.

White noise has the section state ``(tau, x1, y1, x2, y2)`` and the deviations of the flanks where they vary
(`rattle.closure.section_map`).  Noise with a memory has its value eta as a last component: it is known no better at an
impact than the state is, and the flight carries it on.
"""

import math
from typing import NamedTuple

import numpy as np

from rattle.closure.section_map import column, derivatives_along, start_covariance
from rattle.scene import memory
from rattle.scene.constants import Constants
from rattle.scene.flight import field, field_rate, noise_covariance, noise_rate
from rattle.scene.linear_algebra import image, product
from rattle.scene.scene import Scene
from rattle.scene.types import Floats, Ints


class Steps(NamedTuple):
    """Steps from section to section; d components of the state, m of the noise."""

    first: Floats  # derivatives of the next state by state and noise; (steps, d, d + m)
    hessian: Floats  # second derivatives of the components `bent`; (steps, components, d + m, d + m)
    bent: Ints  # components that are not linear
    noise: Floats  # covariances of the noise; (steps, m, m)
    kick: Floats  # effect of white noise on the state at the impact, per root of time; (steps, d)


def section_start(scene: Scene) -> Floats:
    """Covariance of the section state after the start.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> section_start(Scene.from_gears(DAT21, sigma=0.1, correlation_time=0.25)).diagonal().tolist()
    [0.0, 0.0, 0.0, 0.0, 0.0, 2.0]
    """
    plain = start_covariance(scene)
    if not scene.correlation_time:
        return plain
    out = np.zeros((len(plain) + 1, len(plain) + 1))
    out[:-1, :-1], out[-1, -1] = plain, 0.5 / scene.correlation_time
    return out


def section_steps(c: Constants, tau: Floats, mesh: Ints, side: Ints, before: Floats, after: Floats, d: int) -> Steps:
    """The steps between successive impacts; d is the size of the section state."""
    flights = list(zip(tau[:-1], np.diff(tau), strict=True))
    if c.memory:
        steps = [_with_memory(c, tau, mesh, side, before, after, k, d) for k in range(len(flights))]
        first, hessian, noise = (np.array(part) for part in zip(*steps, strict=True))
        kick = np.zeros((len(flights), d))
        kick[:, d - 1] = 1.0 / c.memory
        return Steps(first, hessian, np.array([0, 1, 2, 3, 4, d - 1]), noise, kick)
    first, hessian = derivatives_along(c, tau, mesh, side, before, after, d)
    noise = np.array([noise_covariance(c, s, t) for s, t in flights])
    kick = np.zeros((len(flights), d))
    rate = np.array([noise_rate(c, s + t) for s, t in flights])
    kick[:, 2 : 1 + 2 * c.stages : 2] = c.sigma * rate[:, : c.stages]
    return Steps(first, hessian, np.arange(5), noise, kick)


def noise_slope(c: Constants, tau: float, t: float) -> Floats:
    """Derivative of the covariance of a flight's noise with respect to the time of its start, shape (m, m).

    That of white noise is ``A + B cos 2 tau + C sin 2 tau``, so a difference over a quarter of a period gives it
    exactly.  For several orders it is bilinear in the modulation m and its derivative: half the difference of the
    covariances for ``m + m'`` and ``m - m'``.
    """
    if c.memory:
        return memory.covariance(c, tau, t)[1]
    if c.drive:
        d = c.drive
        more, less = (
            c._replace(drive=d._replace(odd=d.odd - sign * d.order * d.even, even=d.even + sign * d.order * d.odd))
            for sign in (1.0, -1.0)
        )
        return 0.5 * (noise_covariance(more, tau, t) - noise_covariance(less, tau, t))
    eighth = 0.25 * math.pi
    return noise_covariance(c, tau + eighth, t) - noise_covariance(c, tau - eighth, t)


def _with_memory(
    c: Constants, taus: Floats, meshes: Ints, sides: Ints, befores: Floats, afters: Floats, k: int, d: int
) -> tuple[Floats, Floats, Floats]:
    """First and second derivatives with eta, which is 0 on the orbit, as a fifth state; and the noise's covariance."""
    tau, t, after, before = taus[k], taus[k + 1] - taus[k], afters[k], befores[k + 1]
    mesh, side = meshes[k + 1], sides[k + 1]
    i, y, size = 2 * (mesh - 1), before[2 * mesh - 1], d + 5
    whole, turned = memory.propagator(c, tau, t)
    a = memory.matrix(c, tau + t)

    def still(values: Floats) -> Floats:
        return np.append(values, 0.0)

    rate, explicit = still(field(c, tau + t, before[1], before[3])), still(field_rate(c, tau + t))
    moving = rate - image(whole, still(field(c, tau, after[1], after[3])))  # by the time of the start
    flown = np.zeros((5, size))
    flown[:, 0], flown[:, 1:5], flown[:, d - 1], flown[:, d:] = moving, whole[:, :4], whole[:, 4], np.eye(5)
    late = -flown[i] / y  # of the remaining time to the wall
    if d > 6:
        late[column(mesh, side)] += side / y
    reached = flown + rate[:, None] * late
    first = np.zeros((d, size))
    first[0], first[1:5], first[d - 1] = late, reached[:4], reached[4]
    first[0, 0] += 1.0
    first[1 + i] = 0.0  # the struck displacement is on its wall
    for k in range(5, d - 1):
        first[k, k] = 1.0
    if d > 6:
        first[1 + i, column(mesh, side)] = side
    drift = product(a, flown)
    drift[:, 0] += explicit
    bend = image(a, rate) + explicit
    cross = drift[:, :, None] * late
    second = cross + cross.transpose(0, 2, 1) + bend[:, None, None] * (late[:, None] * late)
    second[:, 0, 0] += explicit + image(a, moving) - image(whole, still(field_rate(c, tau)))
    second[:, 0, d - 1] += turned[:, 4]
    second[:, d - 1, 0] += turned[:, 4]
    hessian = np.empty((6, size, size))
    hessian[0] = -second[i] / y
    hessian[1:] = second + rate[:, None, None] * hessian[0]
    hessian[1 + i] = 0.0
    return first, hessian, memory.covariance(c, tau, t)[0]
