"""The third cumulants that the section map produces (`rattle.closure.section_map`).

Besides the second derivatives of the map, two effects enter them at the same order.  First, the covariance Q of the
noise depends on the path's own tau_k.  Second, the noise between the orbit's flight time and the path's own (a time
delta, of either sign) is missing from n.  By the Fokker-Planck equation it changes the density f on the section by
``delta sigma^2 (m . grad)^2 f / 2``, m the modulation of the noise.  That adds ``sigma^2 m_i m_j cov(delta, s_l)`` and
its permutations to the third cumulants, and nothing to the mean or the covariance.
"""

import math

import numpy as np
from numpy.typing import NDArray

from rattle.scene.constants import Constants
from rattle.scene.flight import noise_covariance, noise_rate
from rattle.scene.products import image, product, total, transform

Floats = NDArray[np.float64]


def noise_slope(c: Constants, tau: float, t: float) -> Floats:
    """Derivative of the covariance of a flight's noise with respect to the time of its start, shape (4, 4).

    That covariance is ``A + B cos 2 tau + C sin 2 tau``, so a difference over a quarter of a period gives it exactly.
    """
    eighth = 0.25 * math.pi
    return noise_covariance(c, tau + eighth, t) - noise_covariance(c, tau - eighth, t)


def third_cumulants(
    c: Constants, tau: float, first: Floats, hessian: Floats, p: Floats, q: Floats, slope: Floats, third: Floats
) -> Floats:
    """Third cumulants of the next section state.

    Shapes: `first`, `hessian` (d, d + 4) and (5, d + 4, d + 4); `p`, `q` (d, d) and (4, 4); `slope` (4, 4);
    `third` (d, d, d); result (d, d, d).
    """
    d = p.shape[0]
    spread = np.zeros((d + 4, d + 4))  # covariance of (s, n)
    spread[:d, :d], spread[d:, d:] = p, q
    reach = product(first, spread)  # cov(s', (s, n))
    varied, since = transform(first[:, d:], slope), reach[:, 0]  # d cov(s' | s) / d tau_k
    late = product(reach[:1], first.T)[0] - since  # cov(delta, s'), delta = tau' - tau - t
    m1, m2 = noise_rate(c, tau)
    kick = np.zeros(d)
    kick[2] = c.sigma * m1
    if c.stages == 2:
        kick[4] = c.sigma * m2
    kicks = kick[:, None] * kick
    bent = np.zeros((d, d, d))  # bent[l, i, j]: contribution of the quadratic part of component l
    bent[:5] = transform(reach, hessian)
    out = bent.transpose(1, 2, 0) + bent.transpose(1, 0, 2) + bent
    out = out + _over_pairs(varied, since)
    out = out + _over_pairs(kicks, late)
    linear = first[:, :d]
    mapped = linear.T[:, :, None, None] * transform(linear, third)[:, None]
    return np.asarray(np.add.accumulate(np.concatenate([out[None], mapped]))[-1])


def _over_pairs(pair: Floats, other: Floats) -> Floats:
    """``A_ij b_k + A_ik b_j + A_jk b_i``."""
    return np.asarray(pair[:, :, None] * other + pair[:, None, :] * other[:, None] + pair[None] * other[:, None, None])


def flight_third_cumulant(first: Floats, hessian: Floats, p: Floats, q: Floats, slope: Floats, third: Floats) -> float:
    """Third cumulant of the flight time, the difference of the next tau and the last one.

    Only the next tau is nonlinear.  The noise beyond the orbit's flight time does not enter, because it acts on
    velocities.

    Shapes: `first`, `hessian` (d, d + 4) and (5, d + 4, d + 4); `p`, `q` (d, d) and (4, 4); `slope` (4, 4);
    `third` (d, d, d).
    """
    d = p.shape[0]
    own = first[0].copy()  # derivative of the flight time with respect to (s, n)
    own[0] -= 1.0
    past, noise = own[:d], own[d:]
    reach = np.concatenate([image(p, past), image(q, noise)])  # its covariance with (s, n)
    varied = total(noise * image(slope, noise))  # d var(flight | s) / d tau_k
    found = 3.0 * total(reach * image(hessian[0], reach)) + 3.0 * varied * reach[0]
    return float(total(np.concatenate([[found], past * image(image(third, past), past)])))


def after_impact(hit: Floats, third: Floats) -> Floats:
    """Third cumulants after an impact with the restitution map `hit`; shapes (d, d) and (d, d, d)."""
    return product(hit, transform(hit, third).reshape(len(hit), -1)).reshape(third.shape)
