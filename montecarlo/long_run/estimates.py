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
from rattle.montecarlo.long_run.sums import Collected
from rattle.montecarlo.statistics.intervals import Spread, half_width, spread
from rattle.scene import Floats

QUANTILES = (1, 5, 50, 95, 99)
"""Percentages of the quantiles."""
LEAST_PATHS = 8 * CONTROLS
"""Paths below which the coefficients of the control variates would cost more than they save."""
NAMES = {tally.ABOVE: "speed_above", tally.FLIGHT: "flight", tally.SPEED: "speed"}
"""Of what has a distribution, by its index there: the speed of impacts that are not slow, flight,
and speed."""


def groups(stages: int) -> Iterator[tuple[int, str]]:
    """The groups of impacts of a scene with the suffixes of their names."""
    yield 0, ""
    for mesh in range(1, tally.MESH_GROUPS if stages == 2 else 1):
        yield mesh, f"_mesh{mesh}"


def all_names(stages: int) -> tuple[str, ...]:
    """Names of all quantities, in the order of a table."""
    found = []
    spread = ("", "sd_", "skew_", *(f"q{percent:02d}_" for percent in QUANTILES))
    for _, suffix in groups(stages):
        for rate, names in (("rate_above", ("speed_above",)), ("rate", ("flight", "speed"))):
            found += [
                rate + suffix,
                *(f"{prefix}{name}{suffix}" for name in names for prefix in spread),
            ]
            found += [f"rms_{names[-1]}{suffix}"]
        found += [name + suffix for name in ("energy", "energy_per_period", "power", "slow_share")]
    return (
        *found,
        *(
            f"{name}_share_mesh{mesh}"
            for name in ("contact", "open")
            for mesh in range(1, stages + 1)
        ),
    )


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


def control(c: Collected) -> Collected | None:
    """Sums of the impacts of each path, less the part that the noise's own work explains.

    Returns: None where the controls do not hold or do not pay: there is no noise, a mesh was closed
    for a while, so that what pushed a wheel was not the noise alone, or there are too few paths.
    """
    every = c.main[:, :, tally.NOISE : tally.NOISE + CONTROLS]
    controls = every.sum(axis=1)
    if (
        c.paths < LEAST_PATHS
        or not controls.any()
        or c.main[:, :, tally.CONTACT : tally.CONTACT + 2].any()
    ):
        return None
    main = c.main.copy()
    power = c.power.reshape(c.paths, -1)
    main[:, :, : tally.CONTACT] -= every @ corrections(
        main[:, :, : tally.CONTACT].sum(axis=1), controls
    )
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


def _jackknife(sums: Floats, function: Callable[[Floats], Floats]) -> list[Spread]:
    """Functions of sums over paths, each with its spread over paths.

    Shapes: `sums` (paths, sums); of what the function returns (values, paths).
    """
    total = sums.sum(axis=0)
    n = len(sums)
    whole = function(total[None])[:, 0].tolist()
    without = function(total - sums)
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

    def __init__(self, c: Collected) -> None:
        self.c, self.main = c, c.main.sum(axis=1)

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
        rest = square - 2.0 * value * cross + value**2 * self._raw(g, tally.FLIGHT)[1]
        naive = math.sqrt(max(rest, 0.0)) / whole
        found = spread(factor * sums.sum(axis=1) / self.c.time)
        return self._make(found, factor * naive, factor * self._batch_se(sums, None))

    def _raw(self, g: int, i: int) -> tuple[float, float]:
        """Sums of a value and of its square."""
        m = self.c.power[:, g, i].sum(axis=0)
        r = self.c.scales
        a = float(r.centre[g, i])
        s = float(r.scale[g, i])
        return float(a * m[0] + s * m[1]), float(a * a * m[0] + 2.0 * a * s * m[1] + s * s * m[2])

    def _ratio(self, top: int, bottom: int) -> tuple[Spread, float]:
        """A ratio of two columns, and its standard error from batches."""
        (found,) = _jackknife(self.main[:, [top, bottom]], lambda s: s[None, :, 0] / s[:, 1])
        return found, self._batch_se(self.c.main[:, :, top], bottom)

    def impacts(self, g: int) -> dict[str, StationaryEstimate]:
        """Rates and energies of the impacts of a group, and the share of slow ones."""
        number, energy, slow = (
            self.c.main[:, :, 4 * g + k] for k in (tally.NUMBER, tally.ENERGY, tally.SLOW)
        )
        above = number - slow
        n = float(self.main[:, 4 * g + tally.NUMBER].sum())
        products = self.c.products[:, g]
        square, cross = (float(total) for total in products[:, :2].sum(axis=0))
        rates = {
            "rate_above": self._per_time(above, g, float(above.sum()), float(products[:, 2].sum())),
            "rate": self._per_time(number, g, float(number.sum()), self._raw(g, tally.FLIGHT)[0]),
        }
        most = most_unseen(self.c.time * self.c.paths)
        rates |= {
            name: rate._replace(high=most)
            for name, rate in rates.items()
            if rate.value == rate.se == 0.0
        }
        loss, loss_batches = self._ratio(4 * g + tally.ENERGY, 4 * g + tally.NUMBER)
        share, share_batches = self._ratio(4 * g + tally.SLOW, 4 * g + tally.NUMBER)
        return {
            **rates,
            "energy": self._make(
                loss, _root(float(products[:, 0].sum()) / n - loss.value**2, n), loss_batches
            ),
            "energy_per_period": self._per_time(energy, g, square, cross, 2.0 * math.pi),
            "power": self._per_time(energy, g, square, cross),
            "slow_share": self._make(
                share, _root(share.value * (1.0 - share.value), n), share_batches, 0.0, 1.0
            ),
        }

    def share(self, of: int, mesh: int) -> StationaryEstimate:
        """Share of the time in which a mesh is closed (`CONTACT`) or open (`OPEN`); its
        autocorrelation in impacts."""
        c = self.c
        column = of + mesh - 1
        found = spread(self.main[:, column] / c.samples)
        samples = c.samples * c.paths
        apart = float(self.main[:, tally.NUMBER].sum()) / samples  # impacts between two samples
        naive = math.sqrt(
            max(found.value * (1.0 - found.value), 0.0) / samples / max(apart, 1e-300)
        )
        return self._make(
            found, naive, self._batch_se(c.main[:, :, column], None) * c.time / c.samples, 0.0, 1.0
        )

    def moments(self, g: int, i: int) -> Iterator[tuple[str, StationaryEstimate]]:
        """Mean, sd and skewness of flight or of a speed, and the root of its mean square of a
        speed."""
        power = self.c.power[:, g, i]
        scale = float(self.c.scales.scale[g, i])
        centre = self.c.scales.centre[g, i]

        def figures(
            s: Floats,
        ) -> Floats:  # mean, sd and skewness in units of the scale, and the root mean square
            with np.errstate(invalid="ignore", divide="ignore"):
                m = s / s[:, :1]
                variance = np.maximum(m[:, 2] - m[:, 1] ** 2, 0.0)
                third = m[:, 3] - 3.0 * m[:, 1] * m[:, 2] + 2.0 * m[:, 1] * m[:, 1] ** 2
                sd = np.sqrt(variance)
                return np.stack(
                    [
                        m[:, 1],
                        sd,
                        third / (variance * sd),
                        np.hypot(scale * m[:, 1] + centre, scale * sd),
                    ]
                )

        m = power.sum(axis=0)
        mean, sd, skew, rms = figures(m[None])[:, 0].tolist()
        n = float(m[0])
        unit_powers = np.array([sd**k for k in range(tally.POWER_SUMS)])
        central = (
            _central(m / n, mean) / unit_powers if sd > 0.0 else np.full(tally.POWER_SUMS, math.nan)
        )
        along = scale * mean + float(centre)  # the mean

        # polynomial in the standardised value, its unit, and unit and origin of the estimate
        influence = {
            "": (np.array([0.0, 1.0]), scale * sd, scale, float(centre)),
            "sd_": (np.array([-0.5, 0.0, 0.5]), scale * sd, scale, 0.0),
            "skew_": (np.array([0.5 * skew, -3.0, -1.5 * skew, 1.0]), 1.0, 1.0, 0.0),
        }
        if i != tally.FLIGHT:
            slope = np.array([-sd * scale, 2.0 * along, sd * scale]) / (2.0 * rms)
            influence["rms_"] = slope, scale * sd, 1.0, 0.0
        found_of = zip(influence.items(), _jackknife(power, figures), strict=False)
        for (prefix, (polynomial, unit, factor, origin)), found in found_of:
            square = sum(
                a * b * central[p + q]
                for p, a in enumerate(polynomial)
                for q, b in enumerate(polynomial)
            )
            naive = unit * _root(square, n) if sd > 0.0 else math.nan
            batches = math.nan
            if (prefix, i) == ("", tally.SPEED):
                batches = self._batch_se(
                    self.c.main[:, :, 4 * g + tally.SPEED], 4 * g + tally.NUMBER
                )
            found = found._replace(value=found.value * factor + origin, se=found.se * factor)
            yield prefix, self._make(found, naive, batches)

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
            k = int(np.clip(np.searchsorted(whole, p), 0, edges.size - 1))
            part = spread((below[:, k] - whole[k] * n) / n.mean())
            half = float(half_width(part.effective_paths))
            value, low, high = (
                float(np.interp(p + x * part.se, whole, edges)) for x in (0.0, -half, half)
            )
            found = Spread(value, part.se, part.effective_paths)
            e = self._make(found, math.sqrt(p * (1.0 - p) / float(n.sum())))
            yield f"q{percent:02d}_", e._replace(se=0.5 * (high - low) / half, low=low, high=high)


def _central(raw: Floats, mean: float) -> Floats:
    """Central moments of orders 0 to 6 from raw ones."""
    return np.array(
        [
            sum(math.comb(k, j) * raw[j] * (-mean) ** (k - j) for j in range(k + 1))
            for k in range(len(raw))
        ]
    )


def estimates(c: Collected, names: tuple[str, ...] | None = None) -> dict[str, StationaryEstimate]:
    """All stationary quantities of a long run (dimensionless), or those that are wanted.

    Returns: ``rate_above`` (impacts per unit of time that are not slow) and ``speed_above``,
    ``rate`` and ``flight`` and ``speed`` of all impacts, with ``sd_``, ``skew_`` and ``q01_`` to
    ``q99_``, speeds with ``rms_``, ``energy`` (mean loss of an impact), ``energy_per_period``,
    ``power`` (loss per unit of time), ``slow_share``, all also with ``_mesh1`` and ``_mesh2`` for
    two stages, and ``contact_share_mesh1``, ``open_share_mesh1``, ....
    """
    plain = _estimates(_Maker(c), names)
    less = control(c)
    if less is None:
        return plain
    better = _estimates(_Maker(less), names)
    return {
        name: better[name]._replace(autocorrelation=e.autocorrelation) for name, e in plain.items()
    }


def _estimates(made: _Maker, names: tuple[str, ...] | None) -> dict[str, StationaryEstimate]:
    c = made.c
    out: dict[str, StationaryEstimate] = {}
    for g, suffix in groups(c.stages):
        if made.main[:, 4 * g].sum() == 0.0:
            continue
        for i, name in NAMES.items():
            if not c.power[:, g, i, 0].any():
                continue
            prefixes = (
                ("", "sd_", "skew_", "rms_"),
                tuple(f"q{percent:02d}_" for percent in QUANTILES),
            )
            for make, group in zip((made.moments, made.quantiles), prefixes, strict=True):
                if names is None or any(prefix + name + suffix in names for prefix in group):
                    out |= {prefix + name + suffix: estimate for prefix, estimate in make(g, i)}
        out |= {name + suffix: estimate for name, estimate in made.impacts(g).items()}
    for mesh in range(1, c.stages + 1):
        out[f"contact_share_mesh{mesh}"] = made.share(tally.CONTACT, mesh)
        out[f"open_share_mesh{mesh}"] = made.share(tally.OPEN, mesh)
    return out if names is None else {name: out[name] for name in names if name in out}
