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
from typing import NamedTuple, TypeVar

import numpy as np
import pandas as pd
from scipy import stats

from rattle.montecarlo import Ensemble, Record, Sampling, largest_step, simulate
from rattle.montecarlo.accuracy.cost import cost_of
from rattle.montecarlo.diagnostics.accuracy import smallest_sd, units
from rattle.montecarlo.diagnostics.reference import at_wall
from rattle.montecarlo.kernel.block import Plan, sample
from rattle.montecarlo.noise.philox import LEVELS as SIDE_BY_SIDE
from rattle.scene import Floats, Scene, section_names
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

    @property
    def decay(self) -> float:
        """The power of two by which it falls from level to level."""
        return -self.slope


def fit(level: "Floats | pd.Series", value: "Floats | pd.Series") -> Rate:
    """Fit an exponential by a straight line through the binary logarithms.

    Shapes: `level`, `value` (levels,).
    """
    line = stats.linregress(level, np.log2(value))
    half = float(line.stderr * stats.t.isf(0.025, level.size - 2)) if level.size > 2 else math.inf
    return Rate(line.slope, half, line.intercept)


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
        worst = self.table["variance_worst"], self.single.max(axis=1)
        median = self.table["variance_median"], np.median(self.single, axis=1)
        last, seconds = self._cheapest(self.alpha, self.beta, *worst, accuracy)
        _, typical = self._cheapest(self.typical_alpha, self.typical_beta, *median, accuracy)
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


def level_steps(scene: Scene, scheme: str) -> list[float]:
    """The step of every level."""
    longest = 0.99 * largest_step(scene, scheme)[0] / 2 ** (SIDE_BY_SIDE - 1)
    return [min(COARSEST_STEP, longest) / 2**level for level in range(MULTILEVELS)]


def measure_levels(
    scene: Scene, scheme: str, *, impacts: int, seed: int, workers: int, paths: int = LEVEL_PATHS
) -> Levels:
    """Run every level with its own random numbers, and tabulate the level differences."""
    call = partial(
        simulate,
        scene,
        paths=paths,
        impacts=impacts,
        scheme=scheme,
        workers=workers,
        record=Record(step_bias=True),
    )
    seeds = np.random.SeedSequence([seed, MULTILEVELS]).spawn(MULTILEVELS)
    bar = ProgressBar(seeds, label=f"levels of {scheme}", unit="level", leave=False)
    steps = level_steps(scene, scheme)
    return levels_of([call(dt=dt, rng=stream) for dt, stream in zip(steps, bar, strict=True)])


def levels_of(runs: Sequence[Ensemble]) -> Levels:
    """Tabulate the level differences of runs at halved steps."""
    unit = units(runs[-1]).to_numpy().ravel()
    seen = [run.result.sums["fine_coarse"] for run in runs]
    levels = np.arange(len(runs))

    def moment(p: int, q: int) -> Floats:
        """A central moment of every level, shape (levels, rows)."""
        return np.array([sums.moment(p, q).ravel() for sums in seen])

    n = np.array([sums.n.ravel() for sums in seen])
    fine, coarse = (np.array([sums.mean[side].ravel() for sums in seen]) for side in (0, 1))
    single = moment(2, 0)
    variance = np.maximum(single - 2.0 * moment(1, 1) + moment(0, 2), 0.0)
    fourth = sum((-1) ** q * comb(4, q) * moment(4 - q, q) for q in range(5))
    kurtosis = _divide(fourth, variance**2).max(axis=1)
    mean = np.abs(fine - coarse) / unit
    noise = np.sqrt(variance / n) / unit
    # the sum telescopes if |a - b + c| / (3 (sqrt Va + sqrt Vb + sqrt Vc)) is below 1: a and b are
    # the means of the coarser and of the finer run, c that of the level difference, so that b - c
    # is the mean at 2 dt in the finer run (Giles 2015, section 3.2)
    error = np.sqrt(single / n)
    spread = error[:-1] + error[1:] + np.sqrt(variance / n)[1:]
    consistency = _divide(np.abs(fine[:-1] - coarse[1:]), 3.0 * spread).max(axis=1)
    work = np.array([cost_of(run, 1).core_seconds for run in runs])
    table = pd.DataFrame(
        {
            "scheme": runs[0].scheme,
            "level": levels,
            "dt": [run.dt for run in runs],
            "mean_worst": mean.max(axis=1),
            "se_mean_worst": noise[levels, mean.argmax(axis=1)],
            "mean_median": np.median(mean, axis=1),
            "variance_worst": (variance / unit**2).max(axis=1),
            "variance_median": np.median(variance / unit**2, axis=1),
            "kurtosis": kurtosis,
            "alarm": kurtosis > KURTOSIS_ALARM,
            "consistency": [math.nan, *consistency],
            # steps of dt, 2 dt and 4 dt are 1 : 1/2 : 1/4; a difference takes the first two, a
            # level the first
            "path_seconds": work * 6.0 / 7.0,
            "alone_seconds": work * 4.0 / 7.0,
        }
    )
    return _fit_rates(table, single / unit**2, runs[-1].paths)


def _divide(a: Floats, b: Floats) -> Floats:
    """A ratio, 0 where nothing varies."""
    return np.divide(a, b, out=np.zeros_like(b), where=b > 0.0)


def _fit_rates(table: pd.DataFrame, single: Floats, paths: int) -> Levels:
    """Fit the rates to a table of levels; `paths` are those of a run."""
    clear = find_clear(table)
    alpha = fit(clear["level"], clear["mean_worst"])
    fine = table[table["level"] >= FITTED_FROM]
    beta, gamma, typical_beta = (
        fit(fine["level"], fine[name])
        for name in ("variance_worst", "path_seconds", "variance_median")
    )
    noise = np.sqrt(fine["variance_median"] / paths)
    clear = fine[(fine["mean_median"] > 3.0 * noise) | (fine["level"] == FITTED_FROM)]
    intercept = (np.log2(clear["mean_median"]) - alpha.slope * clear["level"]).mean()
    typical_alpha = alpha._replace(intercept=intercept)
    return Levels(table, single, alpha, beta, gamma, typical_alpha, typical_beta)


def find_clear(table: pd.DataFrame) -> pd.DataFrame:
    """The levels whose worst mean is not hidden by noise: the fine ones, or all where there are too
    few of these."""
    clear = table[table["mean_worst"] > 3.0 * table["se_mean_worst"]]
    fine = clear[clear["level"] >= FITTED_FROM]
    return next((part for part in (fine, clear) if len(part) > 2), table)  # two have no interval


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
    timings: int = LEVEL_TIMINGS,
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
    quantities = section_names(scene.stages)
    for sigma in ProgressBar(sigmas, label="control variate", unit="sigma", leave=False):
        call = partial(
            simulate,
            scene.with_sigma(sigma),
            paths=paths,
            impacts=impacts,
            rng=seed,
            workers=workers,
        )
        plain, controlled = (
            partial(call, sampling=Sampling(control=control)) for control in (False, True)
        )
        controlled()  # compiles
        # one after the other, so that what else the machine does slows both
        timed = [time_run(call) for _ in range(timings) for call in (plain, controlled)]
        seconds = [time for _, time in timed]
        before, after = (run.section for run, _ in timed[-2:])
        sd = before[["sd_" + q for q in quantities]].to_numpy()
        least = smallest_sd({str(name): before[name].to_numpy() for name in before})
        usable = (sd > np.transpose([least[q] for q in quantities])) & ~at_wall(
            np.array(quantities), before[["mesh"]].to_numpy()
        )
        row: dict[str, float] = {"sigma": sigma}
        for moment, prefix in (("means", "se_"), ("sds", "se_sd_")):
            names = [prefix + q for q in quantities]
            ratios = (before[names] / after[names]).to_numpy()[usable] ** 2
            row[f"{moment}_median"] = np.median(ratios)
            row[f"{moment}_smallest"] = ratios.min()
        plan = timed[-2][0].plan
        for moment, gain in zip(("means", "sds"), antithetic_gain(plan), strict=True):
            row[f"antithetic_{moment}"] = np.median(gain[usable])
        rows.append({**row, "time_ratio": min(seconds[1::2]) / min(seconds[::2])})
    return pd.DataFrame(rows)


def antithetic_gain(plan: Plan) -> tuple[Floats, Floats]:
    """Variance of independent paths over that of as many paths in antithetic pairs.

    The mean of a path and of its partner with negated noise, with correlation r, has the variance
    ``(1 + r) / 2`` times that of a path.  Two independent paths have 1 / 2, so the gain is ``1 / (1
    + r)``.  For an sd, r is the correlation of the squared deviations.

    Shapes: result (impacts, quantities).
    """
    # without the code, which is last
    both = np.stack(
        [
            np.concatenate([sample(of, n).rows[0, :, :, :-1] for n in range(plan.blocks)])
            for of in (plan, plan._replace(mirrored=True))
        ]
    )
    squares = (both - np.nanmean(both, axis=(0, 1))) ** 2
    return _pair_gain(both), _pair_gain(squares)


def _pair_gain(values: Floats) -> Floats:
    """The gain for the mean of values of both paths of each pair, shape (2, pairs, impacts,
    quantities)."""
    away = values - np.nanmean(values, axis=(0, 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        pairs = np.nanmean(away.mean(axis=0) ** 2, axis=0)
        return np.asarray(np.nanmean(away**2, axis=(0, 1)) / (2.0 * pairs))
