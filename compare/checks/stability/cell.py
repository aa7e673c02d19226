"""A cell of the map: one scheme, one scene, one step, on either side of the door, and the verdict on it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.compare.checks.stability.reference import IMPACTS, Reference, horizon_of
from rattle.compare.validation.verdict import Tolerances
from rattle.montecarlo import Ensemble
from rattle.montecarlo.diagnostics import shortened
from rattle.montecarlo.ensemble import extended, in_threads
from rattle.montecarlo.kernel.block import BLOCK, BlockResult
from rattle.montecarlo.settings import is_random, plan_of
from rattle.scene import Scene
from rattle.scene.moments import SECTION

__all__ = [
    "BIASED",
    "COLLAPSING",
    "FIRST",
    "UNBIASED",
    "UNDECIDED",
    "UNSTABLE",
    "VERDICTS",
    "Judged",
    "judged",
    "looks",
    "sampled",
]

Floats = NDArray[np.float64]

UNBIASED, BIASED, UNDECIDED, UNSTABLE, COLLAPSING = VERDICTS = (
    "unbiased", "biased", "undecided", "unstable", "no limit",
)  # fmt: skip

FIRST = 2 * BLOCK  # paths that a verdict is first tried with
GROWTH = 8  # times as many where they do not decide
LATE = 0.05  # more of the paths than of the reference's that may be given up
FAST = 10.0  # times the reference's speed, where speeds no longer are


class Judged(NamedTuple):
    """The verdict on a cell, and what it stands on.

    Attributes
    ----------
    verdict : str
        One of `VERDICTS`: all moments within the tolerance, with their intervals; one of them outside, with its
        interval; neither; the run has not come through; or there is no limit that it could have come to.
    error, half : float
        Of the moment that decides, and the half width of its interval, in tolerances.
    where : str
        Which moment that is, or what has gone wrong.
    told : bool
        Whether the run says by itself that something may be wrong; a shortened step alone is nothing wrong.
    paths : int
    moments : int
        How many are judged.
    """

    verdict: str
    error: float
    half: float
    where: str
    told: bool
    paths: int
    moments: int


def looks(paths: int) -> int:
    """How often a verdict may be tried with up to so many paths.

    Examples
    --------
    >>> looks(FIRST), looks(FIRST + 1), looks(FIRST * GROWTH**2)
    (1, 2, 3)
    """
    number, tried = FIRST, 1
    while number < paths:
        number, tried = number * GROWTH, tried + 1
    return tried


def sampled(scene: Scene, *, scheme: str, dt: float, paths: int, seed: int, workers: int) -> Ensemble:
    """A simulation with any step, on either side of the door.

    Examples
    --------
    >>> from rattle.compare.checks.stability.axes import moderate
    >>> run = sampled(moderate(), scheme="euler-maruyama", dt=1.0, paths=100, seed=0, workers=1)
    >>> run.dt
    1.0
    """
    plan = plan_of(
        scene, paths=paths, impacts=IMPACTS, dt=dt, scheme=scheme, rng=seed, any_step=True,
        horizon=max(horizon_of(scene), 4.0 * dt),
    )  # fmt: skip
    merged: BlockResult | None = None
    for result, _ in in_threads(workers)(plan, 0):
        merged = result if merged is None else merged.merged(result)
    assert merged is not None
    return Ensemble(plan, paths, merged, None, None, 0.0)


def judged(
    scene: Scene, beside: Reference, *, scheme: str, dt: float, paths: int, seed: int, workers: int, z: float,
    within: Tolerances = Tolerances(),  # noqa: B008  (a tuple)
) -> Judged:  # fmt: skip
    """Run a cell, with more paths while these do not decide, and judge it with intervals of z standard errors.

    Examples
    --------
    >>> from rattle.compare.checks.stability.axes import moderate
    >>> from rattle.compare.checks.stability.reference import reference
    >>> scene = moderate(sigma=0.0)
    >>> beside = reference(scene, paths=1, seed=1, workers=1)
    >>> settings = {"dt": 0.01, "paths": 1, "seed": 0, "workers": 1, "z": 4.0}
    >>> [judged(scene, beside, scheme=name, **settings).verdict for name in ("exact-flight", "euler-maruyama")]
    ['unbiased', 'biased']
    """
    number = min(paths, FIRST)
    with np.errstate(all="ignore"):  # what is unstable overflows
        run = sampled(scene, scheme=scheme, dt=dt, paths=number, seed=seed, workers=workers)
        while True:
            verdict, error, half, where = _verdict(run, beside, z, within)
            if verdict != UNDECIDED or run.paths >= paths or not is_random(run.scene):
                break
            run = extended(run, min(paths, GROWTH * run.paths), in_threads(workers))
        return Judged(
            verdict, error, half, where, len(run.diagnostics) > bool(shortened(run)), run.plan.paths, beside.moments
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

    wrong = _gone_wrong(run, beside)
    if run.scene.sigma > 0.0 and run.scene.epsilon == 0.0:
        return COLLAPSING, *at(error)[:2], "a path without speed at its wall is shaken against it without end"
    if wrong:
        return UNSTABLE, *at(error)[:2], wrong
    if (error - half > 1.0).any():
        return BIASED, *at(error - half)
    return (UNBIASED if (error + half <= 1.0).all() else UNDECIDED, *at(error + half))


def _gone_wrong(run: Ensemble, beside: Reference) -> str:
    """What says that a run has not come through; empty if nothing does."""
    reached = np.isfinite(beside.columns["tau"])
    if not all(np.isfinite(run.columns[q][reached]).all() for q in ("tau", "y1", "y2", "sd_y1", "sd_y2")):
        return "moments are not finite"
    ours, theirs = (
        max(float(np.nanmax(np.hypot(c[y], c["sd_" + y]))) for y in ("y1", "y2")) for c in (run.columns, beside.columns)
    )
    if ours > FAST * theirs:
        return f"speeds are {ours / theirs:.1e} times those of the reference"
    if run.unfinished > (beside.late + LATE) * run.paths:
        return f"{run.unfinished / run.paths:.0%} of the paths were given up"
    return ""
