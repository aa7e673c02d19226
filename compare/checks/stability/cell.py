"""A cell of the map: one scheme, one scene and one time step, admissible or not, and the verdict on it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.compare.checks.stability.reference import IMPACTS, Reference, horizon_of
from rattle.compare.validation.verdict import Tolerances
from rattle.montecarlo import Ensemble
from rattle.montecarlo.diagnostics.diagnostics import diagnose_rare_branch, diagnose_short_step
from rattle.montecarlo.ensemble.simulate import extend
from rattle.montecarlo.kernel.block import BLOCK, BlockResult
from rattle.montecarlo.kernel.blocks import in_threads
from rattle.montecarlo.settings.plan import is_random, plan_of
from rattle.montecarlo.settings.sampling import Sampling
from rattle.scene import Scene
from rattle.scene.moments import SECTION

Floats = NDArray[np.float64]

UNBIASED, BIASED, UNDECIDED, UNSTABLE, COLLAPSING = VERDICTS = (
    "unbiased",
    "biased",
    "undecided",
    "unstable",
    "no limit",
)

FIRST = 2 * BLOCK  # paths of the first attempt at a verdict
GROWTH = 8  # factor on the number of paths while the verdict is undecided
LATE = 0.05  # admissible excess of the share of abandoned paths over that of the reference
FAST = 10.0  # speeds above so many times those of the reference count as unstable


class Judged(NamedTuple):
    """The verdict on a cell, with its evidence."""

    # one of `VERDICTS`.  ``unbiased``: all moments are within the tolerance, intervals included.  ``biased``: one of
    # them is outside, interval included.  ``undecided``: neither.  ``unstable``: moments are not finite, speeds are
    # ten times too large, or paths are abandoned.  ``no limit``: the scheme cannot converge as the step decreases
    verdict: str
    # error, half: error of the decisive moment, and the half width of its interval, in units of the tolerance
    error: float
    half: float
    where: str  # the decisive moment, or the kind of instability
    # whether the run reports a diagnostic of its step; that a default step was shortened does not count
    diagnosed: bool
    paths: int  # simulated paths
    moments: int  # number of moments that are judged


def looks(paths: int) -> int:
    """Compute how often a verdict may be attempted, for the simultaneous intervals.

    Examples
    --------
    >>> looks(FIRST), looks(FIRST + 1), looks(FIRST * GROWTH**2)
    (1, 2, 3)
    """
    number, tried = FIRST, 1
    while number < paths:
        number, tried = number * GROWTH, tried + 1
    return tried


def simulate_any(scene: Scene, *, scheme: str, dt: float, paths: int, seed: int, workers: int) -> Ensemble:
    """Simulate with any time step, admissible or not."""
    plan = plan_of(
        scene,
        paths=paths,
        impacts=IMPACTS,
        dt=dt,
        scheme=scheme,
        rng=seed,
        any_step=True,
        sampling=Sampling(horizon=max(horizon_of(scene), 4.0 * dt)),
    )
    merged: BlockResult | None = None
    for result, _ in in_threads(workers)(plan, 0):
        merged = result if merged is None else merged.merge(result)
    assert merged is not None
    return Ensemble(plan, paths, merged, None, None, 0.0)


def judge(
    scene: Scene,
    beside: Reference,
    *,
    scheme: str,
    dt: float,
    paths: int,
    seed: int,
    workers: int,
    z: float,
    within: Tolerances = Tolerances(),  # noqa: B008  (a tuple)
) -> Judged:
    """Simulate a cell, with more paths while the verdict is undecided, and judge it."""
    number = min(paths, FIRST)
    with np.errstate(all="ignore"):  # unstable runs overflow
        run = simulate_any(scene, scheme=scheme, dt=dt, paths=number, seed=seed, workers=workers)
        while True:
            verdict, error, half, where = _verdict(run, beside, z, within)
            if verdict != UNDECIDED or run.paths >= paths or not is_random(run.scene):
                break
            run = extend(run, min(paths, GROWTH * run.paths), in_threads(workers))
        return Judged(
            verdict,
            error,
            half,
            where,
            len(run.diagnostics) > bool(diagnose_short_step(run)) + bool(diagnose_rare_branch(run)),
            run.plan.paths,
            beside.moments,
        )


def _verdict(run: Ensemble, beside: Reference, z: float, within: Tolerances) -> tuple[str, float, float, str]:
    a, b = run.columns, beside.columns
    parts = [
        (np.abs(a[p + q] - b[p + q]) / unit, z * np.hypot(a["se_" + p + q], b["se_" + p + q]) / unit, f"{name} of {q}")
        for p, name, tolerance in (("", "mean", within.mean), ("sd_", "sd", within.sd))
        for q in SECTION
        for unit in (tolerance * beside.unit[q],)
    ]
    counts = np.isfinite(np.concatenate([beside.unit[q] for _ in range(2) for q in SECTION]))
    error, half = (np.concatenate([part[i] for part in parts])[counts] for i in (0, 1))
    names = np.array([f"{part[2]} at impact {k}" for part in parts for k in range(1, IMPACTS + 1)])[counts]

    def at(of: Floats) -> tuple[float, float, str]:
        k = int(np.nan_to_num(of, nan=np.inf).argmax())
        return float(error[k]), float(half[k]), str(names[k])

    wrong = _describe_instability(run, beside)
    if run.scene.sigma > 0.0 and run.scene.epsilon == 0.0:
        return COLLAPSING, *at(error)[:2], "at restitution 0 noise makes infinitely many impacts in a finite time"
    if wrong:
        return UNSTABLE, *at(error)[:2], wrong
    if (error - half > 1.0).any():
        return BIASED, *at(error - half)
    return (UNBIASED if (error + half <= 1.0).all() else UNDECIDED, *at(error + half))


def _describe_instability(run: Ensemble, beside: Reference) -> str:
    """Description of an instability; empty if there is none."""
    reached = np.isfinite(beside.columns["tau"])
    if not all(np.isfinite(run.columns[q][reached]).all() for q in ("tau", "y1", "y2", "sd_y1", "sd_y2")):
        return "moments are not finite"
    ours, theirs = (
        max(float(np.nanmax(np.hypot(c[y], c["sd_" + y]))) for y in ("y1", "y2")) for c in (run.columns, beside.columns)
    )
    if ours > FAST * theirs:
        return f"speeds are {ours / theirs:.1e} times those of the reference"
    if run.unfinished > (beside.late + LATE) * run.paths:
        return f"{run.unfinished / run.paths:.0%} of the paths were abandoned"
    return ""
