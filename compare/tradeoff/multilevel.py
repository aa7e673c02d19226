"""Cost of multilevel Monte Carlo over the step for the section means, estimated from runs at halved
steps.

Every run at dt also simulates 2 dt on the same Brownian paths, so one run per level gives all that
the analysis needs (Giles, Acta Numerica 24, 2015, section 3): mean and variance of the difference
between neighbouring levels, and its work, which is counted, not timed.  Beside it: what the control
variate and antithetic pairs are worth.
"""

import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from math import comb
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pandas as pd
from scipy import stats

from rattle.montecarlo import Ensemble, Record, Sampling, default_step, largest_step, simulate
from rattle.montecarlo.accuracy.cost import cost_of
from rattle.montecarlo.diagnostics.accuracy import smallest_sd, units
from rattle.montecarlo.kernel.block import Plan, sample
from rattle.montecarlo.noise.philox import LEVELS as SIDE_BY_SIDE
from rattle.montecarlo.settings import plan_of
from rattle.montecarlo.statistics.central_sums import CentralSums
from rattle.scene import SECTION, Floats, Scene
from rattle.scene.progress import ProgressBar

T = TypeVar("T")
MULTILEVELS = 7
LEVEL_PATHS = 16_384
COARSEST_STEP = 0.02  # step of level 0, if it is admissible for the scene
FITTED_FROM = 2  # first level used to fit the rates; the levels before are not yet asymptotic
KURTOSIS_ALARM = 100.0
"""Kurtosis of a level difference above which its estimated variance is unreliable (Giles 2015,
section 3.2)."""
MOST_LEVELS = 60  # levels up to which the rates are extrapolated


def time_run(call: Callable[[], T]) -> tuple[T, float]:
    """The result of a call, and its processor time."""
    began = time.process_time()
    run = call()
    return run, time.process_time() - began


class Rate(NamedTuple):
    """An exponential in the level: ``2**(intercept + slope * level)``."""

    slope: float
    half: float  # half width of the slope's 95 % interval
    intercept: float


def fit(level: Floats, value: Floats) -> Rate:
    """Fit an exponential by a straight line through the binary logarithms.

    Shapes: `level`, `value` (levels,).
    """
    line = stats.linregress(level, np.log2(value))
    half = float(line.stderr * stats.t.isf(0.025, level.size - 2)) if level.size > 2 else math.inf
    return Rate(float(line.slope), half, float(line.intercept))


class MultilevelCost(NamedTuple):
    """The cheapest multilevel estimator of the means for an accuracy."""

    last: int  # its finest level
    seconds: float  # nominal core-seconds of the counted work for all rows (means) at once
    # core-seconds for a single row with the median of the variances and biases: the case most
    # favourable to the method
    typical: float


class Levels(NamedTuple):
    """Level differences of the section means in units of each quantity's sd."""

    # A row per level: ``scheme, level, dt``; worst and median over the section means of the
    # absolute ``mean`` of the difference and of its ``variance``; largest ``kurtosis`` of a
    # difference, and whether it exceeds `KURTOSIS_ALARM` (``alarm``); ``consistency`` with the
    # coarser level, which should be below 1; nominal seconds of a path of the difference
    # (``path_seconds``) and of the level alone (``alone_seconds``)
    table: pd.DataFrame
    single: Floats  # variance of each level alone; (levels, rows)
    # alpha, beta, gamma: decay of the worst mean and of the worst variance, growth of the work, per
    # level
    alpha: Rate
    beta: Rate
    gamma: Rate
    # typical_alpha, typical_beta: decay of the medians; the first has the slope of the worst, as at
    # fine levels the median is sampling noise
    typical_alpha: Rate
    typical_beta: Rate

    def estimate(self, accuracy: float) -> MultilevelCost:
        """Cost of an optimal estimator whose standard error and bias are each within the
        accuracy."""
        t = self.table
        single = self.single.max(axis=1), np.median(self.single, axis=1)
        last, seconds = self._cheapest(
            self.alpha, self.beta, t["variance_worst"], single[0], accuracy
        )
        _, typical = self._cheapest(
            self.typical_alpha, self.typical_beta, t["variance_median"], single[1], accuracy
        )
        return MultilevelCost(last, seconds, typical)

    def _cheapest(
        self, weak: Rate, strong: Rate, variance: pd.Series, single: Floats, accuracy: float
    ) -> tuple[int, float]:
        """Last level and seconds of the cheapest estimator for given variances and rates."""
        bias = 2.0 ** (weak.intercept + weak.slope * np.arange(MOST_LEVELS))
        remaining = bias / (2.0**-weak.slope - 1.0)
        last = max(1, int(np.argmax(remaining <= accuracy)))
        v = _extrapolate(variance.to_numpy(), strong.slope, last)
        alone = _extrapolate(self.table["alone_seconds"].to_numpy(), self.gamma.slope, last)
        pair = _extrapolate(self.table["path_seconds"].to_numpy(), self.gamma.slope, last)
        whole = _extrapolate(single, 0.0, last)
        return last, min(
            giles_cost(
                np.append(whole[k], v[k + 1 :]), np.append(alone[k], pair[k + 1 :]), accuracy
            )
            for k in range(last + 1)
        )


def _extrapolate(values: Floats, slope: float, last: int) -> Floats:
    """Values of the levels up to the last; those that were not run are extrapolated by their
    rate."""
    beyond = np.arange(1, last + 2 - values.size)
    return np.append(values, values[-1] * 2.0 ** (slope * beyond))[: last + 1]


def giles_cost(variance: Floats, seconds: Floats, accuracy: float) -> float:
    """Least total time for which the sum of independent levels has a given standard error.

    Level l gets paths in proportion to ``sqrt(V_l / C_l)``; the total is ``(sum sqrt(V_l C_l))^2 /
    accuracy^2``.

    Shapes: `variance`, `seconds` (levels,).
    """
    return round(float((np.sqrt(variance * seconds).sum() / accuracy) ** 2), 12)


def measure_levels(scene: Scene, scheme: str, *, impacts: int, seed: int, workers: int) -> Levels:
    """Run every level with its own random numbers, and tabulate the level differences."""
    longest = 0.99 * largest_step(scene, scheme)[0] / 2 ** (SIDE_BY_SIDE - 1)
    seeds = np.random.SeedSequence([seed, MULTILEVELS]).spawn(MULTILEVELS)
    common: dict[str, Any] = {
        "paths": LEVEL_PATHS,
        "impacts": impacts,
        "scheme": scheme,
        "workers": workers,
    }
    common["record"], dt = Record(step_bias=True), min(COARSEST_STEP, longest)
    bar = ProgressBar(seeds, label=f"levels of {scheme}", unit="level", leave=False)
    return levels_of(
        [simulate(scene, dt=dt / 2**level, rng=own, **common) for level, own in enumerate(bar)]
    )


def levels_of(runs: Sequence[Ensemble]) -> Levels:
    """Tabulate the level differences of runs at halved steps."""
    unit = units(runs[-1]).to_numpy()
    seen = [run.result.sums["fine_coarse"] for run in runs]
    single = []
    rows = []
    for level, (run, sums) in enumerate(zip(runs, seen, strict=True)):
        m = sums.moment
        work = cost_of(run, 1).core_seconds
        v = np.maximum(m(2, 0) - 2.0 * m(1, 1) + m(0, 2), 0.0)
        fourth = sum((-1) ** q * comb(4, q) * m(4 - q, q) for q in range(5))
        kurtosis = np.divide(fourth, v**2, out=np.zeros_like(v), where=v > 0.0)
        mean = np.abs(sums.mean[0] - sums.mean[1]) / unit
        noise = np.sqrt(v / sums.n) / unit
        worst = np.unravel_index(int(mean.argmax()), mean.shape)
        rows.append(
            {
                "scheme": run.scheme,
                "level": level,
                "dt": run.dt,
                "mean_worst": float(mean[worst]),
                "se_mean_worst": float(noise[worst]),
                "mean_median": float(np.median(mean)),
                "variance_worst": float((v / unit**2).max()),
                "variance_median": float(np.median(v / unit**2)),
                "kurtosis": float(kurtosis.max()),
                "alarm": bool(kurtosis.max() > KURTOSIS_ALARM),
                "consistency": _consistency(seen[level - 1], sums) if level else math.nan,
                # steps of dt, 2 dt and 4 dt are 1 : 1/2 : 1/4; a difference takes the first two, a
                # level the first
                "path_seconds": work * 6.0 / 7.0,
                "alone_seconds": work * 4.0 / 7.0,
            }
        )
        single.append((m(2, 0) / unit**2).ravel())
    table = pd.DataFrame(rows)
    of = table[table["level"] >= FITTED_FROM]
    clear = find_clear(table)
    alpha, beta, gamma, typical_beta = (
        fit(part["level"].to_numpy(float), part[name].to_numpy())
        for part, name in (
            (clear, "mean_worst"),
            (of, "variance_worst"),
            (of, "path_seconds"),
            (of, "variance_median"),
        )
    )
    noise = np.sqrt(of["variance_median"] / runs[-1].paths)
    clear = of[(of["mean_median"] > 3.0 * noise) | (of["level"] == FITTED_FROM)]
    intercept = float((np.log2(clear["mean_median"]) - alpha.slope * clear["level"]).mean())
    return Levels(
        table,
        np.array(single),
        alpha,
        beta,
        gamma,
        alpha._replace(intercept=intercept),
        typical_beta,
    )


def find_clear(table: pd.DataFrame) -> pd.DataFrame:
    """The levels whose worst mean is not hidden by noise: the fine ones, or all where there are too
    few of these."""
    clear = table[table["mean_worst"] > 3.0 * table["se_mean_worst"]]
    fine = clear[clear["level"] >= FITTED_FROM]
    return next((part for part in (fine, clear) if len(part) > 2), table)  # two have no interval


def _consistency(a: CentralSums, b: CentralSums) -> float:
    """Largest ``|a - b + c| / (3 (sqrt Va + sqrt Vb + sqrt Vc))`` over the rows; the sum telescopes
    if it is below 1.

    ``a`` and ``b`` are the means of the coarser and of the finer run, ``c`` that of the level
    difference, ``V`` the variances of these estimates (Giles 2015, section 3.2).
    """
    off = np.abs(a.mean[0] - b.mean[1])  # c is b minus the mean at 2 dt in the finer run
    difference = np.maximum(b.moment(2, 0) - 2.0 * b.moment(1, 1) + b.moment(0, 2), 0.0)
    spread = sum(
        np.sqrt(v / n) for v, n in ((a.moment(2, 0), a.n), (b.moment(2, 0), b.n), (difference, b.n))
    )
    return float(np.divide(off, 3.0 * spread, out=np.zeros_like(off), where=spread > 0.0).max())


MEASURED_SIGMAS = (1e-3, 1e-2, 0.05, 0.1, 0.3, 1.5**0.5)
LEVEL_TIMINGS = 3


def control_table(
    scene: Scene,
    *,
    impacts: int,
    seed: int,
    workers: int,
    sigmas: Sequence[float] = MEASURED_SIGMAS,
    paths: int = LEVEL_PATHS,
) -> pd.DataFrame:
    """Variance without the control variate over variance with it, on the same paths.

    Returns: A row per noise intensity ``sigma``: median and smallest ratio of variances over the
    section means (``means_median, means_smallest``) and sds (``sds_median, sds_smallest``), without
    displacements at the wall, whose variance is due to off-itinerary paths alone; ``time_ratio``,
    the time of a path with the control variate over that without, so that a ratio of variances over
    ``time_ratio`` is the gain per second; ``antithetic_means, antithetic_sds``, the median gain of
    antithetic pairs, see `antithetic_gain`.
    """
    rows = []
    settings: dict[str, Any] = {"paths": paths, "scheme": "exact-flight", "rng": seed}
    for sigma in ProgressBar(sigmas, label="control variate", unit="sigma", leave=False):
        own = scene.with_sigma(sigma)
        call = partial(simulate, own, impacts=impacts, workers=workers, **settings)
        call(sampling=Sampling(control=True))
        runs, seconds = zip(
            *[
                time_run(partial(call, sampling=Sampling(control=c)))
                for _ in range(LEVEL_TIMINGS)
                for c in (False, True)
            ],
            strict=True,
        )
        plain = runs[-2].section
        controlled = runs[-1].section
        least = smallest_sd({str(name): plain[name].to_numpy() for name in plain})
        usable = {
            q: (plain["sd_" + q] > least[q]) & (q != "x" + plain["mesh"].astype(str))
            for q in SECTION
        }
        row: dict[str, float] = {"sigma": sigma}
        for moment, prefix in (("means", "se_"), ("sds", "se_sd_")):
            ratios = np.concatenate(
                [((plain[prefix + q] / controlled[prefix + q]) ** 2)[usable[q]] for q in SECTION]
            )
            row |= {
                f"{moment}_median": float(np.median(ratios)),
                f"{moment}_smallest": float(ratios.min()),
            }
        plan = plan_of(own, impacts=impacts, dt=default_step(own, "exact-flight"), **settings)
        gains = [
            np.median(gain[np.array(list(usable.values())).T]) for gain in antithetic_gain(plan)
        ]
        row |= {"antithetic_means": float(gains[0]), "antithetic_sds": float(gains[1])}
        rows.append({**row, "time_ratio": min(seconds[1::2]) / min(seconds[::2])})
    return pd.DataFrame(rows)


def antithetic_gain(plan: Plan) -> tuple[Floats, Floats]:
    """Variance of independent paths over that of as many paths in antithetic pairs.

    The mean of a path and of its partner with negated noise, with correlation r, has the variance
    ``(1 + r) / 2`` times that of a path.  Two independent paths have 1 / 2, so the gain is ``1 / (1
    + r)``.  For an sd, r is the correlation of the squared deviations.

    Shapes: result (impacts, 6).
    """
    pairs = [(sample(plan, n), sample(plan._replace(mirrored=True), n)) for n in range(plan.blocks)]
    both = np.concatenate(
        [[one.rows[0, :, :, : len(SECTION)] for one in pair] for pair in pairs], axis=1
    )
    gains = []
    for values in (both, (both - np.nanmean(both, axis=(0, 1))) ** 2):
        away = values - np.nanmean(values, axis=(0, 1))
        with np.errstate(invalid="ignore", divide="ignore"):
            gains.append(
                np.nanmean(away**2, axis=(0, 1))
                / (2.0 * np.nanmean(away.mean(axis=0) ** 2, axis=0))
            )
    return gains[0], gains[1]
