"""Step bias of means and sds, from runs at dt, 2 dt and 4 dt on the same Brownian paths."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.statistics.central_sums import CentralSums

__all__ = ["StepBias", "extrapolated"]

Floats = NDArray[np.float64]


class StepBias(NamedTuple):
    """Step bias of a moment; each entry has shape (impacts, quantities).

    Attributes
    ----------
    bias, se_bias : ndarray
        First-order estimate of (value at dt) - (limit dt -> 0), the change from dt to 2 dt; its standard error.
    corrected, se_corrected : ndarray
        Richardson extrapolation, value - bias; its standard error.
    rest : ndarray
        Estimate of the error left: a third of the difference to the same extrapolation from 2 dt and 4 dt.
    """

    bias: Floats
    se_bias: Floats
    corrected: Floats
    se_corrected: Floats
    rest: Floats


def extrapolated(fine: CentralSums, coarse: CentralSums) -> dict[str, StepBias]:
    """Step bias of the means and of the sds.

    Parameters
    ----------
    fine, coarse : CentralSums
        Joint sums of the same quantities at dt and 2 dt, and at 2 dt and 4 dt.

    Returns
    -------
    dict of str to StepBias
        ``mean`` and ``sd``; NaN where no path had the impact.
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
        bias = values[1] - values[0]
        found[moment] = StepBias(
            bias,
            np.sqrt(np.maximum(ff - 2.0 * fc + cc, 0.0) / n),
            values[0] - bias,
            np.sqrt(np.maximum(4.0 * ff - 4.0 * fc + cc, 0.0) / n),
            np.abs(2.0 * values[0] - 3.0 * values[1] + values[2]) / 3.0,
        )
    return found


def _sd_influence(v: Mapping[tuple[int, int], Floats], a: Floats, b: Floats) -> list[Floats]:
    """Variances and covariance of the influence functions ``((u - E u)^2 - a^2) / 2a`` of two sds."""
    with np.errstate(invalid="ignore", divide="ignore"):
        parts = [
            (v[4, 0] - v[2, 0] ** 2) / (4.0 * a * a),
            (v[2, 2] - v[2, 0] * v[0, 2]) / (4.0 * a * b),
            (v[0, 4] - v[0, 2] ** 2) / (4.0 * b * b),
        ]
    return [np.where((a > 0.0) & (b > 0.0), p, 0.0) for p in parts]
