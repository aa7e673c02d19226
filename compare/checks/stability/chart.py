"""The map: scenes on its axes with their references, verdicts on a scheme with a time step there,
and the whole of it.

Steps are admissible and longer ones, and the default step.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.compare.engine.run import obtain_all
from rattle.compare.engine.store import Cell
from rattle.compare.judge.verdict import Tolerances, Verdict
from rattle.compare.report.json_text import Facts
from rattle.montecarlo import Ensemble, Sampling, default_step, largest_step, simulate
from rattle.montecarlo.diagnostics.diagnostics import (
    COLLAPSE,
    diagnose_rare_branch,
    diagnose_short_step,
    motion_units,
)
from rattle.montecarlo.diagnostics.reference import at_wall
from rattle.montecarlo.ensemble.simulate import extend
from rattle.montecarlo.kernel.block import BLOCK, BlockResult
from rattle.montecarlo.kernel.blocks import Blocks, in_threads
from rattle.montecarlo.looks import ladder
from rattle.montecarlo.settings import is_random, plan_of
from rattle.montecarlo.statistics.intervals import widest
from rattle.scene import DAT21, Floats, Scene, Start, section_names
from rattle.scene.orbit import follow

CHART_SIGMA = 0.3
HALF_GAP = 0.5
# of the start: its phase, and x2 over the half gap
PHASE = 1.0
INSIDE = 0.2
CHART_SPEED = 2.0  # speed of the start in the half gap of DAT21


def moderate(
    *,
    beta: float | None = None,
    gap: float = HALF_GAP,
    sigma: float = CHART_SIGMA,
    epsilon: float = 0.9,
) -> Scene:
    """Build DAT21 with some fields changed, and a start at a matching speed.

    The start is just before an impact at mesh 1, at a phase where the noise acts; the second stage
    is inside its gap, so that the two meshes are not struck together.  The speed is proportional to
    the square root of the gap g, as under constant acceleration.  It is at least ``(g
    sigma^2)^(1/3)``, which noise creates in a crossing, and at least g, so that a wide gap is
    crossed before the velocity is damped.
    """
    pair = Scene.from_gears(DAT21)
    speed = max(CHART_SPEED * math.sqrt(gap / HALF_GAP), (gap * sigma**2) ** (1.0 / 3.0), gap)
    if beta is not None:
        pair = replace(pair, beta1=beta, beta2=beta * pair.beta2 / pair.beta1)
    start = Start(PHASE, gap, speed, INSIDE * gap, speed, mesh=1)
    pair = replace(pair, gears=None, start=start, gap1=gap, gap2=gap)
    return replace(pair, sigma=sigma, epsilon=epsilon)


AXES = {
    "beta": (r"damping $\beta_1$", (0.0, 1e-3, 0.1, 1.0, 10.0, 100.0, 1e3)),
    "gap": ("half gap $g$", (1e-8, 1e-6, 1e-4, 1e-2, 0.5, 30.0, 1e4)),
    "sigma": (r"noise $\sigma$", (0.0, 1e-3, 0.03, 0.3, 3.0, 100.0, 1e4)),
    "epsilon": (r"restitution $\epsilon$", (0.0, 0.1, 0.3, 0.6, 0.9, 0.99, 1.0)),
}
"""All axes by the argument of `moderate` that varies: the symbol in the figure, and the values."""


CHART_IMPACTS = 4
FINER = 4.0  # the default step of exact flights over the step of the reference
# excess kurtosis above which too few paths contribute to an sd for a reliable error
MOST_KURTOSIS = 30.0
CROSSINGS = 40.0  # horizon of a path, in crossings of a half gap at the speed of the start


class Reference(NamedTuple):
    """Reference section moments of a cell."""

    # means, sds and their standard errors, as `Ensemble.columns`
    columns: Mapping[str, NDArray[Any]]
    # units of the errors, see `rattle.montecarlo.diagnostics.diagnostics.motion_units`; NaN where
    # none is judged
    unit: dict[str, Floats]
    late: float  # share of the paths that did not complete their impacts before the horizon


def horizon_of(scene: Scene) -> float:
    """Compute the time after which a path is abandoned."""
    return CROSSINGS * scene.gap1 / abs(scene.start.y1)


def reference(scene: Scene, *, paths: int, seed: int) -> Reference:
    """Compute the reference by exact flights at a quarter of their default step, or by root finding
    without noise.

    Not judged are the quantities that `rattle.compare.judge.verdict.RULE` leaves out, and
    those whose variance comes from less than about 3 % of the paths, for which standard errors are
    unreliable.
    """
    columns = _orbit(scene)
    late = 0.0
    if scene.sigma > 0.0:
        run = simulate(
            scene,
            paths=paths,
            impacts=CHART_IMPACTS,
            dt=default_step(scene, "exact-flight") / FINER,
            rng=seed,
            sampling=Sampling(horizon=horizon_of(scene)),
        )
        columns = run.columns
        late = run.unfinished / run.paths
    unit = motion_units(columns, scene)
    for q in section_names(scene.stages):
        rare = np.nan_to_num(columns["kurt_" + q]) > MOST_KURTOSIS
        excluded = at_wall(q, columns["mesh"]) | rare | np.isnan(columns[q])
        unit[q] = np.where(excluded, np.nan, unit[q])
    return Reference(columns, unit, late)


def _orbit(scene: Scene) -> Mapping[str, NDArray[Any]]:
    """The noise-free path by root finding, in the columns of an ensemble."""
    path = follow(scene, CHART_IMPACTS)
    columns = {str(name): column.to_numpy()[1:] for name, column in path.table.items()}
    columns["flight"] = path.flight[1:]
    quantities = section_names(scene.stages)
    spreads = [prefix + q for q in quantities for prefix in ("sd_", "se_", "se_sd_", "kurt_")]
    return columns | dict.fromkeys(spreads, np.zeros(CHART_IMPACTS))


UNBIASED = "unbiased"
BIASED = "biased"
CHART_UNDECIDED = Verdict.UNDECIDED
UNSTABLE = "unstable"
COLLAPSING = "no limit"
FIRST_PATHS = 2 * BLOCK  # paths of the first attempt at a verdict
PATHS_GROWTH = 8  # factor on the number of paths while the verdict is undecided
LATE = 0.05  # admissible excess of the share of abandoned paths over that of the reference
FAST = 10.0  # speeds above so many times those of the reference count as unstable


class Judged(NamedTuple):
    """The verdict on a cell, with its evidence."""

    # ``unbiased``: all moments are within the tolerance, intervals included.  ``biased``: one of
    # them is outside, interval included.  ``undecided``: neither.  ``unstable``: moments are not
    # finite, speeds are ten times too large, or paths are abandoned.  ``no limit``: the scheme
    # cannot converge as the step decreases
    verdict: str
    # error, half: error of the decisive moment, and the half width of its interval, in units of the
    # tolerance
    error: float
    half: float
    where: str  # the decisive moment, or the kind of instability
    # whether the run reports a diagnostic of its step; that a default step was shortened does not
    # count
    diagnosed: bool
    paths: int  # simulated paths
    moments: int  # number of moments that are judged


def sizes(paths: int) -> tuple[int, ...]:
    """Numbers of paths after which a verdict is attempted."""
    return ladder(min(paths, FIRST_PATHS), paths, PATHS_GROWTH)


def judge(
    scene: Scene,
    beside: Reference,
    *,
    scheme: str,
    dt: float,
    paths: int,
    seed: int,
    z: float,
) -> Judged:
    """Simulate a cell with any time step, with more paths while the verdict is undecided, and judge
    it."""
    sampling = Sampling(horizon=max(horizon_of(scene), 4.0 * dt))
    blocks = in_threads(1)
    first, *later = sizes(paths)
    with np.errstate(all="ignore"):  # unstable runs overflow
        plan = plan_of(
            scene, first, CHART_IMPACTS, dt, scheme, seed, sampling=sampling, any_step=True
        )
        merged = reduce(BlockResult.merge, (result for result, _ in blocks(plan, 0)))
        run = Ensemble(plan, first, merged, None, None, 0.0)
        verdict = _verdict(run, beside, z)
        while later and verdict[0] == CHART_UNDECIDED and is_random(scene):
            run = extend(run, later.pop(0), blocks)
            verdict = _verdict(run, beside, z)
        diagnosed = len(run.diagnostics) > bool(diagnose_short_step(run)) + bool(
            diagnose_rare_branch(run)
        )
        moments = 2 * sum(np.isfinite(unit).sum() for unit in beside.unit.values())
        return Judged(*verdict, diagnosed, run.plan.paths, moments)


def _verdict(run: Ensemble, beside: Reference, z: float) -> tuple[str, float, float, str]:
    """The first four attributes of `Judged`."""
    a = run.columns
    b = beside.columns
    rows = []
    for prefix, moment in (("", "mean"), ("sd_", "sd")):
        for quantity, size in beside.unit.items():
            name = prefix + quantity
            unit = getattr(Tolerances(), moment) * size
            off = np.abs(a[name] - b[name]) / unit
            half = z * np.hypot(a[f"se_{name}"], b[f"se_{name}"]) / unit
            for k in np.flatnonzero(np.isfinite(unit)):
                rows.append((off[k], half[k], f"{moment} of {quantity} at impact {k + 1}"))
    error, half = np.array([row[:2] for row in rows]).T
    where = ""
    decisive = error
    if run.scene.sigma > 0.0 and run.scene.epsilon == 0.0:
        verdict = COLLAPSING
        where = "at restitution 0 noise makes infinitely many impacts in a finite time"
    elif where := _describe_instability(run, beside):
        verdict = UNSTABLE
    elif (error - half > 1.0).any():
        verdict = BIASED
        decisive = error - half
    else:
        decisive = error + half
        verdict = UNBIASED if (decisive <= 1.0).all() else CHART_UNDECIDED
    worst = np.nan_to_num(decisive, nan=np.inf).argmax()
    return verdict, error[worst], half[worst], where or rows[worst][2]


def _describe_instability(run: Ensemble, beside: Reference) -> str:
    """Description of an instability; empty if there is none."""
    reached = np.isfinite(beside.columns["tau"])
    moments = [run.columns[q][reached] for q in ("tau", "y1", "y2", "sd_y1", "sd_y2")]
    if not np.isfinite(moments).all():
        return "moments are not finite"
    ours, theirs = (
        np.nanmax([np.hypot(c[y], c[f"sd_{y}"]) for y in ("y1", "y2")])
        for c in (run.columns, beside.columns)
    )
    if ours > FAST * theirs:
        return f"speeds are {ours / theirs:.1e} times those of the reference"
    if run.unfinished > (beside.late + LATE) * run.paths:
        return f"{run.unfinished / run.paths:.0%} of the paths were abandoned"
    return ""


REFERENCE = 4  # the reference has so many times the paths of a cell
SHARES = (1 / 32, 1 / 8, 1 / 2, 1.0, 4.0, 16.0)
"""Time steps, in units of the longest admissible one."""
# most paths of a cell with an inadmissible step (large errors), or with slowly collapsing paths
OUTSIDE = 8 * BLOCK


class Chart(NamedTuple):
    """The measured map."""

    # A row for each cell: ``scheme, axis, value, dt, share`` (dt over the longest admissible step),
    # ``why`` (what limits that step), ``default`` (whether dt is the default step), and the
    # attributes of `Judged`
    table: pd.DataFrame
    z: float  # half width of the intervals in standard errors, for 95 % simultaneous coverage

    @property
    def admissible(self) -> pd.DataFrame:
        """The cells with an admissible step."""
        return self.table[self.table["share"] <= 1.0]

    @property
    def without_diagnostic(self) -> pd.DataFrame:
        """Admissible cells that are biased or unstable without a diagnostic of the run: there
        should be none."""
        cells = self.admissible
        return cells[cells["verdict"].isin((BIASED, UNSTABLE)) & ~cells["diagnosed"]]


@dataclass(frozen=True)
class Place(Cell):
    """The cells of the map at one value of an axis: every scheme, at every step."""

    packages = (
        "closure",
        "montecarlo",
        "compare/checks/stability",
        "compare/validation",
    )
    group = "places of the map"

    scene: Scene
    axis: str
    value: float
    schemes: tuple[str, ...]
    paths: int
    seed: int
    z: float

    @property
    def label(self) -> str:
        """Short description for the progress line."""
        return f"{self.axis} = {self.value:g}"

    @property
    def settings(self) -> Facts:
        """Everything that determines the result besides the scene."""
        return {"kind": "stability"} | self.list_fields()

    def evaluate(self, blocks: Blocks | None = None) -> tuple[pd.DataFrame, Facts]:
        """Judge the cells."""
        scene = self.scene
        rows = []
        slow = scene.sigma > 0.0 and scene.epsilon < COLLAPSE
        outside = min(self.paths, OUTSIDE)
        enough = min(self.paths, OUTSIDE if scene.epsilon > 0.0 else BLOCK) if slow else self.paths
        beside = reference(scene, paths=REFERENCE * enough, seed=self.seed + 1)
        attempt = partial(judge, scene, beside, seed=self.seed, z=self.z)
        for scheme in self.schemes:
            largest, why = largest_step(scene, scheme)
            default_dt = default_step(scene, scheme)
            steps = [(share * largest, share, False) for share in SHARES]
            for dt, share, default in (*steps, (default_dt, default_dt / largest, True)):
                judged = attempt(scheme=scheme, dt=dt, paths=enough if share <= 1.0 else outside)
                rows.append((scheme, self.axis, self.value, dt, share, why, default, *judged))
        names = ["scheme", "axis", "value", "dt", "share", "why", "default", *Judged._fields]
        return pd.DataFrame(rows, columns=names), {}


def chart(
    schemes: Sequence[str],
    axes: Sequence[str],
    *,
    points: int,
    paths: int,
    seed: int,
    workers: int,
    folder: Path | None = None,
) -> Chart:
    """Measure the map.

    `points`: Number of values on each axis, up to 7, spread from end to end. `paths`: Largest
    number of paths of a cell; fewer are simulated if they suffice for a verdict. `folder`: Where
    results are stored: the same map continues there after an interruption.
    """
    chosen = [round(i * 6 / max(points - 1, 1)) for i in range(points)]
    places = [(axis, AXES[axis][1][i]) for axis in axes for i in chosen]
    rows = 2 * len(section_names(2)) * CHART_IMPACTS
    cells_of_a_place = len(schemes) * (len(SHARES) + 1)
    z = widest(len(places) * cells_of_a_place * rows * len(sizes(paths)))
    cells = [
        Place(moderate(**{axis: value}), axis, value, tuple(schemes), paths, seed, z)
        for axis, value in places
    ]
    tables = [content.table for content in obtain_all(cells, folder, workers)]
    return Chart(pd.concat(tables, ignore_index=True), z)
