"""Slopes of the step bias of a scheme with inelastic impacts, for which no weak order has been
published.

How fast a scheme converges towards its own limit is answered by differences between a step and
twice the step on the same Brownian paths (as in the tests of diffrax); whether that limit is
correct, by comparing Richardson extrapolation from the smallest steps with exact flights.  Each
quantity has a slope of its own, over a stated range of steps.  It is called an order only where the
local slopes at the finest steps agree, and no change turns its sign.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from rattle.montecarlo import SCHEMES, Ensemble, Record, simulate
from rattle.montecarlo.diagnostics.accuracy import units
from rattle.montecarlo.statistics.intervals import CONFIDENCE, ROUNDED_SD, widest
from rattle.scene import Bools, Floats, Scene
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
    slope, half = _jackknife(partial(_slope, bias, se, steps), len(bias))
    # noise hides it without one of the replicates: it has no interval
    slope = slope if half >= 0.0 else math.nan
    return slope, slope - half, slope + half


def _slope(bias: Floats, se: Floats, steps: Sequence[float], chosen: Floats) -> float:
    x = np.log(np.asarray(steps))
    y = np.log(_sizes(bias, se, chosen))
    return float(((x - x.mean()) * y).sum() / ((x - x.mean()) ** 2).sum())


def find_settled(
    bias: Floats, se: Floats, steps: Sequence[float]
) -> tuple[float, float, float, int]:
    """The order, if the slope has settled: the local slopes of the finest three changes agree, and
    none turns its sign.

    Returns: Slope over the finest three steps and its 95 % interval; NaN if it has not settled, or
    noise hides it. Returns: Rows whose change turns its sign from one step to the next, over all
    steps, beyond three standard errors.
    """
    n = len(bias)
    mean = bias.mean(axis=0)
    error = np.sqrt((se**2).sum(axis=0)) / n
    seen = np.abs(mean) > np.maximum(3.0 * error, STILL)
    turning = (mean[1:] * mean[:-1] < 0.0) & seen[1:] & seen[:-1]
    turns = int(turning.any(axis=0).sum())

    def change(chosen: Floats) -> float:
        pairs = slice(-3, -1), slice(-2, None)
        first, second = (_slope(bias[:, pair], se[:, pair], steps[pair], chosen) for pair in pairs)
        return second - first

    bent, half = _jackknife(change, n)
    if turning[-2:].any() or not (abs(bent) <= max(half, AGREE) and half <= SETTLED_SLOPES):
        return math.nan, math.nan, math.nan, turns
    return *slope_from(bias[:, -3:], se[:, -3:], steps[-3:]), turns


def _slopes(bias: Floats, se: Floats, steps: Sequence[float]) -> tuple[float, ...]:
    """Slopes over all steps and at the finest two, the rows that turn, and the order; each slope
    with its interval."""
    *order, turns = (
        find_settled(bias, se, steps) if len(steps) > 2 else (math.nan, math.nan, math.nan, 0)
    )
    return (
        *slope_from(bias, se, steps),
        *slope_from(bias[:, -2:], se[:, -2:], steps[-2:]),
        turns,
        *order,
    )


def changes_from(bias: Floats, se: Floats) -> tuple[Floats, Floats, Floats]:
    """Size of the change at each step with its jackknife interval, which is symmetric in the
    logarithm.

    Shapes: `bias`, `se` (replicates, steps, rows); result (steps,).
    """
    change = _sizes(bias, se, np.ones(len(bias)))
    _, half = _jackknife(lambda chosen: np.log(_sizes(bias, se, chosen)), len(bias))
    return change, change * np.exp(-half), change * np.exp(half)


def _sizes(bias: Floats, se: Floats, chosen: Floats) -> Floats:
    weight = chosen / chosen.sum()
    mean = np.einsum("r,rsi->si", weight, bias)
    noise = np.einsum("r,rsi->si", weight**2, se**2)
    square = (mean**2 - noise).mean(axis=1)
    return np.sqrt(np.where(square > 0.0, square, np.nan))


def _jackknife(value: Callable[[Floats], Any], n: int) -> tuple[Any, Any]:
    """A value that depends on how n replicates are weighted, and the half width of its interval."""
    without = np.array([value(weights) for weights in 1.0 - np.eye(n)])
    return value(np.ones(n)), float(stdtrit(n - 1, 0.5 + 0.5 * CONFIDENCE)) * np.sqrt(
        (n - 1) * without.var(axis=0)
    )


STEP_PAIRS = (0.016, 0.008, 0.004, 0.002)
"""Larger step of each pair; the smaller one is half of it."""

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
    found = [weak_orders(scene.with_sigma(sigma), **settings) for sigma in sigmas]
    return WeakOrders(
        pd.concat([one.table for one in found]), pd.concat([one.changes for one in found])
    )


def _rows(run: Ensemble, moment: str) -> pd.DataFrame:
    """Step bias of the moments of one kind, in units of the quantities' sds."""
    unit = units(run)
    bias = run.step_bias
    bias = bias[bias["moment"] == moment]
    scale = np.array([unit.at[k, q] for k, q in zip(bias["impact"], bias["quantity"], strict=True)])
    return bias[["bias", "se_bias"]].div(scale, axis=0).assign(quantity=bias["quantity"])


def _limit_z(run: Ensemble, exact: Ensemble, moment: str) -> tuple[Floats, Bools]:
    """Differences of the extrapolated values from exact flights in standard errors, and which of
    them vary at all."""
    rows = run.step_bias[run.step_bias["moment"] == moment]
    names = [q if moment == "mean" else "sd_" + q for q in rows["quantity"]]
    impacts = rows["impact"].tolist()
    value, se = (
        np.array(
            [exact.section.at[k, prefix + name] for k, name in zip(impacts, names, strict=True)]
        )
        for prefix in ("", "se_")
    )
    away = np.maximum(np.abs(rows["corrected"].to_numpy() - value) - rows["rest"].to_numpy(), 0.0)
    error = np.hypot(rows["se_corrected"].to_numpy(), se)
    varies = error > ROUNDED_SD * np.abs(value)
    return away / np.where(varies, error, np.inf), varies


def weak_orders(
    scene: Scene,
    *,
    impacts: int = ORDER_IMPACTS,
    paths: int = 40_000,
    replicates: int = 6,
    rng: int = 0,
    workers: int = 2,
) -> WeakOrders:
    """Measure slope and, where it has settled, weak order of the step bias of every scheme that has
    one.

    They are measured for mean and sd of each quantity on the Poincaré section at the impacts, and
    for the probability of the noise-free itinerary.
    """
    seeds = np.random.SeedSequence(rng).spawn(replicates + 1)
    sample = partial(simulate, scene.phase_reduced, impacts=impacts, workers=workers)
    exact = sample(paths=paths * replicates, scheme="exact-flight", rng=seeds[-1])
    found = []
    changes = []
    schemes = [name for name, kind in SCHEMES.items() if kind.has_step_bias]
    with ProgressBar(
        label="weak order", total=len(schemes) * replicates * len(STEP_PAIRS), unit="run"
    ) as bar:
        for scheme in schemes:
            common: dict[str, Any] = {
                "paths": paths,
                "scheme": scheme,
                "record": Record(step_bias=True),
            }
            runs: list[list[Ensemble]] = []
            for seed in seeds[:-1]:
                runs.append([sample(dt=0.5 * step, rng=seed, **common) for step in STEP_PAIRS])
                bar.update(len(STEP_PAIRS))
            moments = [_by_quantity(scheme, moment, runs, exact) for moment in ("mean", "sd")]
            for slopes, points in (*moments, _by_itinerary(scheme, runs, exact)):
                found += slopes
                changes += points
    columns = ["scheme", "sigma", "moment", "quantity", "dt", "change", "low", "high"]
    return WeakOrders(
        pd.DataFrame(found, columns=SLOPE_COLUMNS), pd.DataFrame(changes, columns=columns)
    )


def _by_quantity(
    scheme: str, moment: str, runs: list[list[Ensemble]], exact: Ensemble
) -> tuple[list[Row], list[Row]]:
    """Slopes and changes of each quantity, from runs by replicate and step."""
    rows = [[_rows(run, moment) for run in row] for row in runs]
    bias, se = (np.array([[r[name] for r in row] for row in rows]) for name in ("bias", "se_bias"))
    names = rows[0][0]["quantity"].to_numpy()
    sigma = exact.scene.sigma
    limits = [_limit_z(row[-1], exact, moment) for row in runs]
    allowed = widest(sum(int(varies.sum()) for _, varies in limits), 1.0 - CONFIDENCE)
    slopes: list[Row] = []
    points: list[Row] = []
    for quantity in dict.fromkeys(names):
        own = names == quantity
        b = bias[:, :, own]
        s = se[:, :, own]
        errors = changes_from(b, s)
        z = max(
            (float(z[own & varies].max()) for z, varies in limits if (own & varies).any()),
            default=math.nan,
        )
        of = (scheme, sigma, moment, str(quantity), STEP_PAIRS[0], 0.5 * STEP_PAIRS[-1])
        slopes.append((*of, *_slopes(b, s, STEP_PAIRS), float(errors[0][-1]), z, allowed))
        points += [
            (scheme, sigma, moment, quantity, *row) for row in zip(STEP_PAIRS, *errors, strict=True)
        ]
    return slopes, points


def _by_itinerary(
    scheme: str, runs: list[list[Ensemble]], exact: Ensemble
) -> tuple[list[Row], list[Row]]:
    """The same of the noise-free itinerary's probability, whose bias is taken against exact
    flights."""
    shares = np.array([[_followers(run) for run in row] for row in runs])
    kept = _followers(exact)
    means = shares.mean(axis=0)
    spread = shares.std(axis=0, ddof=1) / math.sqrt(len(shares))
    floor = math.sqrt(kept * (1.0 - kept) / exact.paths)
    away = np.abs(means - kept)
    widening = widest(1, 1.0 - CONFIDENCE)
    half = widening * np.hypot(spread, floor)
    errors = np.where(away > half, away, np.nan), np.maximum(away - half, 0.0), away + half
    floor = max(floor, 1e-150)
    seen = away > 3.0 * np.hypot(spread, floor)
    steps = 0.5 * np.array(STEP_PAIRS)
    slopes: tuple[float, ...] = (*[math.nan] * 6, 0, *[math.nan] * 3)  # noise hides them
    if seen.sum() >= 2:
        distance = (shares - kept)[:, seen, None]
        slopes = _slopes(distance, np.zeros_like(distance), tuple(steps[seen]))
    last = 2.0 * means[-1] - means[-2]  # Richardson extrapolation from the two smallest steps
    error = math.hypot(math.hypot(2.0 * spread[-1], spread[-2]), floor)
    of = (scheme, exact.scene.sigma, "itinerary", "")
    ends = (steps[seen] if seen.any() else steps)[[0, -1]].tolist()
    limit = abs(float(last) - kept) / error, widening
    return [(*of, *ends, *slopes, float(away[-1]), *limit)], [
        (*of, *row) for row in zip(steps, *errors, strict=True)
    ]


def _followers(run: Ensemble) -> float:
    """Share of the paths that keep to the noise-free itinerary."""
    return float(run.agreement["noise-free"].iloc[-1])
