"""Growth rates of small distances, with their intervals: Lyapunov exponents, and two paths on the
same noise.

Growth rates are ratios of sums over a long record (log growth over time); their intervals come from
batch means.  Two paths on the same noise that reach a wall delta apart leave it about sqrt(delta)
apart (docs/model.md section 8).
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.special import ndtri

from rattle.compare.chaos.record import NoRecord, Regime, in_threads, noisy_record, orbit_record
from rattle.montecarlo.coupling.paths import after_impact, growths
from rattle.montecarlo.statistics.intervals import CONFIDENCE, half_width
from rattle.scene import Floats, InputError, Ints, Scene, count
from rattle.scene.impact import falloff_derivatives
from rattle.scene.long_orbit import struck_speeds
from rattle.scene.tangent import Stretch

ORBIT = "orbit"
NOISY_PATH = "drift's linearisation along a noisy path"
GROWTH_BATCHES = 32
GROWTH_BLOCK = 128  # consecutive impacts whose growths are summed before they enter the batches
DEFAULT_RECORD = 100_000  # impacts of a record without a required width
# impacts of a record with one: the first attempt, and the longest
FIRST_RECORD = 40_000
LONGEST_RECORD = 2_000_000
ENDLESS_RECORD = 10 * LONGEST_RECORD  # more than is ever read
# below this share of effectively independent batches a record is taken to contain a transient
LEAST_EFFECTIVE_SHARE = 0.4
# error of the exponents' sum above which their growth is taken to be lost in rounding
LOST_IN_ROUNDING = 1e-3
AIM_OF_WIDTH = 0.9  # a record is lengthened so as to reach this fraction of the required width
# default range of delta
SMALLEST_DELTA = 1e-7
LARGEST_DELTA = 1e-3
DISTANCES = 7
DELTAS = tuple(float(d) for d in np.geomspace(1e-7, 1e-1, 13))  # of the finite-size exponent
# impacts with a smaller |modulation| of the noise are left out: the drift outweighs the noise there
MODULATED = 0.2


class Mean(NamedTuple):
    """A ratio of sums with its interval."""

    value: float  # value, half: the ratio, and the half width of its 95 % interval
    half: float
    effective: float  # effective number of independent batches


def ratio_mean(top: Floats, bottom: Floats) -> Mean:
    """Compute ``sum(top) / sum(bottom)`` of a time series, with an interval from batch means.

    The residuals ``top - ratio bottom`` of the batches are taken as normal.  If neighbouring
    batches are positively correlated (coefficient r), the variance is multiplied by ``(1 + r) / (1
    - r)``.

    Entries beyond the last full batch are left out. Shapes: `top`, `bottom` (entries,).
    """
    size = top.size // GROWTH_BATCHES
    t, b = (
        a[: GROWTH_BATCHES * size].reshape(GROWTH_BATCHES, size).sum(axis=1) for a in (top, bottom)
    )
    value = float(t.sum() / b.sum())
    residual = t - value * b
    spread = float((residual**2).sum())
    # autocorrelation
    lag1 = float((residual[1:] * residual[:-1]).sum()) / spread if spread > 0.0 else 0.0
    widening = (1.0 + max(lag1, 0.0)) / (1.0 - max(lag1, 0.0))
    se = math.sqrt(spread * GROWTH_BATCHES / (GROWTH_BATCHES - 1) * widening) / float(b.sum())
    return Mean(value, float(half_width(GROWTH_BATCHES)) * se, GROWTH_BATCHES / widening)


@dataclass(frozen=True)
class Exponents:
    """Lyapunov exponents, per unit of dimensionless time, from the largest to the smallest."""

    of: str  # the linearised system: `ORBIT` or `NOISY_PATH`
    # value, half: exponents and half widths of their 95 % intervals; NaN without a record; (2
    # wheels,)
    value: Floats
    half: Floats
    rate: float  # impacts per unit of time at all meshes together
    # sum of the exponents less its exact value, the logarithm of the determinant of each impact (2
    # ln epsilon) over the time less all beta, on the same record; nothing but rounding
    sum_error: float
    impacts: int  # impacts of the record
    time: float  # duration of the record
    # effective number of independent batches, of 32, in the interval of the largest exponent
    effective: float
    regime: Regime  # what the orbit or path did

    @property
    def largest(self) -> tuple[float, float, float]:
        """Largest exponent, and lower and upper end of its 95 % interval."""
        value = float(self.value[0])
        half = float(self.half[0])
        return value, value - half, value + half

    @property
    def width(self) -> float:
        """Width of the interval of the largest exponent."""
        return 2.0 * float(self.half[0])

    @property
    def table(self) -> pd.DataFrame:
        """One row per exponent: ``of, exponent, value, low, high, rate, sum_error, impacts, time,
        regime, reason``."""
        return pd.DataFrame(
            {
                "of": self.of,
                "exponent": np.arange(1, self.value.size + 1),
                "value": self.value,
                "low": self.value - self.half,
                "high": self.value + self.half,
                "rate": self.rate,
                "sum_error": self.sum_error,
                "impacts": self.impacts,
                "time": self.time,
                "regime": self.regime.kind,
                "reason": self.regime.reason,
            }
        )

    def impacts_for(self, width: float) -> int:
        """Estimate the impacts that a given width of the largest exponent's interval takes."""
        need = self.impacts * (self.width / (AIM_OF_WIDTH * width)) ** 2
        unit = 10.0 ** max(math.floor(math.log10(need)) - 1, 0)
        return int(math.ceil(need / unit) * unit)


def _returned(scene: Scene, mesh: Ints, speed: Floats) -> Floats:
    """Restitution at impact speeds w, and the derivative of ``epsilon(w) w`` there.

    Shapes: `mesh`, `speed` (impacts,); result (2, impacts).
    """
    c = scene.constants
    returned = np.tile(c.wheels["epsilon"][mesh - 1], (2, 1))
    if c.wheels["slowing"].any():
        for k, (m, w) in enumerate(zip(mesh.tolist(), speed.tolist(), strict=True)):
            left, first, _ = falloff_derivatives(c, m - 1, w)
            returned[:, k] *= left, left + first * abs(w)
    return returned


def _blocks(scene: Scene, s: Stretch) -> Floats:
    """Sums over `GROWTH_BLOCK` impacts each (the last block may have fewer): time, number of
    impacts, the exact logarithm of their determinants, log growths."""
    starts = np.arange(0, s.flight.size, GROWTH_BLOCK)
    mesh = np.abs(s.code)
    shrinking = np.log(np.abs(_returned(scene, mesh, struck_speeds(mesh, s.before)))).sum(axis=0)
    columns = np.column_stack([s.flight, np.ones(s.flight.size), shrinking, s.growth])
    return np.add.reduceat(columns, starts, axis=0)


def _exponents(of: str, scene: Scene, blocks: Floats, regime: Regime) -> Exponents:
    """Exponents of a record by blocks; NaN without one, and where their sum shows that growth is
    lost in rounding."""
    times, numbers, shrinking = blocks[:, :3].T
    growths = blocks[:, 3:]
    time = float(times.sum())
    impacts = int(numbers.sum())
    if len(blocks) >= 2 * GROWTH_BATCHES and regime.has_record:
        exact_sum = float(shrinking.sum()) / time - float(scene.constants.wheels["beta"].sum())
        sum_error = float(growths.sum() / time - exact_sum)
        if abs(sum_error) < LOST_IN_ROUNDING:
            means = sorted((ratio_mean(growth, times) for growth in growths.T), reverse=True)
            value, half, effective = np.array(means).T
            rate = ratio_mean(numbers, times).value
            return Exponents(
                of, value, half, rate, sum_error, impacts, time, float(effective[0]), regime
            )
        regime.give_up()
    nothing = np.full(2 * scene.stages, np.nan)
    return Exponents(of, nothing, nothing, np.nan, np.nan, impacts, time, 0.0, regime)


def _measure(
    of: str,
    scene: Scene,
    stretches: Iterable[Stretch],
    regime: Regime,
    impacts: int | None,
    width: float | None,
    longest: int,
) -> Exponents:
    """Exponents of a record that is lengthened until it has `impacts`, or its interval is no wider
    than `width`."""
    if not scene.constants.wheels["epsilon"].all():
        why = "exponents need epsilon > 0: the Jacobian of an impact without rebound is singular"
        raise InputError("epsilon", 0.0, why)
    least = 2 * GROWTH_BATCHES * GROWTH_BLOCK
    if impacts is not None:
        count("impacts", impacts, least=least, most=LONGEST_RECORD)
    target = impacts or min(DEFAULT_RECORD if width is None else FIRST_RECORD, longest)
    blocks = np.empty((0, 3 + 2 * scene.stages))
    done = 0
    for s in stretches:
        s = s.first(target - done)
        blocks = np.concatenate([blocks, _blocks(scene, s)])
        done += s.flight.size
        if done < target:
            continue
        exponents = _exponents(of, scene, blocks, regime)
        if (
            width is None
            or exponents.width <= width
            or not regime.has_record
            or regime.computed > longest
        ):
            return exponents
        # strongly correlated batches: the first half may be a transient
        if exponents.effective < LEAST_EFFECTIVE_SHARE * GROWTH_BATCHES:
            early, blocks = np.split(blocks, [len(blocks) // 2])
            transient = int(early[:, 1].sum())
            regime.transient += transient
            done -= transient
        else:
            target = max(exponents.impacts_for(width), target + least)
        target = min(target, longest)
    return _exponents(of, scene, blocks, regime)


def signs(rows: pd.DataFrame) -> Ints:
    """Determine the sign of the largest exponent in each row, at 95 % simultaneous coverage
    (Bonferroni).

    Returns: 1 or -1; 0 if the widened interval contains zero, or there is none. Shapes: result
    (rows,).
    """
    wider = ndtri(0.5 * (1.0 - CONFIDENCE) / len(rows)) / ndtri(0.5 * (1.0 - CONFIDENCE))
    middle = 0.5 * (rows["high"] + rows["low"])
    half = 0.5 * wider * (rows["high"] - rows["low"])
    return np.where(middle - half > 0.0, 1, np.where(middle + half < 0.0, -1, 0))


def crossings(table: pd.DataFrame, field: str = "alpha", of: str = ORBIT) -> pd.DataFrame:
    """Find where the largest exponent changes its sign along a sweep.

    A change is bracketed by the last value of the field with one sign and the first with the other
    (see `signs`). Values between whose sign is undecided, or at which the orbit has no exponents,
    make the bracket wider.

    Returns: Columns: ``of, low, high`` (bracket of the field's value), ``to`` (+1: becomes
    positive, -1: negative) and ``undecided`` (number of values inside the bracket).
    """
    rows = table[table["of"] == of].sort_values(field)
    sign = signs(rows)
    x = rows[field].to_numpy()
    changes = [(a, b) for a, b in pairwise(np.flatnonzero(sign)) if sign[a] != sign[b]]
    marked = [(of, x[a], x[b], int(sign[b]), int(b - a - 1)) for a, b in changes]
    return pd.DataFrame(marked, columns=["of", "low", "high", "to", "undecided"])


def say_crossings(table: pd.DataFrame, field: str, of: str) -> str:
    """Where the largest exponent changes its sign, in words."""
    changes = crossings(table, field, of).to_dict("records")
    where = [
        f"{'+' if c['to'] > 0 else '-'} between {c['low']:.3g} and {c['high']:.3g}" for c in changes
    ]
    return "; ".join(where) or "none"


def lyapunov(
    scene: Scene,
    *,
    impacts: int | None = None,
    width: float | None = None,
    longest: int = LONGEST_RECORD,
) -> Exponents:
    """Compute all Lyapunov exponents of the noise-free orbit of a scene.

    By the QR method with orthonormal frames (Benettin et al. 1980), with the exact Jacobian of each
    flight and the saltation matrix of each impact.

    `impacts`: Length of the record without transients; 100 000 by default, or what the `width` of
    the largest exponent's interval takes, `longest` at the most. Returns: NaN if the orbit sticks
    often or for good, has no further impact, or brings neighbours together faster than double
    precision resolves; `regime` gives the reason.
    """
    regime = Regime()
    record = orbit_record(scene, ENDLESS_RECORD, regime)
    return _measure(ORBIT, scene, record, regime, impacts, width, longest)


def drift_exponents(
    scene: Scene,
    *,
    impacts: int | None = None,
    width: float | None = None,
    longest: int = LONGEST_RECORD,
    seed: int = 0,
) -> Exponents:
    """Compute the exponents of the drift's linearisation along a noisy path
    (`rattle.montecarlo.coupling.paths`).

    These are not Lyapunov exponents of the noisy system, which has none (docs/model.md section 8).
    Tangent vectors along the noisy path are propagated by the Jacobian of the flight and by the
    saltation matrix of the drift.

    `impacts`: Length of the record without transients; 100 000 by default, or what the `width` of
    the largest exponent's interval takes, `longest` at the most. Returns: NaN if gaps are random,
    or the path sticks too often; `regime` gives the reason.
    """
    regime = Regime()
    record = (s for s, _ in noisy_record(scene, seed, regime, impacts=ENDLESS_RECORD))
    return _measure(NOISY_PATH, scene, record, regime, impacts, width, longest)


class SqrtLaw(NamedTuple):
    """The measured square-root law."""

    # for each ``delta``: ``apart`` (root mean square of the difference of y1 after the impact),
    # ``ratio`` (its mean square over that of the law; 1 if the law holds), ``low, high`` (95 %
    # interval of the ratio), ``impacts`` and ``law`` (root mean square by the law)
    table: pd.DataFrame
    # exponent, low, high: power of delta to which the difference is proportional, and its 95 %
    # interval
    exponent: float
    low: float
    high: float


def _half_width(sample: Floats) -> Any:
    """Half width of the 95 % interval of the mean of independent values."""
    n = len(sample)
    return float(half_width(n)) * sample.std(axis=0, ddof=1) / n**0.5


def fit(deltas: Floats, apart: Floats) -> tuple[float, float, float]:
    """Fit the exponent of a power law ``|apart| ~ delta^p`` as the mean of the log-log slopes of
    all events.

    Shapes: `deltas` (deltas,); `apart` (events, deltas).
    """
    slopes = np.polyfit(np.log(deltas), np.log(np.abs(apart)).T, 1)[0]
    value = float(slopes.mean())
    half = float(_half_width(slopes))
    return value, value - half, value + half


def sqrt_law(scene: Scene, *, impacts: int = 4000, seed: int = 0) -> SqrtLaw:
    """Measure exponent and prefactor of the square-root law, at impacts at mesh 1 of a long path.

    The distances before the impact are 7 from 1e-7 to ``1e-3 min(1, sigma^2)``, below the range of
    the drift.

    `scene`: With a noise intensity of at least 0.03.  The drift alone separates the paths by about
    ``delta /
    |y|``, which outweighs weaker noise at all distances that the Brownian tree resolves.
    """
    largest = LARGEST_DELTA * min(1.0, scene.sigma**2)
    if largest < 9.0 * SMALLEST_DELTA:
        raise InputError(
            "sigma",
            scene.sigma,
            "is too weak for the square-root law to be seen: give 0.03 or more",
        )
    deltas = np.geomspace(SMALLEST_DELTA, largest, DISTANCES)
    apart, place, _ = after_impact(scene, deltas, impacts, seed)
    modulated = np.abs(place[:, 2]) > MODULATED
    apart = apart[modulated]
    if len(apart) < 100:
        raise NoRecord(
            f"only {len(apart)} impacts at mesh 1 are fast enough, and at a phase that has noise"
        )
    speed, modulation = place[modulated, 1:, None].swapaxes(0, 1)
    slope = _returned(scene, np.ones(len(apart), np.int64), speed[:, 0])[1, :, None]
    law = (1.0 + slope) * scene.sigma * np.abs(modulation) * np.sqrt(deltas / speed)
    square = (apart / law) ** 2
    ratio = square.mean(axis=0)
    half = _half_width(square)
    table = {
        "delta": deltas,
        "apart": np.sqrt((apart**2).mean(axis=0)),
        "ratio": ratio,
        "low": ratio - half,
        "high": ratio + half,
        "impacts": len(square),
        "law": np.sqrt((law**2).mean(axis=0)),
    }
    return SqrtLaw(pd.DataFrame(table), *fit(deltas, apart))


def finite_size(
    scene: Scene,
    *,
    deltas: tuple[float, ...] = DELTAS,
    events: int = 4000,
    seed: int = 0,
    workers: int = 2,
) -> pd.DataFrame:
    """Measure the finite-size exponent ``lambda(delta) = E[ln(end / delta)] / E[time]`` of two
    paths on the same noise.

    ``time`` is the time in which the distance grows from `delta` to at least twice `delta`, and
    ``end`` is the distance reached, since an impact overshoots (Aurell et al. 1997; Cencini and
    Vulpiani 2013).  Without noise the exponent tends to the largest Lyapunov exponent as delta
    decreases; with noise it grows without bound, because of the square-root law.

    Returns: Columns: ``delta, exponent, low, high`` (95 % interval), ``time`` and ``growth`` (means
    of the time and of ``ln(end / delta)``), ``events``.
    """

    def at(delta: float) -> tuple[float, ...]:
        duration, growth = growths(scene, delta, events, seed)
        m = ratio_mean(growth, duration)
        low = m.value - m.half
        high = m.value + m.half
        return delta, m.value, low, high, duration.mean(), growth.mean(), growth.size

    columns = ["delta", "exponent", "low", "high", "time", "growth", "events"]
    return pd.DataFrame(in_threads(workers, at, deltas), columns=columns)
