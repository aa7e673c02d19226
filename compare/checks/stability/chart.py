"""The whole map: every scheme over every axis, at admissible and longer steps, and at the default step."""

import time
from collections.abc import Sequence
from typing import NamedTuple

import pandas as pd
from tqdm import tqdm

from rattle.compare.checks.stability.axes import AXES
from rattle.compare.checks.stability.cell import BIASED, UNSTABLE, judge, looks
from rattle.compare.checks.stability.reference import IMPACTS, reference
from rattle.compare.validation.verdict import widest
from rattle.montecarlo import SCHEMES, default_step, largest_step
from rattle.montecarlo.diagnostics.diagnostics import COLLAPSE
from rattle.montecarlo.kernel.block import BLOCK
from rattle.scene.moments import SECTION

PATHS = 32_768
REFERENCE = 4  # the reference has so many times the paths of a cell
SHARES = (1 / 32, 1 / 8, 1 / 2, 1.0, 4.0, 16.0)
"""Time steps, in units of the longest admissible one."""
OUTSIDE = 8 * BLOCK  # most paths of a cell with an inadmissible step (large errors), or with slowly collapsing paths


class Chart(NamedTuple):
    """The measured map."""

    # A row for each cell: ``scheme, axis, value, dt, share`` (dt over the longest admissible step), ``why`` (what
    # limits that step), ``default`` (whether dt is the default step), and the attributes of
    # `rattle.compare.checks.stability.cell.Judged`
    table: pd.DataFrame
    z: float  # half width of the intervals in standard errors, for 95 % simultaneous coverage
    seconds: float  # wall time

    @property
    def admissible(self) -> pd.DataFrame:
        """The cells with an admissible step."""
        return self.table[self.table["share"] <= 1.0]

    @property
    def without_diagnostic(self) -> pd.DataFrame:
        """Admissible cells that are biased or unstable without a diagnostic of the run: there should be none."""
        cells = self.admissible
        return cells[cells["verdict"].isin((BIASED, UNSTABLE)) & ~cells["diagnosed"]]


def chart(
    *,
    schemes: Sequence[str] = tuple(SCHEMES),
    axes: Sequence[str] = tuple(AXES),
    points: int = 7,
    paths: int = PATHS,
    seed: int = 0,
    workers: int = 2,
) -> Chart:
    """Measure the map.

    `points`: Number of values on each axis, up to 7, spread from end to end. `paths`: Largest number of paths of
    a cell; fewer are simulated if they suffice for a verdict.
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
                    found = judge(scene, beside, scheme=scheme, dt=dt, paths=most, seed=seed, workers=workers, z=z)
                    rows.append(
                        {"scheme": scheme, "axis": axis, "value": value, "dt": dt, "share": share, "why": why}
                        | {"default": default}
                        | found._asdict()
                    )
                    bar.update()
    return Chart(pd.DataFrame(rows), z, time.perf_counter() - began)


def _spread(values: Sequence[float], points: int) -> list[float]:
    """Choose so many of the values, spread from end to end."""
    if points >= len(values):
        return list(values)
    return [values[round(i * (len(values) - 1) / max(points - 1, 1))] for i in range(points)]
