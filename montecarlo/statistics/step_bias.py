"""Step bias of means and sds, from runs at dt, 2 dt and 4 dt on the same Brownian paths."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.statistics.central_sums import CentralSums

Floats = NDArray[np.float64]

BEYOND = 3.0  # standard errors by which changes must fall more slowly than first order, to be taken for slow
SLOW = 2.0**0.9  # ratio of two changes below which they are; above it is first order with a remainder of second order
SLOWEST = 2.0**0.5
"""Ratio that is assumed of changes that fall more slowly still, or turn their sign.  The half order of impacts that a
discrete path misses is the slowest that is known; beside first order it leaves as much at any ratio."""


class StepBias(NamedTuple):
    """Step bias of a moment; each entry has shape (impacts, quantities)."""

    # bias, se_bias: first-order estimate of (value at dt) - (limit dt -> 0), the change from dt to 2 dt; its standard
    # error
    bias: Floats
    se_bias: Floats
    corrected: Floats  # corrected, se_corrected: richardson extrapolation, value - bias; its standard error
    se_corrected: Floats
    # estimate of the error left: the difference to the same extrapolation from 2 dt and 4 dt, over ``2^p - 1``.  The
    # error left is of second order (p = 2), as means settle at first order; where the changes of an sd fall more
    # slowly, beyond noise, p is the slope that they have, 1/2 at least (`rattle order`: docs/theory/schemes.md)
    rest: Floats


def extrapolate(fine: CentralSums, coarse: CentralSums) -> dict[str, StepBias]:
    """Step bias of the means and of the sds.

    `fine`, `coarse`: Joint sums of the same quantities at dt and 2 dt, and at 2 dt and 4 dt.
    """
    n = np.where(fine.n > 0, fine.n, np.nan)
    v = {(p, q): fine.moment(p, q) for p, q in ((2, 0), (1, 1), (0, 2), (4, 0), (2, 2), (0, 4))}
    sd = np.sqrt(np.stack([v[2, 0], v[0, 2], coarse.moment(0, 2)]))
    means = np.stack([fine.mean[0], fine.mean[1], coarse.mean[1]])
    # (co)variances of the influence functions at dt and 2 dt: var(dt), cov, var(2 dt), of the means and of the sds
    spread = ([v[2, 0], v[1, 1], v[0, 2]], _sd_influence(v, sd[0], sd[1]))
    found = {}
    for moment, values, (ff, fc, cc) in (("mean", means, spread[0]), ("sd", sd, spread[1])):
        values = np.where(fine.n > 0, values, np.nan)
        bias, se = values[1] - values[0], np.sqrt(np.maximum(ff - 2.0 * fc + cc, 0.0) / n)
        before = values[2] - values[1]
        found[moment] = StepBias(
            bias,
            se,
            values[0] - bias,
            np.sqrt(np.maximum(4.0 * ff - 4.0 * fc + cc, 0.0) / n),
            estimate_remainder(bias, before, se) if moment == "sd" else np.abs(2.0 * bias - before) / 3.0,
        )
    return found


def estimate_remainder(change: Floats, before: Floats, se: Floats) -> Floats:
    """Estimate the error that first-order extrapolation leaves.

    `change`, `before`: Change of a value from dt to 2 dt, and from 2 dt to 4 dt. `se`: Standard error of
    `change`; that of ``2 change - before`` is taken to be three times as large, as the earlier change has about
    twice the error.

    Examples
    --------
    >>> second_order = estimate_remainder(np.array([3.0]), np.array([12.0]), np.zeros(1))  # of 1, 4 and 16: 1 - 3 = -2
    >>> second_order.tolist()
    [2.0]
    """
    missing = 2.0 * change - before
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = before / change
        slow = (np.abs(missing) > 3.0 * BEYOND * se) & (ratio < SLOW)
    return np.abs(missing) / (np.where(slow, np.maximum(ratio, SLOWEST), 4.0) - 1.0)


def _sd_influence(v: Mapping[tuple[int, int], Floats], a: Floats, b: Floats) -> list[Floats]:
    """Variances and covariance of the influence functions ``((u - E u)^2 - a^2) / 2a`` of two sds."""
    with np.errstate(invalid="ignore", divide="ignore"):
        parts = [
            (v[4, 0] - v[2, 0] ** 2) / (4.0 * a * a),
            (v[2, 2] - v[2, 0] * v[0, 2]) / (4.0 * a * b),
            (v[0, 4] - v[0, 2] ** 2) / (4.0 * b * b),
        ]
    return [np.where((a > 0.0) & (b > 0.0), p, 0.0) for p in parts]
