"""The bivariate Edgeworth series of one stage (Eqs. 11-13, 18, 19) and its window means (Eqs. 20,
21)."""

from dataclasses import dataclass
from math import erf, erfc, exp, factorial, pi, sqrt

import numpy as np
from numpy.polynomial import hermite_e

from rattle.closure.exponentials import exponentials
from rattle.scene import Floats
from rattle.scene.compiled import internal, jit
from rattle.scene.flight import NODES, WEIGHTS
from rattle.scene.linear_algebra import total
from rattle.scene.moments import SMALLEST_DIVISOR
from rattle.scene.numpy_errors import numpy_defaults

FACTORIAL = np.array([factorial(n) for n in range(8)], dtype=float)
NARROW = 1.0  # width of a window, in sds, below which it is integrated by Gauss-Legendre quadrature
FARTHEST = 40.0  # sds beyond which the normal density underflows to 0
HERMITE = np.array([np.pad(hermite_e.herme2poly([0.0] * i + [1.0]), (0, 7 - i)) for i in range(8)])
"""Row i: the monomial coefficients of He_i."""


@jit
def coefficients(raw: Floats, sd_x: float, sd_y: float) -> Floats:
    """``a_ij = E[He_i(xi / sd_x) He_j(zeta / sd_y)] / (i! j!)`` for ``i + j <= order`` (below Eq.
    13).

    By orthogonality of the Hermite polynomials these are the only coefficients for which the series
    has the given moments; Eq. 11 groups the same terms by order, with moments of order 4 where
    cumulants belong (docs/model.md section 9).

    Shapes: `raw` (order + 1, order + 1); result (order + 1, order + 1).
    """
    order = raw.shape[0] - 1
    a = np.zeros_like(raw)
    for i in range(order + 1):
        for j in range(order + 1 - i):
            for n in range(i + 1):
                for p in range(j + 1):
                    a[i, j] += HERMITE[i, n] * HERMITE[j, p] * raw[n, p] / sd_x**n / sd_y**p
            a[i, j] /= FACTORIAL[i] * FACTORIAL[j]
    return a


@jit
def has_series(vx: float, vy: float, order: int) -> bool:
    """Whether two variances are positive, and the powers of the sds up to that order neither
    underflow nor overflow."""
    if not (vx > 0.0 and vy > 0.0):
        return False
    return bool(
        min(vx, vy) ** (0.5 * order) > SMALLEST_DIVISOR
        and max(vx, vy) ** (0.5 * order) * SMALLEST_DIVISOR < 1.0
    )


@jit
def hermite(i: int, z: float) -> float:
    """``He_i(z)`` (below Eq. 11)."""
    total = 0.0
    for n in range(i, -1, -1):
        total = total * z + HERMITE[i, n]
    return total


@jit
def normal_density(z: float) -> float:
    """Standard normal density."""
    return exp(-0.5 * z * z) / sqrt(2.0 * pi)


@jit
def normal_mass(low: float, high: float) -> float:
    """Probability of the standard normal between two points, accurate to rounding also within one
    tail."""
    root = sqrt(2.0)
    if low > 0.0:
        return 0.5 * (erfc(low / root) - erfc(high / root))
    if high < 0.0:
        return 0.5 * (erfc(-high / root) - erfc(-low / root))
    return 0.5 * (erf(high / root) - erf(low / root))


@jit
def hermite_masses(low: float, high: float, order: int) -> tuple[Floats, Floats]:
    """``int He_i phi`` and ``int z He_i phi`` over a window, i = 0 to `order`.

    The first is ``He_{i-1}(low) phi(low) - He_{i-1}(high) phi(high)`` and the second ``M_{i+1} + i
    M_{i-1}`` (below Eq. 21).  Over a narrow window these differences cancel, and Gauss-Legendre
    quadrature is used.
    """
    mass = np.zeros(order + 2)
    first = np.zeros(order + 1)
    width = high - low
    if width < NARROW:
        for n in range(NODES.size):
            z = low + width * NODES[n] if abs(low) < abs(high) else high - width * NODES[n]
            w = width * WEIGHTS[n] * normal_density(z)
            for i in range(order + 1):
                mass[i] += w * hermite(i, z)
                first[i] += w * z * hermite(i, z)
        return mass[: order + 1], first
    mass[0] = normal_mass(low, high)
    for i in range(1, order + 2):
        for z, sign in ((low, 1.0), (high, -1.0)):
            if abs(z) < FARTHEST:  # beyond, the density is 0 and the polynomial may be infinite
                mass[i] += sign * hermite(i - 1, z) * normal_density(z)
    for i in range(order + 1):
        first[i] = mass[i + 1] + (i * mass[i - 1] if i > 0 else 0.0)
    return mass[: order + 1], first


@jit
def window_means(
    a: Floats, sd_x: float, sd_y: float, low: float, high: float
) -> tuple[float, float]:
    """``E[xi; low < xi < high]`` and ``E[zeta; low < xi < high]`` of the series (Eqs. 20, 21).

    These are integrals over the window, not means conditional on it: that is how the paper shifts
    its means.

    Shapes: `a` (order + 1, order + 1).
    """
    order = a.shape[0] - 1
    mass, first = hermite_masses(low / sd_x, high / sd_x, order)
    mean_x = 0.0
    mean_y = 0.0
    for i in range(order + 1):
        mean_x += a[i, 0] * first[i]
        if i < order:
            mean_y += a[i, 1] * mass[i]
    return sd_x * mean_x, sd_y * mean_y


@internal
def window_shift(raw: Floats, x: float, half_window: float, published: bool) -> tuple[float, float]:
    """Shift of a stage's mean displacement and velocity (Eqs. 20, 21) for walls at
    ``+-half_window``.

    A or C and B or D, times their standard deviations.  Zero where a variance is not positive: no
    window mean can be formed there.  `published`: With ``+psi_0`` in the fourth-order term of A and
    C, as the paper has it.

    Shapes: `raw` (order + 1, order + 1).
    """
    vx = raw[2, 0]
    vy = raw[0, 2]
    if not has_series(vx, vy, len(raw) - 1):
        return 0.0, 0.0
    sd_x = np.sqrt(vx)
    sd_y = np.sqrt(vy)
    a = coefficients(raw, sd_x, sd_y)
    low = -half_window - x
    high = half_window - x
    shift_x, shift_y = window_means(a, sd_x, sd_y, low, high)
    # A and C in the paper have psi_4 - 2 psi_2 + psi_0; the integral has - psi_0
    if published and len(raw) > 4:
        shift_x += 2.0 * sd_x * a[4, 0] * (normal_density(low / sd_x) - normal_density(high / sd_x))
    return shift_x, shift_y


def section_density(values: Floats, mean: float, sd: float, skew: float) -> Floats:
    """Edgeworth density of one quantity up to its third cumulant, the order at which its skewness
    is O(sigma)."""
    z = (np.asarray(values) - mean) / sd
    series = hermite_e.hermeval(z, [1.0, 0.0, 0.0, skew / 6.0])
    return np.asarray(exponentials(-0.5 * z * z) / (np.sqrt(2.0 * np.pi) * sd) * series)


def mixture_density(values: Floats, weights: Floats, means: Floats, variances: Floats) -> Floats:
    """Density of a one-dimensional Gaussian mixture.

    A component narrower than a hundredth of the mixture's sd is widened to that.

    Shapes: `weights`, `means`, `variances` (components,).
    """
    centre = (weights * means).sum()
    sd = np.sqrt((weights * (variances + (means - centre) ** 2)).sum())
    width = np.maximum(np.sqrt(variances), 0.01 * sd)
    z = (np.asarray(values, dtype=float)[..., None] - means) / width
    terms = weights * exponentials(-0.5 * z * z) / (sqrt(2.0 * pi) * width)
    return total(terms)


@numpy_defaults
@dataclass(frozen=True)
class Edgeworth:
    """Density of the perturbation ``(xi, zeta)`` of one stage (Eqs. 18, 19).

    Attributes
    ----------
    a : ndarray, shape (order + 1, order + 1)
        Coefficients.
    sd_x, sd_y : float
        Standard deviations of displacement and velocity.

    Examples
    --------
    >>> from rattle import DAT21, Scene, mean_map
    >>> density = mean_map(
    ...     Scene.from_gears(DAT21, sigma=0.1), impacts=1, closure="corrected"
    ... ).edgeworth(1, 1)
    >>> bool(density.density(np.array([0.0]), np.array([0.0]))[0] > 0.0)
    True
    """

    a: Floats
    sd_x: float
    sd_y: float

    def __repr__(self) -> str:
        return f"Edgeworth: order {len(self.a) - 1}, sd_x = {self.sd_x:.6g}, sd_y = {self.sd_y:.6g}"

    def density(self, xi: Floats, zeta: Floats) -> Floats:
        """Joint density, by the truncated series; where it is negative it is returned as it is.

        Parameters
        ----------
        xi, zeta : ndarray
            Displacement and velocity perturbations, of one shape.

        Returns
        -------
        ndarray
            Density at these points.
        """
        u = np.asarray(xi) / self.sd_x
        v = np.asarray(zeta) / self.sd_y
        weight = exponentials(-0.5 * (u * u + v * v)) / (2.0 * np.pi * self.sd_x * self.sd_y)
        return np.asarray(weight * hermite_e.hermeval2d(u, v, self.a))

    def density_on_grid(self, xi: Floats, zeta: Floats) -> Floats:
        """Joint density on a grid, to rounding that of `density` and several times faster.

        Parameters
        ----------
        xi : ndarray, shape (m,)
            Displacement perturbations.
        zeta : ndarray, shape (n,)
            Velocity perturbations.

        Returns
        -------
        ndarray, shape (m, n)
            Density at these points.
        """
        u = xi / self.sd_x
        v = zeta / self.sd_y
        normal = np.outer(exponentials(-0.5 * u * u), exponentials(-0.5 * v * v))
        return np.asarray(
            normal * hermite_e.hermegrid2d(u, v, self.a / (2.0 * np.pi * self.sd_x * self.sd_y))
        )

    def velocity_density(self, zeta: Floats) -> Floats:
        """Marginal density of the velocity perturbation.

        Parameters
        ----------
        zeta : ndarray
            Velocity perturbations.

        Returns
        -------
        ndarray
            Density at these points.
        """
        v = np.asarray(zeta) / self.sd_y
        weight = exponentials(-0.5 * v * v) / (np.sqrt(2.0 * np.pi) * self.sd_y)
        return np.asarray(weight * hermite_e.hermeval(v, self.a[0]))
