"""The whole map, at admissible and longer steps and at the default step; and exact flights against their covariance."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from tqdm import tqdm

from rattle.compare.checks.stability.cell import AXES, BIASED, IMPACTS, UNSTABLE, judge, looks, reference
from rattle.compare.validation.verdict import widest
from rattle.montecarlo import Record, default_step, largest_step, simulate
from rattle.montecarlo.diagnostics.diagnostics import COLLAPSE
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.settings.sampling import Sampling
from rattle.scene import Start
from rattle.scene.flight import noise_covariance
from rattle.scene.moments import SECTION, STATE

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
    schemes: Sequence[str], axes: Sequence[str], *, points: int, paths: int, seed: int = 0, workers: int = 2
) -> Chart:
    """Measure the map.

    `points`: Number of values on each axis, up to 7, spread from end to end. `paths`: Largest number of paths of
    a cell; fewer are simulated if they suffice for a verdict.
    """
    chosen = [round(i * 6 / max(points - 1, 1)) for i in range(points)]  # of the seven values of an axis
    places = [(axis, AXES[axis].values[i]) for axis in axes for i in chosen]
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
                    cell = {"scheme": scheme, "axis": axis, "value": value, "dt": dt, "share": share, "why": why}
                    rows.append(cell | {"default": default} | found._asdict())
                    bar.update()
    return Chart(pd.DataFrame(rows), z)


FLIGHT = 0.2  # flight time from tau = 0, where the noise has no modulation yet: the most demanding flight
OPEN = 1e6  # half gap that no path crosses
STEPS = (1 / 8, 1.0)  # time steps, in units of the longest admissible one
TOLERANCE = 0.10  # admissible relative error of an sd, as for the sds of the map


def covariance_table(*, points: int = 7, paths: int, seed: int, workers: int) -> pd.DataFrame:
    """Compare simulated sds after a flight with `rattle.scene.flight.noise_covariance`, for each damping of the map.

    Returns: Columns ``beta, dt, share`` (dt over the longest admissible step); for the quantity with the largest
    error ``quantity, error`` (relative, of its sd) and ``half`` (half width of its interval); ``holds`` (whether
    all quantities are within 10 %).
    """
    values = AXES["beta"].values[:points]
    z = widest(len(values) * len(STEPS) * len(STATE))
    rows = []
    for beta in values:
        start = Start(0.0, 0.0, 0.0, 0.0, 0.0, mesh=0)
        scene = replace(AXES["beta"].scene(beta), gap1=OPEN, gap2=OPEN, start=start)
        largest, _ = largest_step(scene, "exact-flight")
        for share in STEPS:
            steps = np.ceil(FLIGHT / (share * largest))
            chosen: dict[str, Any] = {"dt": FLIGHT / steps, "rng": seed, "workers": workers}
            sampling, record = Sampling(horizon=1.5 * FLIGHT), Record(times=[FLIGHT])
            run = simulate(scene, paths=paths, impacts=1, sampling=sampling, record=record, **chosen)
            table = run.at_times().iloc[0]
            exact = np.diag(noise_covariance(scene.constants, 0.0, FLIGHT))
            found = np.array([table[f"cov_{q}_{q}"] for q in STATE])
            se = np.array([table[f"se_cov_{q}_{q}"] for q in STATE])
            varies = exact > 1e-12 * exact.max()
            error = np.where(varies, np.sqrt(found / np.where(varies, exact, 1.0)) - 1.0, 0.0)
            half = np.where(varies, z * se / np.where(varies, 2.0 * exact, 1.0), 0.0)
            k = int((np.abs(error) + half).argmax())
            holds = bool((np.abs(error) + half <= TOLERANCE).all())
            rows.append((beta, run.dt, share, STATE[k], float(error[k]), float(half[k]), holds))
    return pd.DataFrame(rows, columns=["beta", "dt", "share", "quantity", "error", "half", "holds"])
