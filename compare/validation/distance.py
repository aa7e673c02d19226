"""Distance of a closure's section density from the sampled one, compared with the distance due to sampling alone."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import kolmogi

from rattle.closure import MeanMap
from rattle.montecarlo import Ensemble
from rattle.scene.elementary import gauss_legendre
from rattle.scene.moments import SECTION

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CONFIDENCE = 0.95  # of the Kolmogorov floor
REACH = 10.0  # sds on both sides of its mean over which a density is integrated
STEP = 0.25  # width of a quadrature panel in sds of the density, where bins are wider
NODES, WEIGHTS = gauss_legendre(5)
ATOM = 0.5  # share of the paths in one bin from which on the sample is an atom and not a density
VARIES = 1e-6  # share of the largest sd at an impact below which a quantity's own sd is rounding


class Distances(NamedTuple):
    """Distances of two distributions on the same bins, and their sampling floors; definitions in `distances`."""

    kolmogorov: float
    kolmogorov_floor: float
    total_variation: float
    total_variation_floor: float


def bin_masses(density: Callable[[Floats], Floats | None], edges: Floats, mean: float, sd: float) -> Floats:
    """Mass of a density below, in and above the bins; Gauss-Legendre on panels no wider than a bin.

    `mean`, `sd`: Of the density.  Panels are no wider than a quarter of the sd, so that a density much narrower
    than a bin is resolved. Returns: The first is integrated from 10 sds below the mean; the last is the
    remainder, so that all sum to 1.  A mass is negative where the density is. Shapes: `edges` (bins + 1,); result
    (bins + 2,).

    Examples
    --------
    >>> from rattle.closure.edgeworth import section_density
    >>> bin_masses(lambda z: section_density(z, 0.0, 1.0, 0.0), np.array([-1.0, 0.0, 1.0]), 0.0, 1.0).round(6).tolist()
    [0.158655, 0.341345, 0.341345, 0.158655]
    """
    own = mean + sd * np.arange(-REACH, REACH + STEP, STEP)
    panels = np.union1d(edges, own)
    half = 0.5 * np.diff(panels)[:, None]
    points = panels[:-1, None] + half * (1.0 + NODES)
    mass = (half * WEIGHTS * np.asarray(density(points.ravel())).reshape(points.shape)).sum(axis=1)
    below = np.concatenate([[0.0], np.cumsum(mass)])[np.searchsorted(panels, edges)]
    return np.diff(np.concatenate([[0.0], below, [1.0]]))


def distances(masses: Floats, counts: Ints) -> Distances:
    """Kolmogorov and total variation distance of a density from a sample on the same bins.

    Returns: ``kolmogorov`` is the largest difference of the distribution functions at the edges of the bins;
    ``total_variation`` half the sum of the absolute differences, in [0, 1] unless a mass is negative.
    ``kolmogorov_floor`` is the 95 % quantile of Kolmogorov's limit distribution over sqrt(n), conservative on
    bins; ``total_variation_floor`` the expected value for a sample of the true density. Shapes: `masses` (bins +
    2,); `counts` (bins + 2,).

    Examples
    --------
    >>> distances(np.array([0.0, 0.5, 0.5, 0.0]), np.array([0, 75, 25, 0]))[::2]
    (0.25, 0.25)
    """
    n = int(counts.sum())
    shares = counts / n
    gap = masses - shares
    # A count is binomial, nearly normal: E|N(0, s^2)| = s sqrt(2/pi) with s^2 = p (1 - p) / n, and half of the sum.
    # The sampled shares stand for the unknown p.
    tv_floor = np.sqrt(shares * (1.0 - shares) / (2.0 * np.pi * n)).sum()
    return Distances(
        float(np.abs(np.cumsum(gap)[:-1]).max()),
        float(kolmogi(1.0 - CONFIDENCE) / np.sqrt(n)),
        float(0.5 * np.abs(gap).sum()),
        float(tv_floor),
    )


def section_distances(prediction: MeanMap, run: Ensemble) -> pd.DataFrame:
    """Distance of a closure's section densities from the histograms of a run of the same scene.

    Returns: Columns ``closure, impact, quantity, kolmogorov, kolmogorov_floor, total_variation,
    total_variation_floor, paths``; distances are shares of the probability, see `distances`.  ``paths`` is how
    many reached the impact. A row only where the closure has a density and the quantity varies on both sides: not
    the displacement at the mesh that most paths strike.

    Notes
    -----
    The step bias is no error of the closure, yet at small noise it is many times the sampling floor: the mean impact
    time is off by a fixed share of dt, whatever its sd.  If the run measured its step bias, the sample is shifted and
    scaled to the mean and sd from Richardson extrapolation, and only the bias of the shape remains; else the whole
    bias is part of every distance.

    Examples
    --------
    >>> from rattle.closure import mean_map
    >>> from rattle.montecarlo import Record, simulate
    >>> from rattle.scene import DAT21, Scene
    >>> scene = Scene.from_gears(DAT21, sigma=0.02)
    >>> run = simulate(scene, paths=10_000, impacts=1, rng=7, record=Record(histogram=True))
    >>> table = section_distances(mean_map(scene, impacts=1, closure="saltation"), run).set_index("quantity")
    >>> bool((table["kolmogorov"] < 1.5 * table["kolmogorov_floor"]).all())
    True
    """
    prediction, run = prediction.phase_reduced, run.phase_reduced
    predicted, sampled, histograms = prediction.section, run.section, run.histograms
    assert histograms is not None
    limit = _limits(run)
    records = []
    for impact in range(1, min(prediction.trace.found, run.impacts) + 1):
        for quantity in find_varying(predicted, impact):
            density = partial(prediction.density, impact, quantity)
            mean, sd = (float(predicted[prefix + quantity].loc[impact]) for prefix in ("", "sd_"))
            counts = histograms.counts[impact - 1, SECTION.index(quantity)]
            is_atom = counts.max() > ATOM * counts.sum()  # paths at the wall, except for a few that struck elsewhere
            if is_atom or quantity not in find_varying(sampled, impact) or density(np.array([mean])) is None:
                continue
            seen = [float(sampled[prefix + quantity].loc[impact]) for prefix in ("", "sd_")]
            true_mean, true_sd = limit.get((impact, quantity), seen)
            edges, _ = histograms.density(impact, quantity)
            masses = bin_masses(density, true_mean + (edges - seen[0]) * (true_sd / seen[1]), mean, sd)
            key = {"closure": prediction.closure, "impact": impact, "quantity": quantity}
            records.append({**key, **distances(masses, counts)._asdict(), "paths": int(counts.sum())})
    return pd.DataFrame(records, columns=["closure", "impact", "quantity", *Distances._fields, "paths"])


def find_varying(section: pd.DataFrame, impact: int) -> list[str]:
    """Quantities whose sd is more than rounding error, compared with the largest sd at that impact."""
    sds = {q: float(section[f"sd_{q}"].loc[impact]) for q in SECTION}
    return [q for q in SECTION if sds[q] > VARIES * np.nanmax([0.0, *sds.values()])]


def _limits(run: Ensemble) -> dict[Any, list[float]]:
    """Mean and sd corrected for the step bias, by impact and quantity; empty if the run did not measure it."""
    if "fine_coarse" not in run.result.sums:
        return {}
    return run.step_bias.pivot(index="moment", columns=["impact", "quantity"], values="corrected").to_dict("list")
