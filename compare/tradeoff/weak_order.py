"""Measured weak order of a scheme with inelastic impacts, for which no order has been published.

Two questions are separated (as in the tests of diffrax): how fast does a scheme converge towards its own limit, and is
that limit correct?  The first is answered by differences between a step and twice the step on the same Brownian paths;
the second by comparing Richardson extrapolation from the smallest steps with exact flights, which have no step bias.
"""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import stdtrit
from tqdm import tqdm

from rattle.compare.validation.verdict import widest
from rattle.montecarlo import SCHEMES, Ensemble, Record, simulate
from rattle.montecarlo.accuracy import units
from rattle.scene.scene import Scene
from rattle.scene.validate import count

__all__ = ["ORDER_IMPACTS", "STEPS", "Order", "Orders", "changes_from", "order_from", "orders_over", "weak_orders"]

Floats = NDArray[np.float64]

STEPS = (0.016, 0.008, 0.004, 0.002)
"""Larger step of each pair; the smaller one is half of it."""

ORDER_IMPACTS = 4  # impacts over which paths with different dt keep the same itinerary
CONFIDENCE = 0.95
STILL = 1e-9  # standard error below which a quantity counts as constant


class Order(NamedTuple):
    """Measured weak order of one scheme for one kind of moment.

    Attributes
    ----------
    scheme : str
    sigma : float
        Noise intensity.
    moment : str
        ``mean``, ``sd``, or ``itinerary`` for the probability of the noise-free itinerary.
    order, low, high : float
        Estimate and its 95 % interval; NaN where sampling noise hides the bias.
    change : float
        Root mean square over quantities and impacts, in sds, of the change from twice the smallest step to the
        smallest; of an itinerary the distance from exact flights.
    limit_z : float
        Largest difference between the extrapolated value and exact flights, in standard errors.
    limit_allowed : float
        Its bound at 95 % confidence if the limit is correct.
    """

    scheme: str
    sigma: float
    moment: str
    order: float
    low: float
    high: float
    change: float
    limit_z: float
    limit_allowed: float


class Orders(NamedTuple):
    """Measured weak orders, and the errors from which they are fitted.

    Attributes
    ----------
    table : DataFrame
        A row for each `Order`.
    changes : DataFrame
        Columns ``scheme, sigma, moment, dt, change, low, high``.  For means and sds ``change`` is the root mean square,
        in sds, of the change between dt and dt / 2; for the itinerary the distance of its probability at dt from that
        of exact flights; NaN where noise hides it.  The 95 % intervals are for each row by itself.
    """

    table: pd.DataFrame
    changes: pd.DataFrame


def orders_over(scene: Scene, sigmas: Sequence[float], **settings: int) -> Orders:
    """Weak orders at several noise intensities.

    Parameters
    ----------
    scene : Scene
        What is modelled.
    sigmas : sequence of float
        Noise intensities.
    **settings
        Of `weak_orders`.

    Returns
    -------
    Orders
    """
    found = [weak_orders(scene.with_sigma(sigma), **settings) for sigma in sigmas]
    return Orders(pd.concat([one.table for one in found]), pd.concat([one.changes for one in found]))


def order_from(bias: Floats, se: Floats, steps: Sequence[float]) -> tuple[float, float, float, float]:
    """Slope of log(change) over log(step) with its jackknife interval, and the last change.

    The change at a step is the root mean square over the rows of the replicates' mean, corrected for the variance of
    its measurement; NaN where that exceeds it.

    Parameters
    ----------
    bias, se : ndarray, shape (replicates, steps, rows)
        Change between a step and its half in each row (moment), and its standard error.
    steps : sequence of float
        Descending.

    Returns
    -------
    order, low, high : float
        Slope and its 95 % interval.
    last : float
        Change at the last step.

    Examples
    --------
    >>> steps = np.array([4.0, 2.0, 1.0])
    >>> bias = steps[:, None] * np.array([[[1.0, 0.5]], [[1.01, 0.5]], [[1.0, 0.49]]])
    >>> order, low, high, last = order_from(bias, np.zeros_like(bias), steps)
    >>> round(order, 6), round(last, 2)
    (1.0, 0.79)
    """
    x = np.log(np.asarray(steps))
    n = len(bias)

    def slope(chosen: Floats) -> float:
        y = np.log(_sizes(bias, se, chosen))
        return float(((x - x.mean()) * y).sum() / ((x - x.mean()) ** 2).sum())

    order = slope(np.ones(n))
    half = float(_half(np.array([slope(1.0 - np.eye(n)[r]) for r in range(n)])))
    return order, order - half, order + half, float(_sizes(bias, se, np.ones(n))[-1])


def changes_from(bias: Floats, se: Floats) -> tuple[Floats, Floats, Floats]:
    """Size of the change at each step with its jackknife interval, which is symmetric in the logarithm.

    Parameters
    ----------
    bias, se : ndarray, shape (replicates, steps, rows)
        As of `order_from`.

    Returns
    -------
    change, low, high : ndarray, shape (steps,)

    Examples
    --------
    >>> bias = np.array([[[1.0, 1.0]], [[1.1, 0.9]], [[0.9, 1.1]]])
    >>> change, low, high = changes_from(bias, np.zeros_like(bias))
    >>> change.tolist(), bool(low[0] < 1.0 < high[0])
    ([1.0], True)
    """
    n = len(bias)
    change = _sizes(bias, se, np.ones(n))
    half = _half(np.log([_sizes(bias, se, 1.0 - np.eye(n)[r]) for r in range(n)]))
    return change, change * np.exp(-half), change * np.exp(half)


def _sizes(bias: Floats, se: Floats, chosen: Floats) -> Floats:
    weight = chosen / chosen.sum()
    mean = np.einsum("r,rsi->si", weight, bias)
    noise = np.einsum("r,rsi->si", weight**2, se**2)
    square = (mean**2 - noise).mean(axis=1)
    return np.sqrt(np.where(square > 0.0, square, np.nan))


def _half(without: Floats) -> Floats:
    """Half width of the jackknife interval, from the values without each replicate, shape (replicates, ...)."""
    n = len(without)
    return np.asarray(float(stdtrit(n - 1, 0.5 + 0.5 * CONFIDENCE)) * np.sqrt((n - 1) * without.var(axis=0)))


def _rows(run: Ensemble, moment: str) -> pd.DataFrame:
    """Step bias of the moments of one kind, in units of the quantities' sds."""
    unit = units(run)
    bias = run.step_bias
    bias = bias[bias["moment"] == moment]
    scale = np.array([unit.at[k, q] for k, q in zip(bias["impact"], bias["quantity"], strict=True)])
    shares = bias[["bias", "se_bias"]].div(scale, axis=0)
    return bias.assign(bias=shares["bias"], se_bias=shares["se_bias"])


def _limit_z(run: Ensemble, exact: Ensemble, moment: str) -> tuple[float, int]:
    """Largest difference of the extrapolated value from exact flights in standard errors, and the number compared."""
    rows = run.step_bias[run.step_bias["moment"] == moment]
    names = [q if moment == "mean" else "sd_" + q for q in rows["quantity"]]
    impacts = rows["impact"].tolist()
    value, se = (
        np.array([exact.section.at[k, prefix + name] for k, name in zip(impacts, names, strict=True)])
        for prefix in ("", "se_")
    )
    away = np.maximum(np.abs(rows["corrected"].to_numpy() - value) - rows["rest"].to_numpy(), 0.0)
    error = np.hypot(rows["se_corrected"].to_numpy(), se)
    varies = error > STILL
    return float((away[varies] / error[varies]).max()), int(varies.sum())


def weak_orders(
    scene: Scene,
    *,
    impacts: int = ORDER_IMPACTS,
    paths: int = 40_000,
    replicates: int = 6,
    rng: int = 0,
    workers: int = 2,
) -> Orders:
    """Measure the weak order of every scheme with a step bias.

    It is measured for the means and the sds on the Poincaré section at the impacts, and for the probability of the
    noise-free itinerary.

    Parameters
    ----------
    scene : Scene
        What is modelled.
    impacts : int
        Number of impacts.
    paths : int
        Paths of each replicate at each step.
    replicates : int
        Independent repetitions for the jackknife intervals, at least 2.
    rng : int
        Seed.
    workers : int
        Threads.

    Returns
    -------
    Orders

    Raises
    ------
    InputError
        For fewer than 2 replicates, or settings that cannot be simulated.
    """
    count("replicates", replicates, least=2)
    seeds = np.random.SeedSequence(rng).spawn(replicates + 1)
    sample = partial(simulate, scene.phase_reduced, impacts=impacts, workers=workers)
    exact = sample(paths=paths * replicates, scheme="exact-flight", rng=seeds[-1])
    kept = float(exact.agreement["noise-free"].iloc[-1])
    found, changes = [], []
    schemes = [name for name, kind in SCHEMES.items() if kind.has_step_bias]
    with tqdm(total=len(schemes) * replicates * len(STEPS), desc="weak order", unit="run", disable=None) as bar:
        for scheme in schemes:
            runs: list[list[Ensemble]] = []
            for seed in seeds[:-1]:
                runs.append([])
                for step in STEPS:
                    runs[-1].append(
                        sample(paths=paths, scheme=scheme, dt=0.5 * step, rng=seed, record=Record(step_bias=True))
                    )
                    bar.update()
            for moment in ("mean", "sd"):
                rows = [[_rows(run, moment) for run in row] for row in runs]
                bias, se = (np.array([[r[name] for r in row] for row in rows]) for name in ("bias", "se_bias"))
                order, low, high, last = order_from(bias, se, STEPS)
                changes += _points(scheme, scene.sigma, moment, *changes_from(bias, se))
                z, compared = zip(*(_limit_z(row[-1], exact, moment) for row in runs), strict=True)
                allowed = widest(sum(compared), 1.0 - CONFIDENCE)
                found.append(Order(scheme, scene.sigma, moment, order, low, high, last, max(z), allowed))
            shares = np.array([[float(run.agreement["noise-free"].iloc[-1]) for run in row] for row in runs])
            found.append(_itinerary_order(scheme, scene.sigma, shares, kept, paths * replicates))
            changes += _points(scheme, scene.sigma, "itinerary", *_itinerary_errors(shares, kept, paths * replicates))
    columns = ["scheme", "sigma", "moment", "dt", "change", "low", "high"]
    return Orders(pd.DataFrame(found), pd.DataFrame(changes, columns=columns))


def _points(scheme: str, sigma: float, moment: str, change: Floats, low: Floats, high: Floats) -> list[tuple[Any, ...]]:
    steps = [0.5 * step if moment == "itinerary" else step for step in STEPS]
    return [(scheme, sigma, moment, *row) for row in zip(steps, change, low, high, strict=True)]


def _itinerary_errors(shares: Floats, kept: float, paths: int) -> tuple[Floats, Floats, Floats]:
    """Distance of the itinerary's probability from that of exact flights at each step, and its interval."""
    distance = np.abs(shares.mean(axis=0) - kept)
    spread = shares.std(axis=0, ddof=1) / math.sqrt(len(shares))
    half = widest(1, 1.0 - CONFIDENCE) * np.hypot(spread, math.sqrt(kept * (1.0 - kept) / paths))
    return np.where(distance > half, distance, np.nan), np.maximum(distance - half, 0.0), distance + half


def _itinerary_order(scheme: str, sigma: float, shares: Floats, kept: float, paths: int) -> Order:
    """Order of the itinerary's probability, whose bias is taken against exact flights; NaN where noise hides it."""
    means, spread = shares.mean(axis=0), shares.std(axis=0, ddof=1) / math.sqrt(len(shares))
    floor = math.sqrt(max(kept * (1.0 - kept), 1e-300) / paths)
    bias = means - kept
    seen = np.abs(bias) > 3.0 * np.hypot(spread, floor)
    steps = 0.5 * np.array(STEPS)
    order, low, high = math.nan, math.nan, math.nan
    if seen.sum() >= 2:
        distance = (shares - kept)[:, seen, None]
        order, low, high, _ = order_from(distance, np.zeros_like(distance), tuple(steps[seen]))
    last = 2.0 * means[-1] - means[-2]  # Richardson extrapolation from the two smallest steps
    error = math.hypot(math.hypot(2.0 * spread[-1], spread[-2]), floor)
    away = abs(float(last) - kept) / max(error, 1e-300)
    allowed = widest(1, 1.0 - CONFIDENCE)
    return Order(scheme, sigma, "itinerary", order, low, high, abs(float(bias[-1])), away, allowed)
