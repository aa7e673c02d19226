"""The whole map: every scheme over every axis, from far inside the door to far outside, and at the default step."""

import time
from collections.abc import Sequence
from typing import NamedTuple

import pandas as pd
from tqdm import tqdm

from rattle.compare.checks.stability.axes import AXES
from rattle.compare.checks.stability.cell import BIASED, UNSTABLE, judged, looks
from rattle.compare.checks.stability.reference import IMPACTS, reference
from rattle.compare.validation.verdict import widest
from rattle.montecarlo import SCHEMES, default_step, largest_step
from rattle.montecarlo.diagnostics import COLLAPSE
from rattle.montecarlo.kernel.block import BLOCK
from rattle.scene.moments import SECTION

__all__ = ["PATHS", "SHARES", "Chart", "chart"]

PATHS = 32_768
REFERENCE = 4  # times as many paths of the reference
SHARES = (1 / 32, 1 / 8, 1 / 2, 1.0, 4.0, 16.0)
"""Steps, in units of the largest one that the door lets through."""
OUTSIDE = 8 * BLOCK  # most paths of a cell outside the door, where verdicts are plain, or whose paths collapse slowly


class Chart(NamedTuple):
    """What was measured.

    Attributes
    ----------
    table : DataFrame
        A row for each cell: ``scheme, axis, value, dt, share`` of the door's largest step, ``why`` that is the largest,
        ``default`` whether this is the default step, and what `rattle.compare.checks.stability.cell.Judged` has.
    z : float
        Standard errors of the intervals: all of them hold together with 95 %.
    seconds : float
    """

    table: pd.DataFrame
    z: float
    seconds: float

    @property
    def let_through(self) -> pd.DataFrame:
        """The cells inside the door."""
        return self.table[self.table["share"] <= 1.0]

    @property
    def untold(self) -> pd.DataFrame:
        """Cells that the door lets through, that are wrong, and whose run does not say so: there should be none."""
        inside = self.let_through
        return inside[inside["verdict"].isin((BIASED, UNSTABLE)) & ~inside["told"]]


def chart(
    *, schemes: Sequence[str] = tuple(SCHEMES), axes: Sequence[str] = tuple(AXES), points: int = 7, paths: int = PATHS,
    seed: int = 0, workers: int = 2,
) -> Chart:  # fmt: skip
    """Measure the map.

    Parameters
    ----------
    schemes, axes : sequence of str
        Names out of `montecarlo.SCHEMES` and `AXES`.
    points : int
        Values of each axis, of 7: both ends first.
    paths : int
        Most paths of a cell; a verdict that fewer allow is taken from these.
    seed : int
        The same noise for all cells of an axis, other noise for its reference.
    workers : int

    Examples
    --------
    >>> found = chart(schemes=["euler-maruyama"], axes=["sigma"], points=1, paths=1)
    >>> found.table.query("default")[["value", "verdict", "told"]].to_numpy().tolist()
    [[0.0, 'biased', True]]
    """
    began = time.perf_counter()
    places = [(axis, value) for axis in axes for value in _spread(AXES[axis].values, points)]
    cells = len(places) * len(schemes) * (len(SHARES) + 1)
    z = widest(cells * 2 * len(SECTION) * IMPACTS * looks(paths))
    rows = []
    with tqdm(total=cells, desc="stability", unit="cell", disable=None) as bar:
        for axis, value in places:
            scene = AXES[axis].scene(value)
            slow = scene.sigma > 0.0 and scene.epsilon < COLLAPSE
            enough = min(paths, (OUTSIDE if scene.epsilon > 0.0 else BLOCK)) if slow else paths
            beside = reference(scene, paths=REFERENCE * enough, seed=seed + 1, workers=workers)
            for scheme in schemes:
                largest, why = largest_step(scene, scheme)
                own = default_step(scene, scheme)
                steps = [(share * largest, share, False) for share in SHARES]
                for dt, share, default in (*steps, (own, own / largest, True)):
                    most = enough if share <= 1.0 else min(paths, OUTSIDE)
                    found = judged(scene, beside, scheme=scheme, dt=dt, paths=most, seed=seed, workers=workers, z=z)
                    rows.append(
                        {"scheme": scheme, "axis": axis, "value": value, "dt": dt, "share": share, "why": why}
                        | {"default": default} | found._asdict()
                    )  # fmt: skip
                    bar.update()
    return Chart(pd.DataFrame(rows), z, time.perf_counter() - began)


def _spread(values: Sequence[float], points: int) -> list[float]:
    """So many of the values, from end to end."""
    if points >= len(values):
        return list(values)
    return [values[round(i * (len(values) - 1) / max(points - 1, 1))] for i in range(points)]
