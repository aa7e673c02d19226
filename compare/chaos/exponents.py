"""Lyapunov exponents of the orbit, and those of the drift's linearisation along a noisy path, with their intervals."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from rattle.compare.chaos.record import Regime, check_finite, noisy_record, orbit_record
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.tangent import Stretch
from rattle.scene.validate import count, positive

__all__ = [
    "DRIFT", "ORBIT", "Exponents", "Mean", "drift_exponents", "lyapunov", "ratio_mean",
]  # fmt: skip

Floats = NDArray[np.float64]

ORBIT = "orbit"
DRIFT = "drift's linearisation along a noisy path"
BATCHES = 32
BLOCK = 128  # impacts that are added up at once
CONFIDENCE = 0.95
FIRST, LEAST, MOST = 100_000, 40_000, 2_000_000  # impacts of a record: usual, first look at a width, longest
TOGETHER = 0.4  # share of the batches that must be independent: below, the record is not of one motion
SPARE = 0.9  # of the asked width at which a lengthened record aims


class Mean(NamedTuple):
    """A ratio of sums with its interval.

    Attributes
    ----------
    value, half : float
        The ratio, and half of its 95 % interval.
    effective : float
        Batches that are worth as much as these, were they independent.
    """

    value: float
    half: float
    effective: float


def ratio_mean(top: Floats, bottom: Floats, batches: int = BATCHES) -> Mean:
    """``sum(top) / sum(bottom)`` of a sequence in the order of time, with an interval from batch means.

    The sequence is cut in `batches` of equal numbers; their residuals ``top - ratio bottom`` are taken as normal, and
    the interval is widened by their correlation where neighbours go together.

    Raises
    ------
    InputError
        If there are fewer than two per batch.

    Examples
    --------
    >>> x = np.random.default_rng(1).normal(1.0, 1.0, 3200)
    >>> m = ratio_mean(x, np.ones(3200))
    >>> bool(abs(m.value - 1.0) < m.half), round(m.half, 2)
    (True, 0.04)
    """
    size = top.size // batches
    if size < 2:
        raise InputError("record", top.size, f"is too short for an interval: at least {2 * batches} entries")
    cut = size * batches
    t, b = (a[:cut].reshape(batches, size).sum(axis=1) for a in (top, bottom))
    value = float(t.sum() / b.sum())
    rest = t - value * b
    spread = float((rest**2).sum())
    together = float((rest[1:] * rest[:-1]).sum()) / spread if spread > 0.0 else 0.0
    widening = (1.0 + max(together, 0.0)) / (1.0 - max(together, 0.0))
    se = math.sqrt(spread * batches / (batches - 1) * widening) / float(b.sum())
    return Mean(value, float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, batches - 1)) * se, batches / widening)


@dataclass(frozen=True)
class Exponents:
    """Lyapunov exponents, per unit of dimensionless time, from the largest to the smallest.

    Attributes
    ----------
    of : str
        What they are the exponents of.
    value, half : ndarray, shape (2 stages,)
        Exponents and halves of their 95 % intervals; NaN where there is no record.
    rate, rate_half : float
        Impacts per unit of time at both meshes together.
    sum_error : float
        Sum of the exponents, less ``-(beta1 + beta2) + rate 2 ln epsilon`` on the same record: rounding alone.
    impacts : int
    time : float
        Length of the record.
    effective : float
        Independent batches behind the interval of the largest, of 32.
    regime : Regime
    """

    of: str
    value: Floats
    half: Floats
    rate: float
    rate_half: float
    sum_error: float
    impacts: int
    time: float
    effective: float
    regime: Regime

    @property
    def largest(self) -> tuple[float, float, float]:
        """Largest exponent and its interval."""
        return float(self.value[0]), float(self.value[0] - self.half[0]), float(self.value[0] + self.half[0])

    @property
    def width(self) -> float:
        """Width of the interval of the largest."""
        return 2.0 * float(self.half[0])

    @property
    def table(self) -> pd.DataFrame:
        """One row per exponent: ``of, exponent, value, low, high, rate, sum_error, impacts, time, regime, reason``."""
        return pd.DataFrame({
            "of": self.of, "exponent": np.arange(1, self.value.size + 1), "value": self.value,
            "low": self.value - self.half, "high": self.value + self.half, "rate": self.rate,
            "sum_error": self.sum_error, "impacts": self.impacts, "time": self.time, "regime": self.regime.kind,
            "reason": self.regime.reason,
        })  # fmt: skip

    def needed(self, width: float) -> int:
        """Impacts that an interval of the largest of this width takes, rounded up to two digits."""
        need = self.impacts * (self.width / (SPARE * width)) ** 2
        unit = 10.0 ** max(math.floor(math.log10(need)) - 1, 0)
        return int(math.ceil(need / unit) * unit)

    def require(self, width: float) -> "Exponents":
        """These exponents, if the interval of the largest is no wider than asked.

        Raises
        ------
        InputError
            Says how long the record must be.
        """
        if self.width > width:
            raise InputError(
                "impacts", self.impacts,
                f"is too short: the largest exponent's interval is {self.width:.2g} wide, and {width:g} needs about "
                f"{self.needed(width):,}",
            )  # fmt: skip
        return self


def _blocks(s: Stretch) -> Floats:
    """Sums over `BLOCK` impacts each (the last may have fewer): growth along the axes, time, number."""
    starts = np.arange(0, s.flight.size, BLOCK)
    columns = np.column_stack([s.growth, s.flight, np.ones(s.flight.size)])
    return np.asarray(np.add.reduceat(columns, starts, axis=0))


def _exponents(of: str, scene: Scene, blocks: list[Floats], regime: Regime) -> Exponents:
    b = check_finite(f"growth of the {of}, block", np.concatenate([np.empty((0, 6)), *blocks]))
    size = 2 * scene.stages
    time, impacts = float(b[:, 4].sum()), int(b[:, 5].sum())
    if len(b) < 2 * BATCHES or regime.kind in ("rests", "silent"):
        nothing = np.full(size, np.nan)
        return Exponents(of, nothing, nothing, np.nan, np.nan, np.nan, impacts, time, 0.0, regime)
    found = [ratio_mean(b[:, i], b[:, 4]) for i in range(size)]
    rate = ratio_mean(b[:, 5], b[:, 4])
    c = scene.constants
    law = -(c.beta1 + c.beta2) + impacts / time * 2.0 * math.log(c.epsilon)
    order = np.argsort([-m.value for m in found])
    ranked = [found[i] for i in order]
    return Exponents(
        of, np.array([m.value for m in ranked]), np.array([m.half for m in ranked]), rate.value, rate.half,
        float(b[:, :size].sum() / time - law), impacts, time, ranked[0].effective, regime,
    )  # fmt: skip


def _check(scene: Scene) -> None:
    if scene.epsilon == 0.0:
        raise InputError("epsilon", 0.0, "an impact without rebound ends every difference: exponents need epsilon > 0")


def _measured(
    of: str, scene: Scene, stretches: Iterable[Stretch], regime: Regime, impacts: int | None, width: float | None,
    strict: bool,
) -> Exponents:  # fmt: skip
    """Exponents of a record that goes on until it is as long as was asked, or as its interval asks."""
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
        if width is None or found.width <= width:
            return found
        if impacts is not None or regime.launched > MOST:
            return found.require(width) if strict else found
        if found.effective < TOGETHER * BATCHES:  # its parts differ: the first of them may have been a transient
            half = len(blocks) // 2
            regime.transient += int(sum(b[0, 5] for b in blocks[:half]))
            done -= int(sum(b[0, 5] for b in blocks[:half]))
            blocks = blocks[half:]
        else:
            target = max(found.needed(width), target + least)
        target = min(target, MOST)
    return _exponents(of, scene, blocks, regime)


def lyapunov(scene: Scene, *, impacts: int | None = None, width: float | None = None, strict: bool = True) -> Exponents:
    """All Lyapunov exponents of the orbit of a scene, its noise left out.

    By orthonormal frames (Benettin and others 1980), with the exact Jacobian of the flight and the saltation matrix of
    every impact.

    Parameters
    ----------
    scene : Scene
    impacts : int, optional
        Length of the record, transients not counted; 100 000, or what `width` takes, by default.
    width : float, optional
        Widest interval of the largest exponent that will do.
    strict : bool
        Whether an interval that stays wider is refused; else it is given as it is.

    Returns
    -------
    Exponents
        With NaN where the orbit rests or is silent, and the reason in `regime`.

    Raises
    ------
    InputError
        If `impacts`, or the most that are tried, are too few for `width`: says how many it takes.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> found = lyapunov(Scene.from_gears(DAT21), impacts=20_000)
    >>> bool(found.value[0] - found.half[0] > 0.0), abs(found.sum_error) < 1e-10
    (True, True)
    """
    _check(scene)

    regime = Regime()
    return _measured(ORBIT, scene, orbit_record(scene, 10 * MOST, regime), regime, impacts, width, strict)


def drift_exponents(
    scene: Scene, *, impacts: int | None = None, width: float | None = None, strict: bool = True, seed: int = 0,
    path: int = 0,
) -> Exponents:  # fmt: skip
    """Exponents of the drift's linearisation along a noisy path (`rattle.montecarlo.coupling.long_path`).

    These are not the Lyapunov exponents of the noisy system, which has none (docs/model.md section 8): along the noisy
    path, neighbours are carried by the Jacobian of the flight and by the saltation matrix with the drift's rates.

    Parameters
    ----------
    scene : Scene
        Without random tolerance.
    impacts : int, optional
        Length of the record, transients not counted; 100 000, or what `width` takes, by default.
    width : float, optional
        Widest interval of the largest exponent that will do.
    strict : bool
        Whether an interval that stays wider is refused; else it is given as it is.
    seed, path : int
        Which path.

    Raises
    ------
    InputError
        If `impacts`, or the most that are tried, are too few for `width`: says how many it takes.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> found = drift_exponents(Scene.from_gears(DAT21, sigma=0.1), impacts=20_000, seed=3)
    >>> abs(found.sum_error) < 1e-10
    True
    """
    _check(scene)

    regime = Regime()
    stretches = (s for s, _ in noisy_record(scene, 2**30, seed, regime, path=path))
    return _measured(DRIFT, scene, stretches, regime, impacts, width, strict)
