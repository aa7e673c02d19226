"""Errors of samples that depend on each other: paths that come in groups, and draws of chains."""

import math
from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.compare.judge.samples import PathSamples
from rattle.compare.judge.sums import SampleSums, standardised
from rattle.montecarlo.statistics.section_statistics import pair_statistics
from rattle.scene import Floats, InputError


def errors_of_groups(
    samples: PathSamples,
    single: SampleSums,
    joint: Sequence[SampleSums],
    pairs: Sequence[tuple[int, int]],
    groups: NDArray[Any],
) -> dict[str, tuple[Floats, Floats, Floats]]:
    """Standard error, sampling skewness and number of groups for each moment, from the sums of the
    groups alone: paths of one group may depend on each other."""
    array = samples.array
    code, names = pd.factorize(groups)
    if len(names) < 2:
        raise InputError("groups", names.tolist(), "paths of one group alone tell no error")
    order = np.argsort(code, kind="stable")
    starts = np.searchsorted(code[order], np.arange(len(names)))
    rows = array.shape[1]
    z = standardised(single)
    sd = np.sqrt(single.moment(2, 0))
    found: dict[str, list[tuple[Floats, Floats]]] = {
        moment: [] for moment in ("mean", "sd", "skew", "kurt")
    }
    for cell in range(len(single.n)):
        row, quantity = divmod(cell, array.shape[2])
        values = array[order, row, quantity].astype(float)
        unit = sd[cell] if sd[cell] > 0.0 else 1.0
        u = np.nan_to_num((values - single.mean[0, cell]) / unit)
        skew = z[3][cell]
        kurt = z[4][cell]
        influences = {
            "mean": unit * u,
            "sd": 0.5 * unit * (u**2 - 1.0),
            "skew": u**3 - skew - 3.0 * u - 1.5 * skew * (u**2 - 1.0),
            "kurt": u**4 - kurt - 4.0 * skew * u - 2.0 * kurt * (u**2 - 1.0),
        }
        for moment, influence in influences.items():
            put_in = np.where(np.isnan(values), 0.0, influence)
            found[moment].append(_spread_of_groups(put_in, starts, single.n[cell]))
    number = np.full(len(single.n), float(len(names)))
    errors = {
        moment: (np.array([se for se, _ in cells]), np.array([lean for _, lean in cells]), number)
        for moment, cells in found.items()
    }
    for pair, sums in zip(pairs, joint, strict=True):
        rho = pair_statistics(sums)["rho"]
        spreads = []
        for row in range(rows):
            u, v = (
                (array[order, row, i] - sums.mean[side, row]) / np.sqrt(sums.moment(*power)[row])
                for side, (i, power) in enumerate(zip(pair, ((2, 0), (0, 2)), strict=True))
            )
            put_in = np.nan_to_num(u * v - 0.5 * rho[row] * (u**2 + v**2))
            spreads.append(_spread_of_groups(put_in, starts, sums.n[row]))
        errors[f"rho{pair}"] = (
            np.array([se for se, _ in spreads]),
            np.array([lean for _, lean in spreads]),
            np.full(rows, float(len(names))),
        )
    return errors


def _spread_of_groups(influence: Floats, starts: NDArray[Any], n: float) -> tuple[Any, Any]:
    """Standard error of a mean of influences, and its skewness, from the sums of the groups."""
    total = np.add.reduceat(influence, starts)
    groups = len(total)
    square = float((total**2).mean())
    if square == 0.0:
        return 0.0, 0.0
    se = math.sqrt(groups / (groups - 1.0) * groups * square) / n
    return se, float((total**3).mean()) / square**1.5 / math.sqrt(groups)


CHAIN_AXES: dict[str, Any] = {"chain_axis": 0, "draw_axis": 1}


def errors_of_draws(
    samples: PathSamples, single: SampleSums
) -> dict[str, tuple[Floats, Floats, Floats]]:
    """Standard errors of autocorrelated draws of chains, by ArviZ."""
    try:
        stats: Any = import_module("arviz_stats.base").array_stats
    except ImportError:
        why = "draws of chains depend on each other; install arviz-stats, which knows their errors"
        raise InputError("samples", "chains", why) from None
    array = samples.array.astype(float)
    chains = len(array) // samples.draws
    cells = array.reshape(chains, samples.draws, -1)
    errors = {}
    for moment in ("mean", "sd"):
        draws = [cells[:, :, cell] for cell in range(cells.shape[2])]
        se = np.array([stats.mcse(x, method=moment, **CHAIN_AXES) for x in draws])
        ess = np.array([stats.ess(x, method=moment, **CHAIN_AXES) for x in draws])
        errors[moment] = (se, 0.0 * se, ess)
    return errors
