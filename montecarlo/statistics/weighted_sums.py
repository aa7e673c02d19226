"""Mergeable sums over weighted paths, and the moments and standard errors that follow from them."""

from dataclasses import dataclass
from math import comb

import numpy as np

from rattle.montecarlo.statistics.section_statistics import Pairs, Polynomial, undefined
from rattle.scene import Floats, Ints
from rattle.scene.compiled import lean

# powers of a deviation d, from 0 on, that are summed with w, with w^2 and with w^3
ONCE = 5
TWICE = 9
THRICE = 7
ORDERS = (ONCE, TWICE, THRICE)
WEIGHTED_ORDERS = sum(ORDERS)
# variance of what does not vary but by rounding: the displacement at a wall that all paths strike
ROUNDING_VARIANCE = 1e-60


@lean
def add(
    rows: Floats, weights: Floats, centre: Floats, pairs: Ints, sums: Floats, products: Floats
) -> None:
    """Add the paths of one part to its sums, and to those of the products of pairs of variables,
    about a centre; impacts that a path did not have count nothing.

    Shapes: `rows` (paths, impacts, columns); `weights` (paths, impacts); `centre` (impacts,
    variables); `pairs` (pairs, 2); `sums` (impacts, variables, WEIGHTED_ORDERS); `products`
    (impacts, pairs).
    """
    for p in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            w = weights[p, k]
            if not w > 0.0:
                continue
            for q in range(sums.shape[1]):
                d = rows[p, k, q] - centre[k, q]
                s = sums[k, q]
                weight = w
                first = 0
                for orders in ORDERS:
                    term = weight
                    for o in range(first, first + orders):
                        s[o] += term
                        term *= d
                    first += orders
                    weight *= w
            for j in range(pairs.shape[0]):
                a, b = pairs[j]
                products[k, j] += (
                    w * (rows[p, k, a] - centre[k, a]) * (rows[p, k, b] - centre[k, b])
                )


@dataclass(frozen=True)
class WeightedSums:
    """Sums over the paths of a mixture, apart for each of its parts: each has a fixed number of
    paths."""

    paths: Floats  # of each part; (parts,)
    centre: Floats  # about which the deviations are; (impacts, variables)
    sums: Floats  # (parts, impacts, variables, WEIGHTED_ORDERS)
    products: Floats  # weighted products of the deviations of pairs; (impacts, pairs)

    @classmethod
    def of_parts(
        cls,
        values: Floats,
        weights: Floats,
        centre: Floats,
        counts: Ints,
        pairs: Pairs,
    ) -> "WeightedSums":
        """Sums of a block of weighted paths, those of each part one after another, so many.

        Shapes: `values` (paths, impacts, variables); `weights` (paths, impacts).
        """
        sums = np.zeros((counts.size, *centre.shape, WEIGHTED_ORDERS))
        products = np.zeros((len(centre), len(pairs)))
        for i, end in enumerate(np.cumsum(counts)):
            part = slice(end - counts[i], end)
            add(values[part], weights[part], centre, np.array(pairs), sums[i], products)
        return cls(counts.astype(float), centre, sums, products)

    def merge(self, other: "WeightedSums") -> "WeightedSums":
        """The sums over two sets of paths together."""
        paths = self.paths + other.paths
        sums = self.sums + other.sums
        products = self.products + other.products
        return WeightedSums(paths, self.centre, sums, products)

    def until(self, impacts: int) -> "WeightedSums":
        """The sums of the first impacts; the others have no weight."""
        seen = np.arange(len(self.centre)) < impacts
        return WeightedSums(
            self.paths, self.centre, self.sums * seen[:, None, None], self.products * seen[:, None]
        )

    @property
    def weight(self) -> Floats:
        """Total weight of each row."""
        return np.asarray(self.sums[..., 0].sum(axis=0))

    def batch(self, quantities: int) -> tuple[Floats, Floats, Floats]:
        """Weight, mean and sum of squares of the first variables, the section quantities."""
        with undefined():
            w, first, second = (self.sums[:, :, :quantities, o].sum(axis=0) for o in range(3))
            off = np.nan_to_num(first / w)
        return w, self.centre[:, :quantities] + off, np.maximum(second - off * first, 0.0)

    def moments(self) -> dict[str, Floats]:
        """Mean, sd, skewness and excess kurtosis with standard errors, as `single_statistics` has
        them.

        Estimates are ratios of weighted sums; mean and variance are corrected for the bias that a
        ratio has to first order in 1 / paths.  Standard errors are those of the influence
        functions, whose variances add up over the parts.  ``lean_mean`` and ``lean_sd``: skewness
        of the sampling distributions.

        Shapes: result (impacts, variables).
        """
        with undefined():
            off = self.sums[..., 1].sum(axis=0) / self.weight
            about = _shift(self.sums, off)
            m2, m3, m4 = (about[..., o].sum(axis=0) / self.weight for o in (2, 3, 4))
            m2 = np.where(m2 > ROUNDING_VARIANCE, m2, np.nan)
            of_mean = [0.0, 1.0]
            error = self._covariance(about, of_mean, of_mean)
            variance = np.maximum(m2 + error + self._covariance(about, [-m2, 0.0, 1.0], [1.0]), 0.0)
            sd = np.where(m2 > 0.0, np.sqrt(variance), 0.0)
            # NaN of what does not vary
            skew = m3 / m2**1.5
            kurt = m4 / m2**2
            of_square: Polynomial = [-m2, 0.0, 1.0]
            of_skew: Polynomial = [1.5 * skew, -3.0 / m2**0.5, -1.5 * skew / m2, 1.0 / m2**1.5]
            of_kurt: Polynomial = [
                2.0 * kurt,
                -4.0 * skew / m2**0.5,
                -2.0 * kurt / m2,
                0.0,
                1.0 / m2**2,
            ]
            se_square = np.sqrt(self._covariance(about, of_square, of_square))
            return {
                "mean": self.centre + off + self._covariance(about, of_mean, [1.0]),
                "se_mean": np.sqrt(error),
                "sd": sd,
                "se_sd": np.where(sd > 0.0, se_square / (2.0 * sd), 0.0 * sd),
                "skew": skew,
                "se_skew": np.sqrt(self._covariance(about, of_skew, of_skew)),
                "kurt": kurt - 3.0,
                "se_kurt": np.sqrt(self._covariance(about, of_kurt, of_kurt)),
                "lean_mean": np.nan_to_num(
                    self._third(about, of_mean) / error**1.5, posinf=0.0, neginf=0.0
                ),
                "lean_sd": np.nan_to_num(
                    self._third(about, of_square) / se_square**3, posinf=0.0, neginf=0.0
                ),
            }

    def _covariance(self, about: Floats, a: Polynomial, b: Polynomial) -> Floats:
        """Covariance of the weighted means of two polynomials (ascending coefficients), from within
        the parts."""
        n = self.paths[:, None, None]
        twice = about[..., ONCE : ONCE + TWICE]
        both = sum(p * q * twice[..., i + j] for i, p in enumerate(a) for j, q in enumerate(b))
        first, second = (sum(p * about[..., i] for i, p in enumerate(c)) for c in (a, b))
        within = (both - first * second / n) * (n / np.maximum(n - 1.0, 1.0))
        total = within.sum(axis=0) / self.weight**2
        return np.asarray(np.maximum(total, 0.0) if a is b else total)

    def _third(self, about: Floats, a: Polynomial) -> Floats:
        """Third moment of the error of the weighted mean of a polynomial of at most second
        degree."""
        thrice = about[..., ONCE + TWICE :].sum(axis=0)
        total = np.zeros_like(self.weight)
        for i, p in enumerate(a):
            for j, q in enumerate(a):
                for k, r in enumerate(a):
                    total += p * q * r * thrice[..., i + j + k]
        return np.asarray(total / self.weight**3)

    def pair_moment(self, pairs: Pairs) -> Floats:
        """Covariances of pairs of variables.

        Shapes: result (impacts, pairs).
        """
        with undefined():
            off = self.sums[..., 1].sum(axis=0) / self.weight
            first, second = np.array(pairs).T
            return np.asarray(
                self.products / self.weight[:, first] - off[:, first] * off[:, second]
            )


def _shift(sums: Floats, by: Floats) -> Floats:
    """The same sums about a centre that lies further by `by`, by the binomial theorem."""
    out = np.zeros_like(sums)
    first = 0
    for orders in ORDERS:
        for o in range(orders):
            for j in range(o + 1):
                out[..., first + o] += comb(o, j) * (-by) ** (o - j) * sums[..., first + j]
        first += orders
    return out
