"""What multilevel Monte Carlo over the step would cost for the section means, from runs at halved steps.

Every run at dt has 2 dt on the same noise beside it, so a run per level holds all that Giles' analysis asks for: mean
and variance of the difference between neighbouring levels, and its time.  Errors count in units of each quantity's sd,
as in `rattle.montecarlo.accuracy`.

References
----------
Giles, "Multilevel Monte Carlo path simulation", Operations Research 56 (2008); "Multilevel Monte Carlo methods", Acta
Numerica 24 (2015), section 3: the table of levels and its checks.
"""

import math
import time
from collections.abc import Sequence
from math import comb
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats
from tqdm import tqdm

from rattle.montecarlo import Ensemble, Record, simulate
from rattle.montecarlo.accuracy import units
from rattle.montecarlo.noise.philox import LEVELS as SIDE_BY_SIDE
from rattle.montecarlo.schemes.step_size import largest_step
from rattle.montecarlo.statistics.central_sums import CentralSums
from rattle.scene.scene import Scene

__all__ = ["KURTOSIS_ALARM", "Estimate", "Levels", "Rate", "fitted", "giles_cost", "levels_of", "measure_levels"]

Floats = NDArray[np.float64]

LEVELS, PATHS = 7, 16_384
COARSEST = 0.02  # step of level 0, if the scene lets it through
FITTED_FROM = 2  # coarser levels are too coarse for their rates to last
KURTOSIS_ALARM = 100.0
"""Kurtosis of a difference beyond which its variance is hardly known (Giles 2015, section 3.2)."""
MOST_LEVELS = 60  # what a step can be halved


class Rate(NamedTuple):
    """A power of two per level: ``2**(intercept + slope * level)``, and the half width of the slope's 95 % interval."""

    slope: float
    half: float
    intercept: float

    def at(self, level: Floats) -> Floats:
        """The fitted value at levels."""
        return np.asarray(2.0 ** (self.intercept + self.slope * level))


def fitted(level: Floats, value: Floats) -> Rate:
    """Straight line through the binary logarithms.

    Examples
    --------
    >>> rate = fitted(np.array([1.0, 2.0, 3.0]), np.array([0.5, 0.25, 0.125]))
    >>> round(rate.slope, 6), round(rate.intercept, 6), round(rate.half, 6)
    (-1.0, 0.0, 0.0)
    """
    line = stats.linregress(level, np.log2(value))
    half = float(line.stderr * stats.t.isf(0.025, level.size - 2)) if level.size > 2 else math.inf
    return Rate(float(line.slope), half, float(line.intercept))


class Estimate(NamedTuple):
    """The cheapest multilevel estimator of the means to an accuracy.

    ``first`` and ``last`` are its levels; ``seconds`` are for every row; ``typical`` for a row with the median of the
    variances and biases alone, what is kindest to the method.  ``measured``: whether its last level has been run.
    """

    first: int
    last: int
    seconds: float
    typical: float
    measured: bool


class Levels(NamedTuple):
    """Level differences of the section means in units of each quantity's sd.

    Attributes
    ----------
    table : DataFrame
        A row per level: ``scheme, level, dt``; worst and median over the rows of the ``mean`` of the difference (its
        absolute value) and of its ``variance``; largest ``kurtosis`` of a difference, and whether it gives an
        ``alarm``; ``consistency`` with the level before, which should be below 1; seconds of a path of the
        difference, and of the level ``alone``.
    single : ndarray, shape (levels, rows)
        Variance of each level alone.
    alpha, beta, gamma : Rate
        Decay of the worst mean and of the worst variance, growth of the time, per level.
    typical_alpha, typical_beta : Rate
        Decay of the medians; the first has the slope of the worst, for at fine levels a median is noise.
    """

    table: pd.DataFrame
    single: Floats
    alpha: Rate
    beta: Rate
    gamma: Rate
    typical_alpha: Rate
    typical_beta: Rate

    def estimate(self, accuracy: float) -> Estimate:
        """Cost of an optimal estimator whose standard error and bias are each within the accuracy."""
        t = self.table
        single = self.single.max(axis=1), np.median(self.single, axis=1)
        last, seconds, first = self._cheapest(self.alpha, self.beta, t["variance_worst"], single[0], accuracy)
        _, typical, _ = self._cheapest(
            self.typical_alpha, self.typical_beta, t["variance_median"], single[1], accuracy
        )  # fmt: skip
        return Estimate(first, last, seconds, typical, last < len(t))

    def _cheapest(
        self, weak: Rate, strong: Rate, variance: pd.Series, single: Floats, accuracy: float
    ) -> tuple[int, float, int]:
        """Last level, seconds and first level of the cheapest estimator for rows with such variances."""
        remaining = weak.at(np.arange(MOST_LEVELS, dtype=float)) / (2.0**-weak.slope - 1.0)
        last = max(1, int(np.argmax(remaining <= accuracy)))
        v = _continued(variance.to_numpy(), strong.slope, last)
        alone = _continued(self.table["alone_seconds"].to_numpy(), self.gamma.slope, last)
        pair = _continued(self.table["path_seconds"].to_numpy(), self.gamma.slope, last)
        whole = _continued(single, 0.0, last)
        costs = [
            giles_cost(np.append(whole[k], v[k + 1 :]), np.append(alone[k], pair[k + 1 :]), accuracy)
            for k in range(last + 1)
        ]
        first = int(np.argmin(costs))
        return last, costs[first], first


def _continued(values: Floats, slope: float, last: int) -> Floats:
    """Values of levels up to the last, those beyond what is known by their rate."""
    beyond = np.arange(1, last + 2 - values.size)
    return np.append(values, values[-1] * 2.0 ** (slope * beyond))[: last + 1]


def giles_cost(variance: Floats, seconds: Floats, accuracy: float) -> float:
    """Least total time with which independent levels bring the standard error of their sum to an accuracy.

    Level l gets paths in proportion to ``sqrt(V_l / C_l)``; the total is ``(sum sqrt(V_l C_l))^2 / accuracy^2``.

    Examples
    --------
    >>> giles_cost(np.array([1.0, 0.25]), np.array([1.0, 4.0]), 0.1)  # both levels cost alike
    400.0
    """
    return round(float((np.sqrt(variance * seconds).sum() / accuracy) ** 2), 12)


def measure_levels(
    scene: Scene, scheme: str, *, impacts: int, seed: int, workers: int, paths: int = PATHS, levels: int = LEVELS
) -> Levels:
    """Run every level with its own random numbers, and tabulate the differences."""
    simulate(scene, paths=1, impacts=1, scheme=scheme, dt=1e-3, record=Record(step_bias=True))  # compiles
    longest = 0.99 * largest_step(scene, scheme)[0] / 2 ** (SIDE_BY_SIDE - 1)
    seeds = np.random.SeedSequence([seed, levels]).spawn(levels)
    runs, seconds = [], []
    for level in tqdm(range(levels), desc=f"levels of {scheme}", unit="level", disable=None, leave=False):
        began = time.process_time()
        run = simulate(
            scene,
            paths=paths,
            impacts=impacts,
            scheme=scheme,
            dt=min(COARSEST, longest) / 2**level,
            rng=seeds[level],
            workers=workers,
            record=Record(step_bias=True),
        )
        runs.append(run)
        seconds.append((time.process_time() - began) / paths)
    return levels_of(runs, seconds)


def levels_of(runs: Sequence[Ensemble], seconds: Sequence[float]) -> Levels:
    """Tabulate the level differences of runs at halved steps, each with step bias and its own random numbers.

    Parameters
    ----------
    runs : sequence of Ensemble
        Level 0 (longest step) first.
    seconds : sequence of float
        Time of a path of each, with all three step sizes.
    """
    unit = units(runs[-1]).to_numpy()
    seen = [run.result.sums["fine_coarse"] for run in runs]
    single, rows = [], []
    for level, (run, sums) in enumerate(zip(runs, seen, strict=True)):
        m = sums.moment
        v = np.maximum(m(2, 0) - 2.0 * m(1, 1) + m(0, 2), 0.0)
        fourth = sum((-1) ** q * comb(4, q) * m(4 - q, q) for q in range(5))
        kurtosis = np.divide(fourth, v**2, out=np.zeros_like(v), where=v > 0.0)
        mean = np.abs(sums.mean[0] - sums.mean[1]) / unit
        noise = np.sqrt(v / sums.n) / unit
        worst = np.unravel_index(int(mean.argmax()), mean.shape)
        rows.append({
            "scheme": run.scheme, "level": level, "dt": run.dt, "mean_worst": float(mean[worst]),
            "se_mean_worst": float(noise[worst]), "mean_median": float(np.median(mean)),
            "variance_worst": float((v / unit**2).max()), "variance_median": float(np.median(v / unit**2)),
            "kurtosis": float(kurtosis.max()), "alarm": bool(kurtosis.max() > KURTOSIS_ALARM),
            "consistency": _consistency(seen[level - 1], sums) if level else math.nan,
            # of the steps dt + dt/2 + dt/4 of such a run, a difference takes the first two, a level alone the first
            "path_seconds": seconds[level] * 6.0 / 7.0, "alone_seconds": seconds[level] * 4.0 / 7.0,
        })  # fmt: skip
        single.append((m(2, 0) / unit**2).ravel())
    table = pd.DataFrame(rows)
    of = table[table["level"] >= FITTED_FROM]
    clear = of[of["mean_worst"] > 3.0 * of["se_mean_worst"]]
    alpha, beta, gamma, typical_beta = (
        fitted(part["level"].to_numpy(float), part[name].to_numpy())
        for part, name in (
            (clear, "mean_worst"), (of, "variance_worst"), (of, "path_seconds"), (of, "variance_median"),
        )
    )  # fmt: skip
    noise = np.sqrt(of["variance_median"] / runs[-1].paths)
    clear = of[(of["mean_median"] > 3.0 * noise) | (of["level"] == FITTED_FROM)]
    intercept = float((np.log2(clear["mean_median"]) - alpha.slope * clear["level"]).mean())
    return Levels(table, np.array(single), alpha, beta, gamma, alpha._replace(intercept=intercept), typical_beta)


def _consistency(a: CentralSums, b: CentralSums) -> float:
    """``|a - b + c| / 3 (sqrt Va + sqrt Vb + sqrt Vc)`` over the rows, the largest.

    Of the means ``a`` of the coarser run, ``b`` of the finer one and ``c`` of their difference: telescoping holds if
    both runs mean the same by the coarser level.
    """
    off = np.abs(a.mean[0] - b.mean[1])  # for c is b less the coarser half of the finer run
    difference = np.maximum(b.moment(2, 0) - 2.0 * b.moment(1, 1) + b.moment(0, 2), 0.0)
    spread = sum(np.sqrt(v / n) for v, n in ((a.moment(2, 0), a.n), (b.moment(2, 0), b.n), (difference, b.n)))
    return float(np.divide(off, 3.0 * spread, out=np.zeros_like(off), where=spread > 0.0).max())
