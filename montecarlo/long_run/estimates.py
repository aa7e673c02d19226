"""Estimates of stationary quantities from the sums of independent paths, with standard errors and autocorrelations.

Every estimate is a function of sums over all paths.  Its standard error is that of the jackknife over paths: paths are
independent, so it is right however long the memory of a path is.  Means are taken from sums that are corrected by what
is known of the noise (`rattle.montecarlo.long_run.control`), quantiles from counts as they are.

The **autocorrelation** of a quantity is a property of the motion: the variance of its plain estimate over the variance
that it would have if successive impacts were independent, the integrated autocorrelation time in impacts.  Above 1 an
error computed as if impacts were independent is too small, below 1 too large (the energy lost in a period is, since
what one impact leaves the next ones lose).
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.long_run.collected import Collected
from rattle.montecarlo.long_run.control import control
from rattle.montecarlo.long_run.intervals import Spread, half_width, spread
from rattle.montecarlo.long_run.names import NAMES, QUANTILES, groups
from rattle.montecarlo.long_run.sums import CONTACT, ENERGY, FLIGHT, NUMBER, SLOW, SPEED

Floats = NDArray[np.float64]


class StationaryEstimate(NamedTuple):
    """An estimate with its errors."""

    value: float  # value, se: estimate and standard error from the variation between paths
    se: float
    low: float  # low, high: 95 % interval
    high: float
    autocorrelation: float  # integrated autocorrelation time in impacts; NaN where nothing varies
    se_batches: float = math.nan  # standard error from batch means; NaN for what is not summed in batches
    # paths that the standard error rests on, see `rattle.montecarlo.long_run.intervals.count_effective_paths`; for
    # quantiles, units of the distributions
    effective_paths: float = math.nan


def _jackknife(sums: Floats, function: Callable[[Floats], Floats]) -> Spread:
    """A function of sums over paths, shape (paths, sums), with its spread over paths."""
    total, n = sums.sum(axis=0), len(sums)
    value = float(function(total[None])[0])
    return spread(n * value - (n - 1) * function(total - sums), value)


def _within(least: float, e: StationaryEstimate, most: float) -> StationaryEstimate:
    """An estimate whose interval ends where its quantity does."""
    return e._replace(low=max(e.low, least), high=min(e.high, most))


def _over(a: float, b: float) -> float:
    return a / b if b > 0.0 else math.nan


class _Maker:
    """Makes estimates from collected sums."""

    def __init__(self, c: Collected) -> None:
        self.c, self.main = c, c.main.sum(axis=1)

    def make(self, of: Spread, naive: float, batches: float = math.nan) -> StationaryEstimate:
        low, high = of.interval()
        return StationaryEstimate(of.value, of.se, low, high, _over(of.se**2, naive**2), batches, of.effective_paths)

    def _batch_se(self, a: Floats, bottom: int | None) -> float:
        """Standard error of a ratio of sums (or of a rate) from the spread of all batches of all paths."""
        batches = a.shape[1]
        b = np.full_like(a, self.c.time / batches) if bottom is None else self.c.main[:, :, bottom]
        if batches < 2 or b.sum() == 0.0:
            return math.nan
        rest = a - a.sum() / b.sum() * b
        rest = rest - rest.mean(axis=1, keepdims=True)  # within paths only
        return float(np.sqrt((rest**2).sum() * batches / (batches - 1))) / float(b.sum())

    def rate(self, g: int) -> StationaryEstimate:
        """Impacts per unit of time."""
        number = self.c.main[:, :, 4 * g + NUMBER]
        return self._per_time(number, g, float(number.sum()), self._raw(g, FLIGHT)[0])

    def rate_above(self, g: int) -> StationaryEstimate:
        """Impacts per unit of time that are not slow."""
        number = self.c.main[:, :, 4 * g + NUMBER] - self.c.main[:, :, 4 * g + SLOW]
        return self._per_time(number, g, float(number.sum()), float(self.c.products[:, g, 2].sum()))

    def power(self, g: int, factor: float = 1.0) -> StationaryEstimate:
        """Energy lost per unit of time."""
        square, cross = self.c.products[:, g, :2].sum(axis=0)
        return self._per_time(self.c.main[:, :, 4 * g + ENERGY], g, float(square), float(cross), factor)

    def _per_time(self, sums: Floats, g: int, square: float, cross: float, factor: float = 1.0) -> StationaryEstimate:
        """A sum over impacts per unit of time, from its square and its product with the flight, summed over impacts."""
        whole = self.c.time * self.c.paths
        value = float(sums.sum()) / whole
        rest = square - 2.0 * value * cross + value**2 * self._raw(g, FLIGHT)[1]
        naive = math.sqrt(max(rest, 0.0)) / whole
        found = spread(factor * sums.sum(axis=1) / self.c.time)
        return self.make(found, factor * naive, factor * self._batch_se(sums, None))

    def _raw(self, g: int, i: int) -> tuple[float, float]:
        """Sums of a value and of its square."""
        m, r = self.c.power[:, g, i].sum(axis=0), self.c.scales
        a, s = float(r.centre[g, i]), float(r.scale[g, i])
        return float(a * m[0] + s * m[1]), float(a * a * m[0] + 2.0 * a * s * m[1] + s * s * m[2])

    def share(self, column: int, of: int) -> StationaryEstimate:
        """A number of impacts out of a number of impacts."""
        found = _jackknife(self.main[:, [column, of]], lambda s: s[:, 0] / s[:, 1])
        naive = math.sqrt(max(found.value * (1.0 - found.value), 0.0) / self.main[:, of].sum())
        return _within(0.0, self.make(found, naive, self._batch_se(self.c.main[:, :, column], of)), 1.0)

    def energy(self, g: int) -> StationaryEstimate:
        """Mean energy lost at an impact."""
        columns = [4 * g + ENERGY, 4 * g + NUMBER]
        found = _jackknife(self.main[:, columns], lambda s: s[:, 0] / s[:, 1])
        n, square = float(self.main[:, columns[1]].sum()), float(self.c.products[:, g, 0].sum())
        naive = math.sqrt(max(square / n - found.value**2, 0.0) / n)
        return self.make(found, naive, self._batch_se(self.c.main[:, :, columns[0]], columns[1]))

    def contact(self, mesh: int) -> StationaryEstimate:
        """Share of the time in which a mesh is closed; its autocorrelation in impacts."""
        c = self.c
        each = self.main[:, CONTACT + mesh - 1] / c.samples
        found = spread(each)
        apart = float(self.main[:, NUMBER].sum()) / (c.samples * c.paths)  # impacts between two samples
        naive = math.sqrt(max(found.value * (1.0 - found.value), 0.0) / (c.samples * c.paths) / max(apart, 1e-300))
        batches = self._batch_se(c.main[:, :, CONTACT + mesh - 1], None) * c.time / c.samples
        return _within(0.0, self.make(found, naive, batches), 1.0)

    def moments(self, g: int, i: int) -> Iterator[tuple[str, StationaryEstimate]]:
        """Mean, sd and skewness of flight or of a speed."""
        power, scale, centre = (
            self.c.power[:, g, i],
            float(self.c.scales.scale[g, i]),
            float(self.c.scales.centre[g, i]),
        )

        def standardise(s: Floats) -> tuple[Floats, Floats, Floats]:
            with np.errstate(invalid="ignore", divide="ignore"):
                m = s / s[:, :1]
                variance = np.maximum(m[:, 2] - m[:, 1] ** 2, 0.0)
                third = m[:, 3] - 3.0 * m[:, 1] * m[:, 2] + 2.0 * m[:, 1] * m[:, 1] ** 2
                return m[:, 1], np.sqrt(variance), third / (variance * np.sqrt(variance))

        m = power.sum(axis=0)
        mean, sd, skew = (float(a[0]) for a in standardise(m[None]))
        n = float(m[0])
        unit_powers = np.array([sd**k for k in range(POWER)])
        central = _central(m / n, mean) / unit_powers if sd > 0.0 else np.full(POWER, math.nan)
        influence = {
            "": (np.array([0.0, 1.0]), scale * sd),
            "sd_": (np.array([-0.5, 0.0, 0.5]), scale * sd),
            "skew_": (np.array([0.5 * skew, -3.0, -1.5 * skew, 1.0]), 1.0),
        }
        for k, (prefix, (polynomial, unit)) in enumerate(influence.items()):
            found = _jackknife(power, lambda s, k=k: standardise(s)[k])  # type: ignore[misc]
            factor = scale if k < 2 else 1.0
            square = sum(a * b * central[p + q] for p, a in enumerate(polynomial) for q, b in enumerate(polynomial))
            naive = unit * math.sqrt(max(square, 0.0) / n) if sd > 0.0 else math.nan
            batches = math.nan
            if (prefix, i) == ("", SPEED):
                batches = self._batch_se(self.c.main[:, :, 4 * g + SPEED], 4 * g + NUMBER)
            found = found._replace(value=found.value * factor + (centre if k == 0 else 0.0), se=found.se * factor)
            yield prefix, self.make(found, naive, batches)

    def quantiles(self, g: int, i: int) -> Iterator[tuple[str, StationaryEstimate]]:
        """Quantiles, with intervals by Woodruff's method: those of the probability, read off the distribution."""
        counts = self.c.histogram[:, g, i].astype(float)
        edges, n = self.c.scales.edges[g, i], counts.sum(axis=1)
        below = np.cumsum(counts, axis=1)[:, :-1]  # of each unit, below each edge
        whole = below.sum(axis=0) / n.sum()
        for percent in QUANTILES:
            p = 0.01 * percent
            value = _inverse(edges, whole, p)
            k = int(np.clip(np.searchsorted(whole, p), 0, edges.size - 1))
            part = spread((below[:, k] - whole[k] * n) / n.mean())
            half = float(half_width(part.effective_paths))
            low, high = (_inverse(edges, whole, p + x * part.se) for x in (-half, half))
            naive = math.sqrt(p * (1.0 - p) / float(n.sum()))
            yield (
                f"q{percent:02d}_",
                StationaryEstimate(
                    value,
                    0.5 * (high - low) / half,
                    low,
                    high,
                    _over(part.se**2, naive**2),
                    effective_paths=part.effective_paths,
                ),
            )


POWER = 7


def _central(raw: Floats, mean: float) -> Floats:
    """Central moments of orders 0 to 6 from raw ones."""
    return np.array([sum(math.comb(k, j) * raw[j] * (-mean) ** (k - j) for j in range(k + 1)) for k in range(POWER)])


def _inverse(edges: Floats, below: Floats, p: float) -> float:
    """The value below which a share p lies."""
    return float(np.interp(p, below, edges))


def estimates(c: Collected, names: tuple[str, ...] | None = None) -> dict[str, StationaryEstimate]:
    """All stationary quantities of a long run (dimensionless).

    Returns: ``rate_above`` (impacts per unit of time that are not slow) and ``speed_above``, ``rate`` and
    ``flight`` and ``speed`` of all impacts, with ``sd_``, ``skew_`` and ``q01_`` to ``q99_``, ``energy`` (mean
    loss of an impact), ``energy_per_period``, ``power`` (loss per unit of time), ``slow_share``, all of them also
    with ``_mesh1`` and ``_mesh2`` for two stages, and ``contact_share_mesh1``, ....
    """
    plain = _estimates(_Maker(c), names)
    less = control(c)
    if less is None:
        return plain
    better = _estimates(_Maker(less), names)
    return {name: better[name]._replace(autocorrelation=e.autocorrelation) for name, e in plain.items()}


def _estimates(made: _Maker, names: tuple[str, ...] | None) -> dict[str, StationaryEstimate]:
    """All quantities, or those that are wanted."""
    c, out = made.c, {}

    def is_wanted(*found: str) -> bool:
        return names is None or any(name in names for name in found)

    for g, suffix in groups(c.stages):
        if made.main[:, 4 * g].sum() == 0.0:
            continue
        at = 4 * g
        out["rate_above" + suffix], out["rate" + suffix] = made.rate_above(g), made.rate(g)
        for i in NAMES:
            name = NAMES[i] + suffix
            if not c.power[:, g, i, 0].any():
                continue
            if is_wanted(name, "sd_" + name, "skew_" + name):
                out |= {prefix + name: estimate for prefix, estimate in made.moments(g, i)}
            if is_wanted(*(f"q{percent:02d}_{name}" for percent in QUANTILES)):
                out |= {prefix + name: estimate for prefix, estimate in made.quantiles(g, i)}
        out["energy" + suffix] = made.energy(g)
        out["energy_per_period" + suffix] = made.power(g, 2.0 * math.pi)
        out["power" + suffix] = made.power(g)
        out["slow_share" + suffix] = made.share(at + SLOW, at + NUMBER)
    for mesh in range(1, c.stages + 1):
        out[f"contact_share_mesh{mesh}"] = made.contact(mesh)
    return out if names is None else {name: out[name] for name in names if name in out}
