"""Bifurcation diagrams: histograms of a section quantity against a field of the scene.

The section is the Poincaré section at the impacts: flight time and velocities just before each impact.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.compare.chaos.over_field import cells_table, over_field
from rattle.compare.chaos.record import NoRecord, Regime, check_finite, noisy_record, orbit_record
from rattle.compare.chaos.section import NOISY, ORBIT
from rattle.scene.scene import Scene
from rattle.scene.validate import choice, count

Floats = NDArray[np.float64]

QUANTITIES = ("y1", "y2", "flight")
BINS = 300


@dataclass(frozen=True)
class Bifurcation:
    """Histograms of a section quantity, one for each value of a field."""

    field: str
    quantity: str
    at: Floats  # values of the field; (values,)
    edges: Floats  # edges of the quantity's bins; (bins + 1,)
    # for ``orbit`` and ``noisy system``; zero where the orbit sticks often or for good; (values, bins)
    counts: dict[str, NDArray[np.int64]]
    regime: pd.DataFrame  # per side and value: ``side, value, points, regime, reason``

    @property
    def table(self) -> pd.DataFrame:
        """Bins that are not empty: ``side``, the field, the quantity (middle of the bin), ``count``."""
        parts = [
            cells_table(side, self.field, self.at, self.edges, self.quantity, cells, "count")
            for side, cells in self.counts.items()
        ]
        return pd.concat(parts, ignore_index=True)


def bifurcation(
    scene: Scene,
    at: Sequence[float],
    *,
    field: str = "alpha",
    quantity: str = "y1",
    points: int = 10_000,
    noise: Callable[[Scene], Scene] | None = None,
    seed: int = 0,
    workers: int = 2,
) -> Bifurcation:
    """Compute the bifurcation diagram of the orbit and of the noisy system.

    `noise`: Maps each scene to the same with its noise set; without it, the noise of `scene` is used.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> b = bifurcation(Scene.from_gears(DAT21, sigma=0.1), (0.05, 0.5), points=500)
    >>> b.regime.query("side == 'orbit'")["regime"].tolist()
    ['sticks often', 'runs']
    """
    choice("quantity", quantity, QUANTITIES)
    count("points", points)
    count("workers", workers)

    def values_of(flight: Floats, before: Floats) -> Floats:
        found = flight if quantity == "flight" else before[:, 1 if quantity == "y1" else 3]
        return check_finite(quantity, found)

    def of(s: Scene) -> tuple[tuple[Floats, Regime], tuple[Floats, Regime]]:
        orbit, path = Regime(), Regime()
        found = [values_of(x.flight, x.before) for x in orbit_record(s, points, orbit, tangent=False)]
        if not orbit.has_record:
            found = []
        noisy: list[Floats] = []
        for x, _ in noisy_record(s, 2**30, seed, path, tangent=False):
            noisy.append(values_of(x.flight, x.before))
            if path.impacts >= points:
                break
        empty = np.empty(0)
        return (np.concatenate([empty, *found]), orbit), (np.concatenate([empty, *noisy])[:points], path)

    found = over_field(scene, at, field, noise, workers, of)
    every = np.concatenate([v for pair in found for v, _ in pair])
    if every.size == 0:
        raise NoRecord(f"the noisy path {found[0][1][1].brief}")
    low, high = np.quantile(every, [1e-4, 1.0 - 1e-4])
    edges = np.linspace(low, high, BINS + 1)
    counts, rows = {}, []
    for n, side in enumerate((ORBIT, NOISY)):
        counts[side] = np.array([np.histogram(pair[n][0], edges)[0] for pair in found])
        rows += [
            {
                "side": side,
                "value": v,
                "points": pair[n][0].size,
                "regime": pair[n][1].kind,
                "reason": pair[n][1].reason,
            }
            for v, pair in zip(at, found, strict=True)
        ]
    return Bifurcation(field, quantity, np.asarray(at, dtype=float), edges, counts, pd.DataFrame(rows))
