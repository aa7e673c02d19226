"""Differences between two ensembles on common random numbers."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.compare.study.cells import BATCH, Sampled
from rattle.scene.moments import SECTION, STATE

Floats = NDArray[np.float64]


def compare_paired(one: Sampled, other: Sampled) -> pd.DataFrame:
    """Differences of section means and sds between two runs on common random numbers, with their standard errors.

    The standard error is that of the mean of the batches' differences.  For means, the differences are first regressed
    on the batches of the control variate, whose expectation is zero.

    Returns: Columns ``impact, quantity, moment, difference`` (`other` less `one`), ``se`` and ``se_independent``,
    the standard error that independent runs without a control variate would have.
    """
    rows = []
    for quantity in SECTION:
        if one.scene.stages == 1 and quantity in STATE[2:]:
            continue
        for moment, prefix in (("mean", ""), ("sd", "sd_")):
            name = BATCH.format(moment, quantity)
            first, second = (np.stack(list(run.batches[name])) for run in (one, other))
            batches = min(first.shape[1], second.shape[1])
            first, second = first[:, :batches], second[:, :batches]
            control = np.stack(list(other.batches[BATCH.format("control", quantity)]))[:, :batches]
            freedom = batches - 1 - (moment == "mean")
            se = alone = np.full(len(first), np.nan)
            if freedom > 0:  # a standard error needs at least one degree of freedom
                left = _residual(second - first, control) if moment == "mean" else _subtract_means(second - first)
                se = np.sqrt((left**2).sum(axis=1) / freedom / batches)
            if batches > 1:
                alone = np.sqrt((first.var(axis=1, ddof=1) + second.var(axis=1, ddof=1)) / batches)
            difference = other.section[prefix + quantity] - one.section[prefix + quantity]
            rows.append(
                pd.DataFrame(
                    {
                        "impact": one.section.index,
                        "quantity": quantity,
                        "moment": moment,
                        "difference": difference.to_numpy(),
                        "se": se,
                        "se_independent": alone,
                    }
                )
            )
    return pd.concat(rows, ignore_index=True)


def _subtract_means(values: Floats) -> Floats:
    return np.asarray(values - values.mean(axis=1, keepdims=True))


def _residual(values: Floats, control: Floats) -> Floats:
    """Residuals of the regression of each row on its control variate."""
    values, control = _subtract_means(values), _subtract_means(control)
    product, square = ((v * control).sum(axis=1, keepdims=True) for v in (values, control))
    return np.asarray(values - np.divide(product, square, out=np.zeros_like(square), where=square > 0.0) * control)
