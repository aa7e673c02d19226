"""Slopes of the step bias of a scheme with inelastic impacts, for which no weak order has been
published.

How fast a scheme converges towards its own limit is answered by differences between a step and
twice the step on the same Brownian paths (as in the tests of diffrax); whether that limit is
correct, by comparing Richardson extrapolation from the smallest steps with exact flights.  Each
quantity has a slope of its own, over a stated range of steps.  It is called an order only where the
local slopes at the finest steps agree, and no change turns its sign.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pandas as pd
from scipy.special import stdtrit
from scipy.stats import linregress

from rattle.montecarlo import SCHEMES, Ensemble, Record, simulate
from rattle.montecarlo.diagnostics.accuracy import units
from rattle.montecarlo.statistics.intervals import CONFIDENCE, ROUNDED_SD, widest
from rattle.scene import Floats, Scene
from rattle.scene.progress import ProgressBar

STILL = 1e-9  # change below which a quantity counts as constant


SETTLED_SLOPES = 0.3
"""Largest half width of the interval of the difference of two local slopes with which they can be
said to agree."""
AGREE = 0.05  # difference of two local slopes that does not matter


def slope_from(bias: Floats, se: Floats, steps: Sequence[float]) -> tuple[float, float, float]:
    """Slope of log(change) over log(step) with its jackknife interval.

    The change at a step is the root mean square over the rows of the replicates' mean, corrected
    for the variance of its measurement; NaN where that exceeds it.

    `bias`, `se`: Change between a step and its half in each row (moment), and its standard error.
    Shapes: `bias`, `se` (replicates, steps, rows).
    """

    def fit_slope(bias: Floats, se: Floats) -> Any:
        """Slope from some of the replicates."""
        return linregress(np.log(steps), _log_change(bias, se)).slope

    slope, half = _jackknife(fit_slope, bias, se)
    # noise hides it without one of the replicates: it has no interval
    slope = slope if half >= 0.0 else math.nan
    return slope, slope - half, slope + half


def find_settled(
    bias: Floats, se: Floats, steps: Sequence[float]
) -> tuple[float, float, float, int]:
    """The order, if the slope has settled: the local slopes of the finest three changes agree, and
    none turns its sign.

    Returns: Slope over the finest three steps and its 95 % interval; NaN if it has not settled, or
    noise hides it. Returns: Rows whose change turns its sign from one step to the next, over all
    steps, beyond three standard errors.
    """
    mean = bias.mean(axis=0)
    error = np.sqrt((se**2).sum(axis=0)) / len(bias)
    sign = np.sign(mean) * (np.abs(mean) > np.maximum(3.0 * error, STILL))
    turning = sign[1:] * sign[:-1] < 0.0
    turns = turning.any(axis=0).sum()
    settled = (math.nan, math.nan, math.nan)
    if len(steps) > 2 and not turning[-2:].any():
        finest = (bias[:, -3:], se[:, -3:])
        spacing = np.diff(np.log(steps[-3:]))

        def bend(bias: Floats, se: Floats) -> Any:
            """Difference of the two local slopes."""
            return np.diff(np.diff(_log_change(bias, se)) / spacing)[0]

        bent, half = _jackknife(bend, *finest)
        if abs(bent) <= max(half, AGREE) and half <= SETTLED_SLOPES:
            settled = slope_from(*finest, steps[-3:])
    return *settled, turns


def _slopes(bias: Floats, se: Floats, steps: Sequence[float]) -> tuple[float, ...]:
    """Slopes over all steps and at the finest two, the rows that turn, and the order; each slope
    with its interval."""
    *order, turns = find_settled(bias, se, steps)
    finest = slope_from(bias[:, -2:], se[:, -2:], steps[-2:])
    return *slope_from(bias, se, steps), *finest, turns, *order


def changes_from(bias: Floats, se: Floats) -> Floats:
    """Size of the change at each step with its jackknife interval, which is symmetric in the
    logarithm.

    Shapes: `bias`, `se` (replicates, steps, rows); result (3, steps).
    """
    change, half = _jackknife(_log_change, bias, se)
    return np.exp([change, change - half, change + half])


def _log_change(bias: Floats, se: Floats) -> Floats:
    """Logarithm of the size of the change at each step; NaN where noise hides it."""
    noise = (se**2).mean(axis=0) / len(se)
    square = (bias.mean(axis=0) ** 2 - noise).mean(axis=1)
    return 0.5 * np.log(np.where(square > 0.0, square, np.nan))


def _jackknife(value: Callable[[Floats, Floats], Any], bias: Floats, se: Floats) -> tuple[Any, Any]:
    """A value of the replicates, and the half width of its interval, from leaving out each."""
    n = len(bias)
    without = [value(np.delete(bias, i, axis=0), np.delete(se, i, axis=0)) for i in range(n)]
    widening = stdtrit(n - 1, 0.5 + 0.5 * CONFIDENCE)
    return value(bias, se), widening * np.sqrt((n - 1) * np.var(without, axis=0))


STEP_PAIRS = (0.016, 0.008, 0.004, 0.002)
"""Larger step of each pair; the smaller one is half of it."""
ORDER_PATHS = 40_000  # of each run
REPLICATES = 6
ORDER_IMPACTS = 4  # impacts over which paths with different dt keep the same itinerary


SLOPE_COLUMNS = [
    *("scheme", "sigma", "moment", "quantity", "coarsest", "finest"),
    *("slope", "low", "high", "last", "last_low", "last_high", "turns"),
    *("order", "order_low", "order_high", "change", "limit_z", "limit_allowed"),
]
"""Columns of the slopes, a row for each scheme, noise intensity, ``moment`` (``mean``, ``sd``, or
``itinerary`` for the probability of the noise-free itinerary) and quantity.

``coarsest, finest``: the larger step of the first pair and the smaller one of the last.  ``slope,
low, high``: over all steps, with its 95 % interval; NaN where sampling noise hides the bias.
``last``: the same at the finest steps. ``turns``: impacts at which the change turns its sign.
``order``: slope over the finest three changes, where it has settled.  ``change``: root mean square
over the impacts, in sds, of the last change; of an itinerary the distance from exact flights.
``limit_z``: largest difference between the extrapolated value and exact flights, in standard
errors. ``limit_allowed``: its bound at 95 % confidence if the limit is correct, over all quantities
of the scheme and moment.
"""
Row: TypeAlias = tuple[Any, ...]


class WeakOrders(NamedTuple):
    """Slopes and orders, and the changes from which they are fitted."""

    table: pd.DataFrame  # with `SLOPE_COLUMNS`
    # columns ``scheme, sigma, moment, quantity, dt, change, low, high``.  For means and sds
    # ``change`` is the root mean square over the impacts, in sds, of the change between dt and dt /
    # 2; for the itinerary the distance of its probability at dt from that of exact flights; NaN
    # where noise hides it.  The 95 % intervals are for each row by itself
    changes: pd.DataFrame


def orders_over(scene: Scene, sigmas: Sequence[float], **settings: int) -> WeakOrders:
    """Slopes and weak orders at several noise intensities."""
    orders = [weak_orders(scene.with_sigma(sigma), **settings) for sigma in sigmas]
    tables, changes = zip(*orders, strict=True)
    return WeakOrders(pd.concat(tables), pd.concat(changes))


def weak_orders(
    scene: Scene,
    *,
    impacts: int = ORDER_IMPACTS,
    paths: int = ORDER_PATHS,
    replicates: int = REPLICATES,
    rng: int = 0,
    workers: int = 2,
) -> WeakOrders:
    """Measure slope and, where it has settled, weak order of the step bias of every scheme that has
    one.

    They are measured for mean and sd of each quantity on the Poincaré section at the impacts, and
    for the probability of the noise-free itinerary.
    """
    *seeds, last = np.random.SeedSequence(rng).spawn(replicates + 1)
    sample = partial(simulate, scene.phase_reduced, impacts=impacts, workers=workers)
    exact = sample(paths=paths * replicates, rng=last)
    schemes = [name for name, kind in SCHEMES.items() if kind.has_step_bias]
    record = Record(step_bias=True)
    settings = list(itertools.product(schemes, seeds, STEP_PAIRS))
    measured = []
    for scheme, seed, step in ProgressBar(settings, label="weak order", unit="run"):
        run = sample(paths=paths, scheme=scheme, dt=0.5 * step, rng=seed, record=record)
        measured.append(_measure_bias(run, exact).assign(scheme=scheme, step=step))
    slopes: list[Row] = []
    changes: list[Row] = []
    for (scheme, moment), rows in pd.concat(measured).groupby(["scheme", "moment"], sort=False):
        of = (scheme, scene.sigma, moment)
        limit_z = rows.loc[rows["step"] == STEP_PAIRS[-1], ["quantity", "limit_z"]].dropna()
        allowed = widest(len(limit_z), 1.0 - CONFIDENCE)
        for quantity, of_quantity in rows.groupby("quantity", sort=False):
            bias, se = (
                of_quantity[name].to_numpy().reshape(replicates, len(STEP_PAIRS), -1)
                for name in ("bias", "se_bias")
            )
            if moment == "itinerary":
                slope, change = _fit_itinerary(bias, exact)
            else:
                z = limit_z.loc[limit_z["quantity"] == quantity, "limit_z"].max()
                change = np.array([STEP_PAIRS, *changes_from(bias, se)])
                ends = (STEP_PAIRS[0], 0.5 * STEP_PAIRS[-1])
                slope = (*ends, *_slopes(bias, se, STEP_PAIRS), change[1, -1], z, allowed)
            slopes.append((*of, quantity, *slope))
            changes += [(*of, quantity, *point) for point in change.T]
    columns = ["scheme", "sigma", "moment", "quantity", "dt", "change", "low", "high"]
    return WeakOrders(
        pd.DataFrame(slopes, columns=SLOPE_COLUMNS), pd.DataFrame(changes, columns=columns)
    )


def _measure_bias(run: Ensemble, exact: Ensemble) -> pd.DataFrame:
    """Step bias of each moment in units of the quantity's sd, and of the itinerary's probability
    against exact flights.

    ``limit_z`` is the difference of the extrapolated value from exact flights in standard errors;
    NaN where nothing varies.
    """
    rows = run.step_bias
    names = rows["quantity"].where(rows["moment"] == "mean", "sd_" + rows["quantity"])
    unit = _look_up(units(run), rows["impact"], rows["quantity"])
    value = _look_up(exact.section, rows["impact"], names)
    error = np.hypot(rows["se_corrected"], _look_up(exact.section, rows["impact"], "se_" + names))
    away = (np.abs(rows["corrected"] - value) - rows["rest"]).clip(lower=0.0)
    moments = rows[["moment", "quantity"]].assign(
        bias=rows["bias"] / unit,
        se_bias=rows["se_bias"] / unit,
        limit_z=(away / error).where(error > ROUNDED_SD * np.abs(value)),
    )
    share = _share_on_itinerary(run) - _share_on_itinerary(exact)
    itinerary = {"moment": "itinerary", "quantity": "", "bias": share, "se_bias": 0.0}
    return pd.concat([moments, pd.DataFrame([itinerary])])


def _look_up(table: pd.DataFrame, impacts: pd.Series, columns: pd.Series) -> Floats:
    """Entries of a table of the impacts by impact and column."""
    return table.stack().loc[pd.MultiIndex.from_arrays([impacts, columns])].to_numpy()


def _share_on_itinerary(run: Ensemble) -> float:
    """Share of the paths that keep to the noise-free itinerary."""
    return float(run.agreement["noise-free"].iloc[-1])


def _fit_itinerary(distance: Floats, exact: Ensemble) -> tuple[Row, Floats]:
    """Slope and changes of the distance of the itinerary's probability from that of exact flights.

    Shapes: `distance` (replicates, steps, 1).
    """
    steps = 0.5 * np.array(STEP_PAIRS)
    probability = _share_on_itinerary(exact)
    floor = math.sqrt(probability * (1.0 - probability) / exact.paths)
    mean = distance.mean(axis=0)[:, 0]
    spread = distance.std(axis=0, ddof=1)[:, 0] / math.sqrt(len(distance))
    away = np.abs(mean)
    widening = widest(1, 1.0 - CONFIDENCE)
    half = widening * np.hypot(spread, floor)
    change = np.array(
        [steps, np.where(away > half, away, np.nan), np.maximum(away - half, 0.0), away + half]
    )
    floor = max(floor, 1e-150)  # so that nothing is divided by 0 where all paths follow it
    seen = away > 3.0 * np.hypot(spread, floor)
    slopes: tuple[float, ...] = (*[math.nan] * 6, 0, *[math.nan] * 3)  # noise hides them
    if seen.sum() >= 2:
        shown = distance[:, seen]
        slopes = _slopes(shown, np.zeros_like(shown), steps[seen])
    last = 2.0 * mean[-1] - mean[-2]  # Richardson extrapolation from the two smallest steps
    error = np.hypot(np.hypot(2.0 * spread[-1], spread[-2]), floor)
    ends = (steps[seen] if seen.any() else steps)[[0, -1]]
    return (*ends, *slopes, away[-1], abs(last) / error, widening), change
