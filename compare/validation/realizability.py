"""Realizability: whether a closure's moments, and the densities built from them, can belong to a distribution.

The correlation alone says little: a set of moments is realizable if and only if every polynomial's square has a
mean that is not negative, so the moment matrix decides (necessary in two variables, Hamburger's condition in one).
Edgeworth densities are judged separately: a truncated series can be negative although its moments are realizable.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.closure import MeanMap
from rattle.compare.validation.distance import find_varying
from rattle.scene.moments import ROUNDING, central_from_raw, correlation

Floats = NDArray[np.float64]

QUADRATURE = 1e-6
"""Negative mass below which a density counts as positive: less than one path in a million.

The quadrature gives a mass of this size to 0.1 %.  All other tolerances are `rattle.scene.moments.ROUNDING`, relative
to the largest of the terms that are compared; the sign of a variance needs none.
"""

REACH, POINTS = 8.0, 481  # sds on both sides of the mean, and points per axis, of the quadratures of negative parts

NAN = float("nan")


CHECKS = {
    "variance of displacement": (0.0, 1, 0.0),
    "variance of velocity": (0.0, 1, 0.0),
    "|rho|": (1.0, -1, ROUNDING),
    "covariance eigenvalue": (0.0, 1, ROUNDING),
    "kurtosis": (0.0, 1, ROUNDING),
    "moment matrix": (0.0, 1, ROUNDING),
    "negative mass": (0.0, -1, QUADRATURE),
    "section negative mass": (0.0, -1, QUADRATURE),
}
"""Bound, sign and slack of each: moments of a distribution satisfy ``sign * (value - bound) >= 0`` but for rounding."""


class Statistic(NamedTuple):
    """Value that is checked, NaN where a moment is missing, and the size of the terms whose difference it is."""

    value: float
    scale: float = 1.0


def covariance_eigenvalue(covariance: Floats) -> float:
    """Smallest eigenvalue of a covariance matrix over its largest diagonal entry; negative for no distribution.

    Shapes: `covariance` (n, n).

    Examples
    --------
    >>> round(covariance_eigenvalue(np.array([[2.0, 3.0], [3.0, 2.0]])), 6)
    -0.5
    """
    if not np.isfinite(covariance).all():
        return NAN
    # with zero variances no covariance is possible, so the largest covariance sets the scale
    scale = float(np.abs(covariance.diagonal()).max()) or float(np.abs(covariance).max()) or 1.0
    return float(np.linalg.eigvalsh(covariance / scale)[0])


def kurtosis_margin(raw: Floats) -> Statistic:
    """``kurtosis - skewness^2 - 1``, the smaller one of both marginals: negative for no distribution.

    Pearson (1916), Phil. Trans. R. Soc. A 216, 429.  It is zero for distributions on two points.

    Shapes: `raw` (order + 1, order + 1).

    Examples
    --------
    >>> from rattle.scene.moments import gaussian_raw_moments
    >>> kurtosis_margin(gaussian_raw_moments(4.0, 1.0, 1.0, 4)).value
    2.0
    """
    if len(raw) < 5:
        return Statistic(NAN)
    margins = []
    for marginal in (raw[:5, 0], raw[0, :5]):
        m2, m3, m4 = central_from_raw(marginal)[2:]
        if m2 > 0.0 and np.isfinite(marginal).all():
            with np.errstate(over="ignore", invalid="ignore"):
                kurtosis, square = m4 / m2 / m2, (m3 / m2**1.5) ** 2
            margins.append(Statistic(float(kurtosis - square - 1.0), float(max(abs(kurtosis), square, 1.0))))
    return min(margins, key=lambda m: m.value, default=Statistic(NAN))


def moment_matrix_eigenvalue(raw: Floats) -> Statistic:
    """Smallest eigenvalue of ``E[u^(n+m) v^(p+q)]`` over the monomials of degree up to half the order.

    ``u, v`` are displacement and velocity in units of the root of their second moment, so the value is dimensionless.
    It is the smallest mean square of a polynomial whose coefficient vector has length 1: negative for no distribution
    (Akhiezer 1965, The Classical Moment Problem, chapter 2).

    Shapes: `raw` (order + 1, order + 1).

    Examples
    --------
    >>> from rattle.scene.moments import gaussian_raw_moments
    >>> raw = gaussian_raw_moments(4.0, 1.0, 1.0, 4)
    >>> round(moment_matrix_eigenvalue(raw).value, 4)
    0.2682
    >>> raw[2, 2] = 0.5                                # E[u^2 v^2] = 0.125 with rho = 0.5: below rho^2
    >>> moment_matrix_eigenvalue(raw).value < 0.0
    True
    """
    order = len(raw) - 1
    monomials = [(n, p) for n in range(order // 2 + 1) for p in range(order // 2 + 1 - n)]
    scales = []
    for marginal in (raw[:, 0], raw[0, :]):
        # |variance| as scale keeps the sign of a negative variance; if it is 0, the other moments set the scale
        other = max(abs(m) ** (1.0 / n) for n, m in enumerate(marginal) if n > 0)
        scales.append(float(np.sqrt(abs(marginal[2])) or other or 1.0))
    sd_x, sd_y = scales
    with np.errstate(over="ignore", invalid="ignore"):
        matrix = np.array(
            [[raw[n + m, p + q] / sd_x ** (n + m) / sd_y ** (p + q) for m, q in monomials] for n, p in monomials]
        )
    if not np.isfinite(matrix).all():
        return Statistic(NAN)
    return Statistic(float(np.linalg.eigvalsh(matrix)[0]), float(np.abs(matrix.diagonal()).max()))


def negative_mass(values: Floats, spacing: float) -> float:
    """Mass of the negative part of a density given on a uniform grid of any dimension, by the rectangle rule.

    `values`: Density at the grid points; it vanishes at the grid's ends, so that this is the trapezoidal rule.

    Examples
    --------
    >>> from rattle.closure.edgeworth import section_density
    >>> z = np.linspace(-8.0, 8.0, 481)
    >>> round(negative_mass(section_density(z, 0.0, 1.0, 1.0), z[1] - z[0]), 4)           # of skewness 1
    0.0096
    """
    return float(np.maximum(-values, 0.0).sum() * spacing)


def _series_negative_mass(prediction: MeanMap, impact: int, stage: int) -> Statistic:
    raw = prediction.trace.raw[impact, stage - 1]
    if not (raw[2, 0] > 0.0 and raw[0, 2] > 0.0 and np.isfinite(raw).all()):
        return Statistic(NAN)  # no series can be formed
    series = prediction.edgeworth(impact, stage)
    z = np.linspace(-REACH, REACH, POINTS)
    cell = (z[1] - z[0]) ** 2 * series.sd_x * series.sd_y
    return Statistic(negative_mass(series.density_on_grid(z * series.sd_x, z * series.sd_y), cell))


def _section_negative_mass(prediction: MeanMap, impact: int) -> Statistic:
    """The largest over the quantities that vary and have a skewness."""
    table, masses = prediction.phase_reduced.section, []
    for quantity in find_varying(table, impact):
        mean, sd, skew = (float(table[prefix + quantity].loc[impact]) for prefix in ("", "sd_", "skew_"))
        grid = mean + sd * np.linspace(-REACH, REACH, POINTS)
        density = prediction.density(impact, quantity, grid)
        if density is not None and np.isfinite(skew):
            masses.append(negative_mass(density, float(grid[1] - grid[0])))
    return Statistic(max(masses, default=NAN))


def _statistics(prediction: MeanMap, impact: int) -> Iterator[tuple[int, str, Statistic]]:
    """Stage, name of the check and its statistic at one impact; stage 0 stands for both stages jointly."""
    if prediction.scene.stages == 2:
        yield 0, "covariance eigenvalue", Statistic(covariance_eigenvalue(prediction.trace.covariance[impact]))
    yield 0, "section negative mass", _section_negative_mass(prediction, impact)
    for stage in range(1, prediction.scene.stages + 1):
        covariance, raw = prediction.stage_covariance(impact, stage), prediction.trace.raw[impact, stage - 1]
        yield stage, "variance of displacement", Statistic(float(covariance[0, 0]))
        yield stage, "variance of velocity", Statistic(float(covariance[1, 1]))
        yield stage, "|rho|", Statistic(abs(correlation(covariance)) if np.isfinite(covariance).all() else NAN)
        yield stage, "covariance eigenvalue", Statistic(covariance_eigenvalue(covariance))
        yield stage, "kurtosis", kurtosis_margin(raw)
        yield stage, "moment matrix", moment_matrix_eigenvalue(raw)
        yield stage, "negative mass", _series_negative_mass(prediction, impact, stage)


def realizability_table(predictions: Sequence[MeanMap]) -> pd.DataFrame:
    """Check the bounds that moments of any distribution satisfy, at each impact of each closure.

    Returns: Columns ``closure, impact, stage, check, value, bound, holds, excess`` (dimensionless).  Stage 0
    stands for both stages jointly.  ``holds`` is nullable: NA where the closure has no such moment, and then
    ``value`` and ``excess`` are NaN.  ``excess`` is the amount by which a bound is violated, 0 where it holds.

    Notes
    -----
    ``variance of displacement``, ``variance of velocity``: not negative.
    ``|rho|``: at most 1; NA without positive variances.
    ``covariance eigenvalue``: the smallest, over the largest diagonal entry; of a stage, and at stage 0 of all four
    quantities (NA for ``published``, which has no moments across the stages).
    ``kurtosis``, ``moment matrix``: see `kurtosis_margin` and `moment_matrix_eigenvalue`.
    ``negative mass``: of the stage's Edgeworth series (Eqs. 18, 19), within 8 sd.  A series truncated at order 4 is
    negative somewhere for every ``rho`` but 0: along an axis it is ``1 - rho^2 (u^2 - 1) / 2``.  So this check judges
    the truncation, and may fail although the moments are realizable.
    ``section negative mass``: the largest over the one-dimensional section densities with a skewness.
    A point mass satisfies every bound: it has no correlation, kurtosis or series, and these are NA.

    Examples
    --------
    >>> from rattle.closure import mean_map
    >>> from rattle.scene import DAT21, Scene
    >>> scene = Scene.from_gears(DAT21, sigma=1.5**0.5)
    >>> table = realizability_table([mean_map(scene, impacts=4, closure="published")])
    >>> first_failures(table).set_index("check").loc[["variance of velocity", "moment matrix"], "impact"].tolist()
    [2, 2]
    """
    rows = [
        (prediction.closure, impact, stage, check, *statistic, *CHECKS[check])
        for prediction in predictions
        for impact in range(1, prediction.trace.found + 1)
        for stage, check, statistic in _statistics(prediction, impact)
    ]
    names = ["closure", "impact", "stage", "check", "value", "scale", "bound", "sign", "slack"]
    table = pd.DataFrame(rows, columns=names)
    missed = table["sign"] * (table["bound"] - table["value"])
    known, holds = table["value"].notna(), missed <= table["slack"] * table["scale"]
    table["holds"], table["excess"] = holds.astype("boolean").where(known), missed.mask(holds, 0.0)
    return table[["closure", "impact", "stage", "check", "value", "bound", "holds", "excess"]]


def first_failures(table: pd.DataFrame) -> pd.DataFrame:
    """The first impact (and there the first stage) at which each closure violates each bound.

    Returns: Columns ``closure, check, impact, stage, value, excess``; no row for a bound that is never violated.

    Examples
    --------
    >>> from rattle.closure import mean_map
    >>> from rattle.scene import DAT21, Scene
    >>> first_failures(realizability_table([mean_map(Scene.from_gears(DAT21), impacts=2, closure="published")])).empty
    True
    """
    failed = ~table["holds"].fillna(True).astype(bool)
    first = failed.groupby([table["closure"], table["check"]], sort=False).idxmax()  # the rows are in order of impact
    columns = ["closure", "check", "impact", "stage", "value", "excess"]
    return table.loc[first[failed[first].to_numpy()], columns].reset_index(drop=True)
