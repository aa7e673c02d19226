"""Errors of samples that depend on each other: paths that come in groups, and draws of chains."""

import math
from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.compare.judge.samples import PathSamples
from rattle.compare.judge.sums import SampleSums, standardised
from rattle.montecarlo.statistics.section_statistics import pair_statistics
from rattle.scene import Floats, InputError


class MomentErrors(NamedTuple):
    """What the error of one moment is, in each cell."""

    se: Floats
    lean: Floats  # skewness of the sampling distribution
    effective: Floats  # paths, or groups, that the error rests on


def errors_of_groups(
    samples: PathSamples,
    single: SampleSums,
    joint: Sequence[SampleSums],
    pairs: Sequence[tuple[int, int]],
    groups: NDArray[Any],
) -> dict[str, MomentErrors]:
    """Errors of each moment from the sums of the groups alone: paths of one group may depend on
    each other."""
    code, names = pd.factorize(groups)
    if len(names) < 2:
        raise InputError("groups", names.tolist(), "paths of one group alone tell no error")
    order = np.argsort(code, kind="stable")
    starts = np.searchsorted(code[order], np.arange(len(names)))
    spreads: dict[str, list[tuple[float, float]]] = {}
    for moment, influence, n in _all_influences(samples.array, single, joint, pairs):
        spreads.setdefault(moment, []).append(_spread_of_groups(influence[order], starts, n))
    errors = {}
    for moment, cells in spreads.items():
        se, lean = np.array(cells).T
        errors[moment] = MomentErrors(se, lean, np.full(len(cells), float(len(names))))
    return errors


def _all_influences(
    array: Floats,
    single: SampleSums,
    joint: Sequence[SampleSums],
    pairs: Sequence[tuple[int, int]],
) -> Iterator[tuple[str, Floats, float]]:
    """What each path contributes to each moment of each cell, 0 where it has no value, and how many
    paths have one; cell by cell.

    Shapes: `array` (paths, rows, quantities).
    """
    z = standardised(single)
    sd = np.sqrt(single.moment(2, 0))
    for cell, n in enumerate(single.n):
        row, quantity = divmod(cell, array.shape[2])
        values = array[:, row, quantity].astype(float)
        unit = sd[cell] if sd[cell] > 0.0 else 1.0
        u = np.nan_to_num((values - single.mean[0, cell]) / unit)
        for moment, influence in _influences(u, unit, z[3][cell], z[4][cell]).items():
            yield moment, np.where(np.isnan(values), 0.0, influence), n
    for (i, j), sums in zip(pairs, joint, strict=True):
        rho = pair_statistics(sums)["rho"]
        sd_u = np.sqrt(sums.moment(2, 0))
        sd_v = np.sqrt(sums.moment(0, 2))
        for row, n in enumerate(sums.n):
            u = (array[:, row, i] - sums.mean[0, row]) / sd_u[row]
            v = (array[:, row, j] - sums.mean[1, row]) / sd_v[row]
            influence = np.nan_to_num(u * v - 0.5 * rho[row] * (u**2 + v**2))
            yield f"rho{i, j}", influence, n


def _influences(u: Floats, unit: float, skew: float, kurt: float) -> dict[str, Floats]:
    """What each path contributes to a moment; `u` are standardised values."""
    square = u**2 - 1.0
    return {
        "mean": unit * u,
        "sd": 0.5 * unit * square,
        "skew": u**3 - skew - 3.0 * u - 1.5 * skew * square,
        "kurt": u**4 - kurt - 4.0 * skew * u - 2.0 * kurt * square,
    }


def _spread_of_groups(influence: Floats, starts: NDArray[Any], n: float) -> tuple[float, float]:
    """Standard error of a mean of influences, and its skewness, from the sums of the groups."""
    total = np.add.reduceat(influence, starts)
    groups = len(total)
    square = float((total**2).mean())
    if square == 0.0:
        return 0.0, 0.0
    se = math.sqrt(groups / (groups - 1.0) * groups * square) / n
    return se, float((total**3).mean()) / square**1.5 / math.sqrt(groups)


CHAIN_AXES: dict[str, Any] = {"chain_axis": 0, "draw_axis": 1}


def errors_of_draws(samples: PathSamples) -> dict[str, MomentErrors]:
    """Standard errors of autocorrelated draws of chains, by ArviZ."""
    try:
        stats: Any = import_module("arviz_stats.base").array_stats
    except ImportError:
        why = "draws of chains depend on each other; install arviz-stats, which knows their errors"
        raise InputError("samples", "chains", why) from None
    array = samples.array.astype(float)
    cells = np.moveaxis(array.reshape(-1, samples.draws, array[0].size), -1, 0)
    errors = {}
    for moment in ("mean", "sd"):
        se = np.array([stats.mcse(draws, method=moment, **CHAIN_AXES) for draws in cells])
        ess = np.array([stats.ess(draws, method=moment, **CHAIN_AXES) for draws in cells])
        errors[moment] = MomentErrors(se, 0.0 * se, ess)
    return errors
