"""The steps of the saltation closure: derivatives of the section map and noise of the flights, white or with a memory.

White noise has the section state ``(tau, x1, y1, x2, y2)`` and the deviations of the flanks where they vary
(`rattle.closure.section_map`).  Noise with a memory has its value eta as a last component: it is known no better at an
impact than the state is, and the flight carries it on.
"""

import math
from typing import NamedTuple

import numpy as np

from rattle.closure.orbit import Impacts
from rattle.closure.section_map import column, start_covariance
from rattle.scene import memory
from rattle.scene.constants import Constants
from rattle.scene.flight import field, field_rate, jacobian, noise_covariance, noise_rate, system_matrix
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


def section_steps(c: Constants, at: Impacts, d: int) -> Steps:
    """The steps between successive impacts; d is the size of the section state."""
    first, hessian, bent = section_derivatives(c, at, d)
    flights, kick = list(zip(at.tau[:-1], np.diff(at.tau), strict=True)), np.zeros((len(at.tau) - 1, d))
    if c.memory:
        noise = np.array([memory.covariance(c, s, t)[0] for s, t in flights])
        kick[:, d - 1] = 1.0 / c.memory
    else:
        noise = np.array([noise_covariance(c, s, t) for s, t in flights])
        rate = np.array([noise_rate(c, s + t) for s, t in flights])
        kick[:, 2 : 1 + 2 * c.stages : 2] = c.sigma * rate[:, : c.stages]
    return Steps(first, hessian, bent, noise, kick)


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


def section_derivatives(c: Constants, at: Impacts, d: int) -> tuple[Floats, Floats, Ints]:
    """`rattle.closure.section_map.derivatives` of each flight between impacts, in numpy: for white noise the same bits.

    With noise that has a memory eta, which is 0 on the orbit, is a fifth component of the state.

    Returns: First and second derivatives by ``(s, n)``, of k state components, and the components that the second are
    of.  Shapes: (n, d, d + k); (n, 1 + k, d + k, d + k); (1 + k,).
    """
    t, k, every = np.diff(at.tau), 5 if c.memory else 4, np.arange(len(at.tau) - 1)
    begin, end, side, size = at.tau[:-1], at.tau[:-1] + t, at.side[1:], d + k
    state, flanks = [1, 2, 3, 4, d - 1][:k], range(5, d + 4 - k)  # their places in the section state
    struck = np.where(at.mesh[1:] == 1, 0, 2)  # place of its displacement in the state
    y, flank = at.before[1:][every, struck + 1, None], column(at.mesh[1:], side)

    def drift(times: Floats, states: Floats) -> Floats:
        return _with_eta([field(c, s, y1, y2) for s, y1, y2 in zip(times, states[:, 1], states[:, 3], strict=True)], k)

    rate, begun = drift(end, at.before[1:]), drift(begin, at.after[:-1])
    explicit, initial = (_with_eta([field_rate(c, s) for s in times], k) for times in (end, begin))
    if c.memory:
        carried = [memory.propagator(c, s, duration) for s, duration in zip(begin, t, strict=True)]
        j, turned = (np.array(part) for part in zip(*carried, strict=True))
        a = np.array([memory.matrix(c, s) for s in end])
    else:
        j, a = np.array([jacobian(c, s) for s in t]), system_matrix(c)
    moving = rate - image(j, begun)  # by the time of the start
    flown = np.zeros((len(t), k, size))
    flown[:, :, 0], flown[:, :, state], flown[:, range(k), range(d, size)] = moving, j, 1.0
    late = -flown[every, struck] / y  # of the remaining time to the wall
    first = np.zeros((len(t), d, size))
    first[:, flanks, flanks] = 1.0
    if flanks:
        late[every, flank] += side / y[:, 0]
    first[:, 0], first[:, state] = late, flown + rate[:, :, None] * late[:, None]
    first[:, 0, 0] += 1.0
    first[every, 1 + struck] = 0.0  # the struck displacement is on its wall
    if flanks:
        first[every, 1 + struck, flank] = side
    along = product(a, flown)
    along[:, :, 0] += explicit
    cross, bend = along[:, :, :, None] * late[:, None, None], image(a, rate) + explicit
    second = cross + cross.mT + bend[:, :, None, None] * (late[:, :, None] * late[:, None])[:, None]
    second[:, :, 0, 0] += explicit + image(a, moving) - image(j, initial)
    if c.memory:
        second[:, :, 0, d - 1] += turned[:, :, 4]
        second[:, :, d - 1, 0] += turned[:, :, 4]
    hessian = np.empty((len(t), 1 + k, size, size))
    hessian[:, 0] = -second[every, struck] / y[:, :, None]
    hessian[:, 1:] = second + rate[:, :, None, None] * hessian[:, :1]
    hessian[every, 1 + struck] = 0.0
    return first, hessian, np.array([0, *state])


def _with_eta(states: list[Floats], k: int) -> Floats:
    """Rates of the state, filled up to k components: eta has none on the orbit."""
    return np.pad(np.array(states), ((0, 0), (0, k - 4)))
