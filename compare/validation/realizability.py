"""Whether a closure's moments and densities can belong to a distribution, and how far its densities
are from a sample.

The correlation alone says little: a set of moments is realizable if and only if every polynomial's
square has a mean that is not negative, so the moment matrix decides (necessary in two variables,
Hamburger's condition in one). Edgeworth densities are judged separately: a truncated series can be
negative although its moments are realizable.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.special import kolmogi

from rattle.closure import MeanMap
from rattle.montecarlo import Ensemble
from rattle.scene import Floats, Ints, section_names
from rattle.scene.elementary import gauss_legendre
from rattle.scene.moments import RHO_ROUNDING, central_from_raw, correlation

KOLMOGOROV_CONFIDENCE = 0.95  # of the Kolmogorov floor
DENSITY_REACH = 10.0  # sds on both sides of its mean over which a density is integrated
PANEL_WIDTH = 0.25  # width of a quadrature panel in sds of the density, where bins are wider
NODES, WEIGHTS = gauss_legendre(5)
ATOM = 0.5  # share of the paths in one bin from which on the sample is an atom and not a density
VARIES = 1e-6  # share of the largest sd at an impact below which a quantity's own sd is rounding


class Distances(NamedTuple):
    """Distances of two distributions on the same bins, and their sampling floors; definitions in
    `distances`."""

    kolmogorov: float
    kolmogorov_floor: float
    total_variation: float
    total_variation_floor: float


def bin_masses(
    density: Callable[[Floats], Floats | None], edges: Floats, mean: float, sd: float
) -> Floats:
    """Mass of a density below, in and above the bins; Gauss-Legendre on panels no wider than a bin.

    `mean`, `sd`: Of the density.  Panels are no wider than a quarter of the sd, so that a density
    much narrower than a bin is resolved. Returns: The first is integrated from 10 sds below the
    mean; the last is the remainder, so that all sum to 1.  A mass is negative where the density is.
    Shapes: `edges` (bins + 1,); result (bins + 2,).
    """
    own = mean + sd * np.arange(-DENSITY_REACH, DENSITY_REACH + PANEL_WIDTH, PANEL_WIDTH)
    panels = np.union1d(edges, own)
    half = 0.5 * np.diff(panels)[:, None]
    points = panels[:-1, None] + half * (1.0 + NODES)
    mass = (half * WEIGHTS * np.asarray(density(points.ravel())).reshape(points.shape)).sum(axis=1)
    below = np.concatenate([[0.0], np.cumsum(mass)])[np.searchsorted(panels, edges)]
    return np.diff(np.concatenate([[0.0], below, [1.0]]))


def distances(masses: Floats, counts: Ints) -> Distances:
    """Kolmogorov and total variation distance of a density from a sample on the same bins.

    Returns: ``kolmogorov`` is the largest difference of the distribution functions at the edges of
    the bins; ``total_variation`` half the sum of the absolute differences, in [0, 1] unless a mass
    is negative. ``kolmogorov_floor`` is the 95 % quantile of Kolmogorov's limit distribution over
    sqrt(n), conservative on bins; ``total_variation_floor`` the expected value for a sample of the
    true density. Shapes: `masses` (bins + 2,); `counts` (bins + 2,).
    """
    n = counts.sum()
    shares = counts / n
    gap = masses - shares
    # A count is binomial, nearly normal: E|N(0, s^2)| = s sqrt(2/pi) with s^2 = p (1 - p) / n, and
    # half of the sum. The sampled shares stand for the unknown p.
    tv_floor = np.sqrt(shares * (1.0 - shares) / (2.0 * np.pi * n)).sum()
    return Distances(
        np.abs(np.cumsum(gap)[:-1]).max(),
        kolmogi(1.0 - KOLMOGOROV_CONFIDENCE) / np.sqrt(n),
        0.5 * np.abs(gap).sum(),
        tv_floor,
    )


def section_distances(prediction: MeanMap, run: Ensemble) -> pd.DataFrame:
    """Distance of a closure's section densities from the histograms of a run of the same scene.

    Returns: Columns ``closure, impact, quantity, kolmogorov, kolmogorov_floor, total_variation,
    total_variation_floor, paths``; distances are shares of the probability, see `distances`.
    ``paths`` is how many reached the impact. A row only where the closure has a density and the
    quantity varies on both sides: not the displacement at the mesh that most paths strike.

    If the run measured its step bias, the sample is shifted and scaled to the mean and sd of
    Richardson extrapolation, and only the bias of the shape remains; else all of it is part of
    every distance, at small noise most of it.
    """
    prediction = prediction.phase_reduced
    run = run.phase_reduced
    predicted = prediction.section
    sampled = run.section
    histograms = run.histograms
    names = section_names(run.scene.stages)
    assert histograms is not None
    # mean and sd corrected for the step bias, by impact and quantity
    limit: dict[Any, list[float]] = {}
    if "fine_coarse" in run.result.sums:
        places = run.step_bias.pivot(
            index="moment", columns=["impact", "quantity"], values="corrected"
        )
        limit = places.to_dict("list")
    records = []
    for impact in range(1, min(prediction.trace.found, run.impacts) + 1):
        for quantity in find_varying(predicted, impact):
            density = partial(prediction.density, impact, quantity)
            mean, sd = (predicted[prefix + quantity].loc[impact] for prefix in ("", "sd_"))
            counts = histograms.counts[impact - 1, names.index(quantity)]
            # paths at the wall, except for a few that struck elsewhere
            paths = counts.sum()
            is_atom = counts.max() > ATOM * paths
            varies = quantity in find_varying(sampled, impact)
            if is_atom or not varies or density(np.array([mean])) is None:
                continue
            seen = [sampled[prefix + quantity].loc[impact] for prefix in ("", "sd_")]
            true_mean, true_sd = limit.get((impact, quantity), seen)
            edges, _ = histograms.density(impact, quantity)
            shifted = true_mean + (edges - seen[0]) * (true_sd / seen[1])
            apart = distances(bin_masses(density, shifted, mean, sd), counts)
            records.append((prediction.closure, impact, quantity, *apart, paths))
    columns = ["closure", "impact", "quantity", *Distances._fields, "paths"]
    return pd.DataFrame(records, columns=columns)


def find_varying(section: pd.DataFrame, impact: int) -> list[str]:
    """Quantities whose sd is more than rounding error, compared with the largest sd at that
    impact."""
    sds = section.filter(regex="^sd_").loc[impact].astype(float)
    varying = sds.index[sds > VARIES * np.nanmax([0.0, *sds])]
    return list(varying.str.removeprefix("sd_"))


QUADRATURE = 1e-6
"""Negative mass below which a density counts as positive: less than one path in a million.

The quadrature gives a mass of this size to 0.1 %.  All other tolerances are
`rattle.scene.moments.RHO_ROUNDING`, relative to the largest of the terms that are compared; the
sign of a variance needs none.
"""

# sds on both sides of the mean, and points per axis, of the quadratures of negative parts
NEGATIVE_REACH = 8.0
NEGATIVE_POINTS = 481

NAN = float("nan")

CHECKS = {
    "variance of displacement": (0.0, 1, 0.0),
    "variance of velocity": (0.0, 1, 0.0),
    "|rho|": (1.0, -1, RHO_ROUNDING),
    "covariance eigenvalue": (0.0, 1, RHO_ROUNDING),
    "kurtosis": (0.0, 1, RHO_ROUNDING),
    "moment matrix": (0.0, 1, RHO_ROUNDING),
    "negative mass": (0.0, -1, QUADRATURE),
    "section negative mass": (0.0, -1, QUADRATURE),
}
"""Bound, sign and slack of each: moments of a distribution satisfy ``sign * (value - bound) >= 0``
but for rounding."""


class Statistic(NamedTuple):
    """Value that is checked, NaN where a moment is missing, and the size of the terms whose
    difference it is."""

    value: float
    scale: float = 1.0


def covariance_eigenvalue(covariance: Floats) -> float:
    """Smallest eigenvalue of a covariance matrix over its largest diagonal entry; negative for no
    distribution.

    Shapes: `covariance` (n, n).
    """
    if not np.isfinite(covariance).all():
        return NAN
    # with zero variances no covariance is possible, so the largest covariance sets the scale
    scale = np.abs(covariance.diagonal()).max() or np.abs(covariance).max() or 1.0
    return float(np.linalg.eigvalsh(covariance / scale)[0])


def kurtosis_margin(raw: Floats) -> Statistic:
    """``kurtosis - skewness^2 - 1``, the smaller one of both marginals: negative for no
    distribution.

    Pearson (1916), Phil. Trans. R. Soc. A 216, 429.  It is zero for distributions on two points.

    Shapes: `raw` (order + 1, order + 1).
    """
    if len(raw) < 5:
        return Statistic(NAN)
    margins = []
    for marginal in (raw[:5, 0], raw[0, :5]):
        m2, m3, m4 = central_from_raw(marginal)[2:]
        if m2 > 0.0 and np.isfinite(marginal).all():
            with np.errstate(over="ignore", invalid="ignore"):
                kurtosis = m4 / m2 / m2
                square = (m3 / m2**1.5) ** 2
            margins.append(Statistic(kurtosis - square - 1.0, max(abs(kurtosis), square, 1.0)))
    return min(margins, key=lambda m: m.value, default=Statistic(NAN))


def moment_matrix_eigenvalue(raw: Floats) -> Statistic:
    """Smallest eigenvalue of ``E[u^(n+m) v^(p+q)]`` over the monomials of degree up to half the
    order.

    ``u, v`` are displacement and velocity in units of the root of their second moment, so the value
    is dimensionless. It is the smallest mean square of a polynomial whose coefficient vector has
    length 1: negative for no distribution (Akhiezer 1965, The Classical Moment Problem, chapter 2).

    Shapes: `raw` (order + 1, order + 1).
    """
    order = len(raw) - 1
    monomials = [(n, p) for n in range(order // 2 + 1) for p in range(order // 2 + 1 - n)]
    scales = []
    for marginal in (raw[:, 0], raw[0, :]):
        # |variance| as scale keeps the sign of a negative variance; if it is 0, the other moments
        # set the scale
        other = max(abs(m) ** (1.0 / n) for n, m in enumerate(marginal) if n > 0)
        scales.append(float(np.sqrt(abs(marginal[2])) or other or 1.0))
    sd_x, sd_y = scales
    with np.errstate(over="ignore", invalid="ignore"):
        matrix = np.array(
            [
                [raw[n + m, p + q] / sd_x ** (n + m) / sd_y ** (p + q) for m, q in monomials]
                for n, p in monomials
            ]
        )
    if not np.isfinite(matrix).all():
        return Statistic(NAN)
    return Statistic(np.linalg.eigvalsh(matrix)[0], np.abs(matrix.diagonal()).max())


def negative_mass(values: Floats, spacing: float) -> float:
    """Mass of the negative part of a density given on a uniform grid of any dimension, by the
    rectangle rule.

    `values`: Density at the grid points; it vanishes at the grid's ends, so that this is the
    trapezoidal rule.
    """
    return float(np.maximum(-values, 0.0).sum() * spacing)


def _series_negative_mass(prediction: MeanMap, impact: int, stage: int) -> Statistic:
    raw = prediction.trace.raw[impact, stage - 1]
    if not (raw[2, 0] > 0.0 and raw[0, 2] > 0.0 and np.isfinite(raw).all()):
        return Statistic(NAN)  # no series can be formed
    series = prediction.edgeworth(impact, stage)
    z = np.linspace(-NEGATIVE_REACH, NEGATIVE_REACH, NEGATIVE_POINTS)
    cell = (z[1] - z[0]) ** 2 * series.sd_x * series.sd_y
    return Statistic(negative_mass(series.density_on_grid(z * series.sd_x, z * series.sd_y), cell))


def _section_negative_mass(prediction: MeanMap, impact: int) -> Statistic:
    """The largest over the quantities that vary and have a skewness."""
    table = prediction.phase_reduced.section
    masses = []
    for quantity in find_varying(table, impact):
        mean, sd, skew = (table[prefix + quantity].loc[impact] for prefix in ("", "sd_", "skew_"))
        grid = mean + sd * np.linspace(-NEGATIVE_REACH, NEGATIVE_REACH, NEGATIVE_POINTS)
        density = prediction.density(impact, quantity, grid)
        if density is not None and np.isfinite(skew):
            masses.append(negative_mass(density, grid[1] - grid[0]))
    return Statistic(max(masses, default=NAN))


def _statistics(prediction: MeanMap, impact: int) -> Iterator[tuple[int, str, Statistic]]:
    """Stage, name of the check and its statistic at one impact; stage 0 stands for all stages
    jointly."""
    if prediction.scene.stages > 1:
        joint = covariance_eigenvalue(prediction.trace.covariance[impact])
        yield 0, "covariance eigenvalue", Statistic(joint)
    yield 0, "section negative mass", _section_negative_mass(prediction, impact)
    for stage in range(1, prediction.scene.stages + 1):
        covariance = prediction.stage_covariance(impact, stage)
        raw = prediction.trace.raw[impact, stage - 1]
        known = np.isfinite(covariance).all()
        statistics = {
            "variance of displacement": Statistic(covariance[0, 0]),
            "variance of velocity": Statistic(covariance[1, 1]),
            "|rho|": Statistic(abs(correlation(covariance)) if known else NAN),
            "covariance eigenvalue": Statistic(covariance_eigenvalue(covariance)),
            "kurtosis": kurtosis_margin(raw),
            "moment matrix": moment_matrix_eigenvalue(raw),
            "negative mass": _series_negative_mass(prediction, impact, stage),
        }
        for check, statistic in statistics.items():
            yield stage, check, statistic


def realizability_table(predictions: Sequence[MeanMap]) -> pd.DataFrame:
    """Check the bounds that moments of any distribution satisfy, at each impact of each closure.

    Returns: Columns ``closure, impact, stage, check, value, bound, holds, excess`` (dimensionless).
    Stage 0 stands for all stages jointly.  ``holds`` is nullable: NA where the closure has no such
    moment, and then ``value`` and ``excess`` are NaN.  ``excess`` is the amount by which a bound is
    violated, 0 where it holds.

    ``variance of displacement`` and ``of velocity`` are not negative, ``|rho|`` is at most 1 (NA
    without variances). ``covariance eigenvalue``: the smallest, over the largest diagonal entry; of
    a stage, and at stage 0 of all quantities (NA for ``published``, which has no moments
    across the stages). ``kurtosis``, ``moment matrix``: see `kurtosis_margin` and
    `moment_matrix_eigenvalue`. ``negative mass``: of the stage's Edgeworth series (Eqs. 18, 19),
    within 8 sd.  A series truncated at order 4 is negative somewhere for every ``rho`` but 0: along
    an axis it is ``1 - rho^2 (u^2 - 1) / 2``.  So this check judges the truncation, and may fail
    although the moments are realizable. ``section negative mass``: the largest over the
    one-dimensional section densities with a skewness. A point mass satisfies every bound: it has no
    correlation, kurtosis or series, and these are NA.
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
    known = table["value"].notna()
    holds = missed <= table["slack"] * table["scale"]
    table["holds"] = holds.astype("boolean").where(known)
    table["excess"] = missed.mask(holds, 0.0)
    return table[["closure", "impact", "stage", "check", "value", "bound", "holds", "excess"]]


def first_failures(table: pd.DataFrame) -> pd.DataFrame:
    """The first impact (and there the first stage) at which each closure violates each bound.

    Returns: Columns ``closure, check, impact, stage, value, excess``; no row for a bound that is
    never violated.
    """
    failed = ~table["holds"].fillna(True).astype(bool)
    # the rows are in order of impact
    first = failed.groupby([table["closure"], table["check"]], sort=False).idxmax()
    columns = ["closure", "check", "impact", "stage", "value", "excess"]
    return table.loc[first[failed[first].to_numpy()], columns].reset_index(drop=True)
