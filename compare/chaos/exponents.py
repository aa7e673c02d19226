"""Lyapunov exponents of the orbit, and those of the drift's linearisation along a noisy path, with their intervals.

Growth rates are ratios of sums over a long record (log growth over time).  Their intervals come from batch means.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import stdtrit

from rattle.compare.chaos.record import Regime, noisy_record, orbit_record
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.tangent import Stretch
from rattle.scene.validate import count, positive

Floats = NDArray[np.float64]

ORBIT = "orbit"
DRIFT = "drift's linearisation along a noisy path"
BATCHES = 32
BLOCK = 128  # consecutive impacts whose growths are summed before they enter the batches
CONFIDENCE = 0.95
FIRST = 100_000  # impacts of a record without a required width
LEAST, MOST = 40_000, 2_000_000  # impacts of a record with one: the first attempt, and the longest
TOGETHER = 0.4  # below this share of effectively independent batches a record is taken to contain a transient
LOST = 1e-3  # error of the exponents' sum above which their growth is taken to be lost in rounding
SPARE = 0.9  # a record is lengthened so as to reach this fraction of the required width


class Mean(NamedTuple):
    """A ratio of sums with its interval."""

    value: float  # value, half: the ratio, and the half width of its 95 % interval
    half: float
    effective: float  # effective number of independent batches


def ratio_mean(top: Floats, bottom: Floats, batches: int = BATCHES) -> Mean:
    """Compute ``sum(top) / sum(bottom)`` of a time series, with an interval from batch means.

    The residuals ``top - ratio bottom`` of the batches are taken as normal.  If neighbouring batches are positively
    correlated (coefficient r), the variance is multiplied by ``(1 + r) / (1 - r)``.

    `batches`: Number of batches of equal length; entries beyond the last full batch are left out. Shapes: `top`,
    `bottom` (entries,).
    """
    size = top.size // batches
    if size < 2:
        raise InputError("record", top.size, f"is too short for an interval: at least {2 * batches} entries")
    cut = size * batches
    t, b = (a[:cut].reshape(batches, size).sum(axis=1) for a in (top, bottom))
    value = float(t.sum() / b.sum())
    residual = t - value * b
    spread = float((residual**2).sum())
    lag1 = float((residual[1:] * residual[:-1]).sum()) / spread if spread > 0.0 else 0.0  # autocorrelation
    widening = (1.0 + max(lag1, 0.0)) / (1.0 - max(lag1, 0.0))
    se = math.sqrt(spread * batches / (batches - 1) * widening) / float(b.sum())
    return Mean(value, float(stdtrit(batches - 1, 0.5 + 0.5 * CONFIDENCE)) * se, batches / widening)


@dataclass(frozen=True)
class Exponents:
    """Lyapunov exponents, per unit of dimensionless time, from the largest to the smallest."""

    of: str  # the linearised system: `ORBIT` or `DRIFT`
    value: Floats  # value, half: exponents and half widths of their 95 % intervals; NaN without a record; (2 stages,)
    half: Floats
    # rate, rate_half: impacts per unit of time at both meshes together, and the half width of its 95 % interval
    rate: float
    rate_half: float
    # sum of the exponents less its exact value ``-(beta1 + beta2) + rate 2 ln epsilon`` on the same record; nothing
    # but rounding
    sum_error: float
    impacts: int  # impacts of the record
    time: float  # duration of the record
    effective: float  # effective number of independent batches, of 32, in the interval of the largest exponent
    regime: Regime  # what the orbit or path did

    @property
    def largest(self) -> tuple[float, float, float]:
        """Largest exponent, and lower and upper end of its 95 % interval."""
        return float(self.value[0]), float(self.value[0] - self.half[0]), float(self.value[0] + self.half[0])

    @property
    def width(self) -> float:
        """Width of the interval of the largest exponent."""
        return 2.0 * float(self.half[0])

    @property
    def table(self) -> pd.DataFrame:
        """One row per exponent: ``of, exponent, value, low, high, rate, sum_error, impacts, time, regime, reason``."""
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
        need = self.impacts * (self.width / (SPARE * width)) ** 2
        unit = 10.0 ** max(math.floor(math.log10(need)) - 1, 0)
        return int(math.ceil(need / unit) * unit)


def _blocks(s: Stretch) -> Floats:
    """Sums over `BLOCK` impacts each (the last block may have fewer): log growths, time, number of impacts."""
    starts = np.arange(0, s.flight.size, BLOCK)
    columns = np.column_stack([s.growth, s.flight, np.ones(s.flight.size)])
    return np.asarray(np.add.reduceat(columns, starts, axis=0))


def _exponents(of: str, scene: Scene, blocks: list[Floats], regime: Regime) -> Exponents:
    """Exponents of a record; NaN without one, and where their sum shows that growth is lost in rounding."""
    b = np.concatenate([np.empty((0, 6)), *blocks])
    size = 2 * scene.stages
    time, impacts = float(b[:, 4].sum()), int(b[:, 5].sum())
    sum_error = np.nan
    if len(b) >= 2 * BATCHES and regime.has_record:
        c = scene.constants
        exact_sum = -(c.beta1 + c.beta2) + impacts / time * 2.0 * math.log(c.epsilon)
        sum_error = float(b[:, :size].sum() / time - exact_sum)
        if not abs(sum_error) < LOST:
            regime.gave_up = regime.sticking_steps > 0
            if not regime.gave_up:
                regime.unfollowed = "brings neighbours together faster than double precision resolves"
    if not abs(sum_error) < LOST:
        nothing = np.full(size, np.nan)
        return Exponents(of, nothing, nothing, np.nan, np.nan, np.nan, impacts, time, 0.0, regime)
    found = [ratio_mean(b[:, i], b[:, 4]) for i in range(size)]
    rate = ratio_mean(b[:, 5], b[:, 4])
    order = np.argsort([-m.value for m in found])
    ranked = [found[i] for i in order]
    return Exponents(
        of,
        np.array([m.value for m in ranked]),
        np.array([m.half for m in ranked]),
        rate.value,
        rate.half,
        sum_error,
        impacts,
        time,
        ranked[0].effective,
        regime,
    )


def _check(scene: Scene) -> None:
    if scene.epsilon == 0.0:
        raise InputError(
            "epsilon", 0.0, "exponents need epsilon > 0: the Jacobian of an impact without rebound is singular"
        )


def _measure(
    of: str,
    scene: Scene,
    stretches: Iterable[Stretch],
    regime: Regime,
    impacts: int | None,
    width: float | None,
) -> Exponents:
    """Exponents of a record that is lengthened until it has `impacts`, or its interval is no wider than `width`."""
    least = 2 * BATCHES * BLOCK
    target = (
        (FIRST if width is None else LEAST) if impacts is None else count("impacts", impacts, least=least, most=MOST)
    )
    if width is not None:
        positive("width", width)
    blocks: list[Floats] = []
    done = 0
    for s in stretches:
        kept = s.first(target - done)
        done += kept.flight.size
        if kept.flight.size:
            blocks += list(_blocks(kept)[:, None])
        if done < target:
            continue
        found = _exponents(of, scene, blocks, regime)
        if width is None or found.width <= width or not regime.has_record or regime.computed > MOST:
            return found
        if found.effective < TOGETHER * BATCHES:  # strongly correlated batches: the first half may be a transient
            half = len(blocks) // 2
            regime.transient += int(sum(b[0, 5] for b in blocks[:half]))
            done -= int(sum(b[0, 5] for b in blocks[:half]))
            blocks = blocks[half:]
        else:
            target = max(found.impacts_for(width), target + least)
        target = min(target, MOST)
    return _exponents(of, scene, blocks, regime)


def lyapunov(scene: Scene, *, impacts: int | None = None, width: float | None = None) -> Exponents:
    """Compute all Lyapunov exponents of the noise-free orbit of a scene.

    By the QR method with orthonormal frames (Benettin et al. 1980), with the exact Jacobian of each flight and the
    saltation matrix of each impact.

    `impacts`: Length of the record without transients; 100 000 by default, or what the `width` of
    the largest exponent's interval takes, if that is not too long. Returns: NaN if the orbit sticks often or for good,
    has no further impact, or brings neighbours together faster than double precision resolves; `regime` gives the
    reason.
    """
    _check(scene)
    regime = Regime()
    return _measure(ORBIT, scene, orbit_record(scene, 10 * MOST, regime), regime, impacts, width)


def drift_exponents(
    scene: Scene,
    *,
    impacts: int | None = None,
    width: float | None = None,
    seed: int = 0,
) -> Exponents:
    """Compute the exponents of the drift's linearisation along a noisy path (`rattle.montecarlo.coupling.long_path`).

    These are not Lyapunov exponents of the noisy system, which has none (docs/model.md section 8).  Tangent vectors
    along the noisy path are propagated by the Jacobian of the flight and by the saltation matrix of the drift.

    `impacts`: Length of the record without transients; 100 000 by default, or what the `width` of
    the largest exponent's interval takes, if that is not too long. Returns: NaN if gaps are random, or the path sticks
    too often; `regime` gives the reason.
    """
    _check(scene)
    regime = Regime()
    stretches = (s for s, _ in noisy_record(scene, 2**30, seed, regime))
    return _measure(DRIFT, scene, stretches, regime, impacts, width)
