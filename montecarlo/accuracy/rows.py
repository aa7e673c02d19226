"""What an accuracy takes row by row: the bound of each section mean and sd by itself, and the dearest of them."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtri

from rattle.montecarlo.accuracy.cost import cost_of
from rattle.montecarlo.diagnostics.accuracy import (
    MOMENTS,
    absolute_errors,
    count_paths,
    units_by_quantity,
    unseen_shifts,
)
from rattle.montecarlo.diagnostics.reach import Row
from rattle.montecarlo.diagnostics.unseen import Unseen, unseen, unseen_text
from rattle.montecarlo.ensemble.result import Ensemble
from rattle.montecarlo.schemes.table import SCHEMES
from rattle.montecarlo.settings.plan import is_random
from rattle.scene.moments import SECTION
from rattle.scene.text import duration_text
from rattle.scene.types import Floats

MOST_OF = 0.5  # share of a bound from which on one cause is named for it
SHARE = 0.9  # of the rows that are stated apart from the dearest
MOST = 1e100  # square root of the largest number of paths
DEARER = 3.0  # times as many paths from which on the dearest row is named


def missed_rows(run: Ensemble, accuracy: float, share: float) -> tuple[Row, ...]:
    """The section means and sds whose own bound is above an accuracy, the worst first.

    `share`: Probability of a wrong statement on all rows together; each has an equal part of it (Bonferroni).
    """
    if not is_random(run.scene):
        return ()
    error, shift, hidden = _errors(run)
    bias = _biases(run)
    bound = shift + bias + _z(error, share) * error
    found = []
    for place in np.argwhere(bound > accuracy):
        moment, i, k = (int(n) for n in place)
        size = float(bound[moment, i, k])
        why = "too few paths"
        if shift[moment, i, k] > MOST_OF * size:
            chance, needed = float(hidden.probability[k, i]), float(hidden.needed[k, i])
            why = unseen_text(MOMENTS[moment], chance, float(shift[moment, i, k]), needed)
        elif bias[moment, i, k] > MOST_OF * size:
            why = "bias of the step"
        found.append(Row(MOMENTS[moment], SECTION[i], k + 1, size, why))
    return tuple(sorted(found, key=lambda row: -row.bound))


def dearest_row(run: Ensemble, accuracy: float, share: float) -> str:
    """Which row takes most of the paths of an accuracy, and what the others take; empty where all are alike."""
    if not is_random(run.scene):
        return ""
    error, shift, hidden = _errors(run)
    varies = error > 0.0
    if not varies.any():
        return ""
    with np.errstate(over="ignore"):
        paths = count_paths(run.columns) * np.minimum(_z(error, share) * error / accuracy, MOST) ** 2
    branch = np.broadcast_to(hidden.needed.T, error.shape)
    paths = np.where(shift > MOST_OF * accuracy, np.maximum(paths, branch), paths)
    moment, i, k = (int(n) for n in np.unravel_index(np.argmax(np.where(varies, paths, 0.0)), paths.shape))
    most = float(np.quantile(paths[varies], SHARE))
    if not paths[moment, i, k] > DEARER * most:
        return ""
    seconds = cost_of(run, max(math.ceil(most), 1)).core_seconds
    return (
        f"the dearest is the {MOMENTS[moment]} of {SECTION[i]} at impact {k + 1}; nine in ten of the others would take "
        f"{duration_text(seconds)}"
    )


def _errors(run: Ensemble) -> tuple[Floats, Floats, Unseen]:
    """Standard errors and shifts by unseen branches of all rows, in their units, shape (2, 6, impacts)."""
    unit = np.array(list(units_by_quantity(run).values()))
    hidden = unseen(run.scene, run.columns, count_paths(run.columns))
    return absolute_errors(run.columns) / unit, unseen_shifts(hidden) / unit, hidden


def _z(error: Floats, share: float) -> float:
    return float(-ndtri(0.5 * share / max(int((error > 0.0).sum()), 1)))


def _biases(run: Ensemble) -> Floats:
    """Bias of the step of all rows, in their units, shape (2, 6, impacts)."""
    unit = units_by_quantity(run)
    found = np.zeros((len(MOMENTS), len(SECTION), run.impacts))
    if SCHEMES[run.scheme].has_step_bias:
        for (moment, quantity), rows in run.step_bias.groupby(["moment", "quantity"]):
            at = MOMENTS.index(str(moment)), SECTION.index(str(quantity))
            found[at] = np.abs(np.nan_to_num(rows["bias"].to_numpy())) / unit[str(quantity)]
    return found
