"""Estimates of stationary quantities from the sums of independent paths, with standard errors and
autocorrelations.

Every estimate is a function of sums over all paths, and its standard error that of the jackknife
over paths.  Sums are corrected by the control variates of `rattle.montecarlo.long_run.noise_work`,
whose exact mean is zero, with coefficients from all **other** paths, so that estimates stay
unbiased (Avramidis and Wilson 1993); quantiles are from counts as they are.
docs/guide/stationary.md explains them, and the autocorrelation.
"""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from rattle.montecarlo.long_run import sums as tally
from rattle.montecarlo.long_run.noise_work import CONTROLS
from rattle.montecarlo.long_run.sums import Sums
from rattle.montecarlo.statistics.intervals import Spread, half_width, spread
from rattle.montecarlo.statistics.section_statistics import undefined, variance_of
from rattle.scene import Floats, InputError
from rattle.scene.errors import LONGEST_QUOTE, nearest

QUANTILES = (1, 5, 50, 95, 99)
"""Percentages of the quantiles."""
LEAST_PATHS = 8 * CONTROLS
"""Paths below which the coefficients of the control variates would cost more than they save."""
NAMES = {tally.ABOVE: "speed_above", tally.FLIGHT: "flight", tally.OF_SPEED: "speed"}
"""Of what has a distribution, by its index there: the speed of impacts that are not slow, flight,
and speed."""


def groups(wheels: int) -> Iterator[tuple[int, str]]:
    """The groups of impacts of a scene with the suffixes of their names: all, and those at each
    mesh where there are several."""
    yield 0, ""
    for mesh in range(1, wheels + 1 if wheels > 1 else 1):
        yield mesh, f"_mesh{mesh}"


SPREADS = ("", "sd_", "skew_", *(f"q{percent:02d}_" for percent in QUANTILES))
GROUP_NAMES = (
    "rate_above",
    *(prefix + "speed_above" for prefix in SPREADS),
    "rms_speed_above",
    "rate",
    *(prefix + name for name in ("flight", "speed") for prefix in SPREADS),
    "rms_speed",
    "energy",
    "energy_per_period",
    "power",
    "slow_share",
)
"""Names of the quantities of a group, in the order of a table."""


def all_names(wheels: int) -> tuple[str, ...]:
    """Names of all quantities, in the order of a table."""
    meshes = range(1, wheels + 1)
    return (
        *(name + suffix for _, suffix in groups(wheels) for name in GROUP_NAMES),
        *(f"{name}_share_mesh{mesh}" for name in ("contact", "open") for mesh in meshes),
    )


def check_quantity(field: str, name: object, wheels: int) -> str:
    """Check for the name of a quantity; what is unlike any is told those of all impacts."""
    known = all_names(wheels)
    if isinstance(name, str) and name in known:
        return name
    remedy = nearest(str(name), known)
    if len(remedy) > LONGEST_QUOTE:
        remedy = f"{nearest('', GROUP_NAMES)}, and with _mesh1 to _mesh{wheels} those at a mesh"
    raise InputError(field, name, remedy)


def corrections(sums: Floats, controls: Floats) -> Floats:
    """Slopes of sums over controls of mean zero, for each path from all other paths.

    Shapes: `sums` (paths, sums); `controls` (paths, controls); result (paths, controls, sums).
    """
    scale = np.sqrt((controls**2).mean(axis=0))
    x = controls / np.where(scale > 0.0, scale, 1.0)
    others = len(x) - 1
    square = x.T @ x - x[:, :, None] * x[:, None, :]
    product = x.T @ sums - x[:, :, None] * sums[:, None, :]
    product -= (x.sum(axis=0) - x)[:, :, None] * ((sums.sum(axis=0) - sums) / others)[:, None, :]
    # controls that are constant, or multiples of each other
    square += 1e-12 * others * np.eye(x.shape[1])
    slopes = np.linalg.solve(square, product)
    return np.asarray(slopes / np.where(scale > 0.0, scale, np.inf)[None, :, None])


def control(c: Sums) -> Sums | None:
    """Sums of the impacts of each path, less the part that the noise's own work explains.

    Returns: None where the controls do not hold or do not pay: there is no noise, a mesh was closed
    for a while, so that what pushed a wheel was not the noise alone, or there are too few paths.
    """
    every = c.main[:, :, tally.NOISE : tally.NOISE + CONTROLS]
    controls = every.sum(axis=1)
    if (
        c.paths < LEAST_PATHS
        or not controls.any()
        or c.main[:, :, c.columns.contact : c.columns.open].any()
        or c.main[:, :, tally.LEFT_OUT + 1].any()
    ):
        return None
    main = c.main.copy()
    power = c.power.reshape(c.paths, -1)
    impacts = main[:, :, tally.NUMBER : c.columns.contact]
    impacts -= every @ corrections(impacts.sum(axis=1), controls)
    power = power - (controls[:, None, :] @ corrections(power, controls))[:, 0]
    return c._replace(main=main, power=power.reshape(c.power.shape))


class StationaryEstimate(NamedTuple):
    """An estimate with its errors."""

    value: float  # value, se: estimate and standard error from the variation between paths
    se: float
    low: float  # low, high: 95 % interval
    high: float
    autocorrelation: float  # integrated autocorrelation time in impacts; NaN where nothing varies
    # standard error from batch means; NaN for what is not summed in batches
    se_batches: float = math.nan
    # paths that the standard error rests on, see
    # `rattle.montecarlo.statistics.intervals.count_effective_paths`; for quantiles, units of the
    # distributions
    effective_paths: float = math.nan

    def widen(self, factor: float) -> "StationaryEstimate":
        """The same estimate with an interval and an error that are wider by a factor."""
        if factor == 1.0:
            return self
        low = self.value - factor * (self.value - self.low)
        high = self.value + factor * (self.high - self.value)
        return self._replace(se=factor * self.se, low=low, high=high)


Estimates = dict[str, StationaryEstimate]
"""Estimates by the names of their quantities."""


def _jackknife(sums: Floats, function: Callable[[Floats], Floats]) -> list[Spread]:
    """Functions of sums over paths, each with its spread over paths; NaN where a single path has
    all that one is of.

    Shapes: `sums` (paths, sums); of what the function returns (values, paths).
    """
    total = sums.sum(axis=0)
    n = len(sums)
    with undefined():
        whole = function(total[None])[:, 0].tolist()
        without = function(total - sums)
    without = np.where(np.isfinite(without), without, np.nan)
    return [
        spread(n * value - (n - 1) * rest, value)
        for value, rest in zip(whole, without, strict=True)
    ]


def most_unseen(time: float, tail: float = 0.05) -> float:
    """The rate that events of which none was seen in a time have at most, but for a probability
    `tail` (Poisson)."""
    return -math.log(tail) / time


def _root(square: float, n: float) -> float:
    """Standard error from a variance that rounding may have made negative."""
    return math.sqrt(max(square, 0.0) / n)


class _Maker:
    """Makes estimates from collected sums."""

    def __init__(self, c: Sums) -> None:
        self.c = c
        self.main = c.main.sum(axis=1)

    def _make(
        self,
        of: Spread,
        naive: float,
        batches: float = math.nan,
        least: float = -math.inf,
        most: float = math.inf,
    ) -> StationaryEstimate:
        """An estimate whose interval ends where its quantity does."""
        low, high = of.interval()
        ratio = of.se**2 / naive**2 if naive**2 > 0.0 else math.nan
        return StationaryEstimate(
            of.value, of.se, max(low, least), min(high, most), ratio, batches, of.effective_paths
        )

    def _batch_se(self, a: Floats, bottom: int | None) -> float:
        """Standard error of a ratio of sums (or of a rate) from the spread of all batches of all
        paths."""
        batches = a.shape[1]
        b = np.full_like(a, self.c.time / batches) if bottom is None else self.c.main[:, :, bottom]
        if batches < 2 or b.sum() == 0.0:
            return math.nan
        rest = a - a.sum() / b.sum() * b
        rest = rest - rest.mean(axis=1, keepdims=True)  # within paths only
        return float(np.sqrt((rest**2).sum() * batches / (batches - 1))) / float(b.sum())

    def _per_time(
        self, sums: Floats, g: int, square: float, cross: float, factor: float = 1.0
    ) -> StationaryEstimate:
        """A sum over impacts per unit of time, from its square and its product with the flight,
        summed over impacts."""
        whole = self.c.time * self.c.paths
        value = float(sums.sum()) / whole
        rest = square - 2.0 * value * cross + value**2 * self._flights(g)[1]
        naive = math.sqrt(max(rest, 0.0)) / whole
        rate = spread(factor * sums.sum(axis=1) / self.c.time)
        return self._make(rate, factor * naive, factor * self._batch_se(sums, None))

    def _flights(self, g: int) -> tuple[float, float]:
        """Sums of the flights of a group, and of their squares."""
        m = self.c.power[:, g, tally.FLIGHT].sum(axis=0)
        a = float(self.c.scales.centre[g, tally.FLIGHT])
        s = float(self.c.scales.scale[g, tally.FLIGHT])
        return float(a * m[0] + s * m[1]), float(a * a * m[0] + 2.0 * a * s * m[1] + s * s * m[2])

    def _ratio(self, top: int, bottom: int, square: float, *range_of: float) -> StationaryEstimate:
        """The mean over impacts of what a column sums, from the sum of its square; in a range."""
        (mean,) = _jackknife(self.main[:, [top, bottom]], lambda s: s[None, :, 0] / s[:, 1])
        n = float(self.main[:, bottom].sum())
        naive = _root(square / n - mean.value**2, n)
        batches = self._batch_se(self.c.main[:, :, top], bottom)
        return self._make(mean, naive, batches, *range_of)

    def impacts(self, g: int) -> Estimates:
        """Rates and energies of the impacts of a group, and the share of slow ones."""
        at_number, at_energy, at_slow = (
            4 * g + column for column in (tally.NUMBER, tally.ENERGY, tally.SLOW)
        )
        number = self.c.main[:, :, at_number]
        energy = self.c.main[:, :, at_energy]
        slow = self.c.main[:, :, at_slow]
        above = number - slow
        square, cross, flights_above = self.c.products[:, g].sum(axis=0).tolist()
        rates = {
            "rate_above": self._per_time(above, g, float(above.sum()), flights_above),
            "rate": self._per_time(number, g, float(number.sum()), self._flights(g)[0]),
        }
        watched = self.c.time * self.c.paths
        left_out = float(self.c.main[:, :, tally.LEFT_OUT + 2].sum())
        most = most_unseen(watched) + left_out / watched
        for name, rate in rates.items():
            if rate.value == rate.se == 0.0:
                rates[name] = rate._replace(high=most)
        return {
            **rates,
            "energy": self._ratio(at_energy, at_number, square),
            "energy_per_period": self._per_time(energy, g, square, cross, 2.0 * math.pi),
            "power": self._per_time(energy, g, square, cross),
            "slow_share": self._ratio(at_slow, at_number, float(slow.sum()), 0.0, 1.0),
        }

    def share(self, column: int) -> StationaryEstimate:
        """Share of the time in which a mesh is closed or open, from its column; its autocorrelation
        in impacts."""
        c = self.c
        part = spread(self.main[:, column] / c.samples)
        samples = c.samples * c.paths
        apart = float(self.main[:, tally.NUMBER].sum()) / samples  # impacts between two samples
        square = max(part.value * (1.0 - part.value), 0.0)
        naive = math.sqrt(square / samples / max(apart, 1e-300))
        batches = self._batch_se(c.main[:, :, column], None) * c.time / c.samples
        return self._make(part, naive, batches, 0.0, 1.0)

    def moments(self, g: int, i: int) -> Iterator[tuple[str, StationaryEstimate]]:
        """Mean, sd and skewness of flight or of a speed, and the root of its mean square of a
        speed."""
        power = self.c.power[:, g, i]
        scale = float(self.c.scales.scale[g, i])
        centre = float(self.c.scales.centre[g, i])

        def figures(s: Floats) -> Floats:
            """Mean, sd and skewness in units of the scale, and the root mean square."""
            with undefined():
                _, mean, second, third, *_ = (s / s[:, :1]).T
                variance = np.maximum(second - mean**2, 0.0)
                third = third - 3.0 * mean * second + 2.0 * mean * mean**2
                sd = np.sqrt(variance)
                rms = np.hypot(scale * mean + centre, scale * sd)
                return np.stack([mean, sd, third / (variance * sd), rms])

        raw = power.sum(axis=0)
        n = float(raw[0])
        mean, sd, skew, rms = figures(raw[None])[:, 0].tolist()
        unit = scale * sd
        # influence as a polynomial in the standardised value, in a unit; unit and origin of the
        # estimate
        influence = {
            "": ([0.0, 1.0], unit, scale, centre),
            "sd_": ([-0.5, 0.0, 0.5], unit, scale, 0.0),
            "skew_": ([0.5 * skew, -3.0, -1.5 * skew, 1.0], 1.0, 1.0, 0.0),
        }
        if i != tally.FLIGHT:
            slope = np.array([-unit, 2.0 * (scale * mean + centre), unit]) / (2.0 * rms)
            influence["rms_"] = slope.tolist(), unit, 1.0, 0.0
        figure_of = zip(influence.items(), _jackknife(power, figures), strict=False)
        for (prefix, (polynomial, unit_of, factor, origin)), figure in figure_of:
            naive = math.nan
            if sd > 0.0:
                standardised = _central(raw / n, mean) / [sd**k for k in range(raw.size)]
                naive = unit_of * _root(float(variance_of(polynomial, standardised)), n)
            batches = math.nan
            if (prefix, i) == ("", tally.OF_SPEED):
                speed = self.c.main[:, :, 4 * g + tally.SPEED]
                batches = self._batch_se(speed, 4 * g + tally.NUMBER)
            figure = figure._replace(value=figure.value * factor + origin, se=figure.se * factor)
            yield prefix, self._make(figure, naive, batches)

    def quantiles(self, g: int, i: int) -> Iterator[tuple[str, StationaryEstimate]]:
        """Quantiles, with intervals by Woodruff's method: those of the probability, read off the
        distribution."""
        counts = self.c.histogram[:, g, i].astype(float)
        edges = self.c.scales.edges[g, i]
        n = counts.sum(axis=1)
        below = np.cumsum(counts, axis=1)[:, :-1]  # of each unit, below each edge
        whole = below.sum(axis=0) / n.sum()
        for percent in QUANTILES:
            p = 0.01 * percent
            k = min(int(np.searchsorted(whole, p)), edges.size - 1)
            part = spread((below[:, k] - whole[k] * n) / n.mean())
            half = float(half_width(part.effective_paths))
            around = [p, p - half * part.se, p + half * part.se]
            value, low, high = np.interp(around, whole, edges).tolist()
            e = self._make(part._replace(value=value), _root(p * (1.0 - p), float(n.sum())))
            yield f"q{percent:02d}_", e._replace(se=0.5 * (high - low) / half, low=low, high=high)


def _central(raw: Floats, mean: float) -> Floats:
    """Central moments of orders 0 to 6 from raw ones."""
    return np.array(
        [
            sum(math.comb(k, j) * raw[j] * (-mean) ** (k - j) for j in range(k + 1))
            for k in range(len(raw))
        ]
    )


def estimates(c: Sums, names: tuple[str, ...] | None = None) -> Estimates:
    """All stationary quantities of a long run (dimensionless), or those that are wanted.

    Returns: ``rate_above`` (impacts per unit of time that are not slow) and ``speed_above``,
    ``rate`` and ``flight`` and ``speed`` of all impacts, with ``sd_``, ``skew_`` and ``q01_`` to
    ``q99_``, speeds with ``rms_``, ``energy`` (mean loss of an impact), ``energy_per_period``,
    ``power`` (loss per unit of time), ``slow_share``, all also with ``_mesh1``, ``_mesh2``, ... of
    several wheels, and ``contact_share_mesh1``, ``open_share_mesh1``, ....
    """
    plain = _estimates(_Maker(c), names)
    less = control(c)
    if less is None:
        return plain
    better = _estimates(_Maker(less), names)
    return {
        name: better[name]._replace(autocorrelation=e.autocorrelation) for name, e in plain.items()
    }


def _estimates(made: _Maker, names: tuple[str, ...] | None) -> Estimates:
    """Those quantities of a long run that are wanted, or all, from the sums of `made`."""
    c = made.c
    out: Estimates = {}
    for g, suffix in groups(c.wheels):
        if made.main[:, 4 * g + tally.NUMBER].sum() == 0.0:
            continue
        for i, name in NAMES.items():
            if not c.power[:, g, i, 0].any():
                continue
            for make, prefixes in (
                (made.moments, (*SPREADS[:3], "rms_")),
                (made.quantiles, SPREADS[3:]),
            ):
                if names is None or any(prefix + name + suffix in names for prefix in prefixes):
                    out |= {prefix + name + suffix: estimate for prefix, estimate in make(g, i)}
        out |= {name + suffix: estimate for name, estimate in made.impacts(g).items()}
    for i in range(c.wheels):
        out[f"contact_share_mesh{i + 1}"] = made.share(c.columns.contact + i)
        out[f"open_share_mesh{i + 1}"] = made.share(c.columns.open + i)
    return out if names is None else {name: out[name] for name in names if name in out}
