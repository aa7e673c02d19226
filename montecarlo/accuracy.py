"""Ask for accuracy, not for settings: scheme, step and number of paths from pilot runs, then paths until it is there.

Errors count in units of each quantity's sd, the worst of all section means and sds: the standard error, and the bias of
the step as measured on the same noise at dt, 2 dt and 4 dt.  They count absolutely where the sd is no scale: where
nothing varies, and for the displacement at the mesh that most paths strike, which varies by the strays alone.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from montecarlo.block import BLOCK
from montecarlo.ensemble import Blocks, extended
from montecarlo.reach import Candidate, Reach
from montecarlo.result import Ensemble
from montecarlo.schemes import SCHEMES
from montecarlo.step import largest_step
from scene.moments import SECTION
from scene.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["LEAST", "STILL", "faint", "pilot", "reach", "sampling_error", "step_error", "units"]

PILOT = 4 * BLOCK
LEAST = 32 * BLOCK  # paths of an answer: what fewer than 1 in 10 000 do may make an sd, and is to be seen
COARSEST = 4  # of the steps that run side by side for the bias, in units of the finest
FIRST_STEP = 0.01  # of the pilots of Euler and Maruyama, if the scene lets it through
GROWTH = 8  # most by which the number of paths grows at once: the spread of heavy tails is found late
ENOUGH = 5.0  # core-seconds of exact flights below which nothing cheaper is looked for: pilots take as long
FAINT = 0.2  # noise intensity up to which a control variate is tried, in units of alpha; on DAT21 it wins up to 0.07
STILL = 1e-9  # sd below which a quantity does not vary

Floats = NDArray[np.float64]
Simulate = Callable[..., Ensemble]


class HasColumns(Protocol):
    """An ensemble, or what is kept of one."""

    @property
    def columns(self) -> Mapping[str, NDArray[Any]]:
        """As `Ensemble.columns`."""
        ...

    @property
    def section(self) -> pd.DataFrame:
        """As `Ensemble.section`."""
        ...


def _units(run: HasColumns) -> dict[str, Floats]:
    columns = run.columns
    unit = {q: np.where(columns["sd_" + q] > STILL, columns["sd_" + q], 1.0) for q in SECTION}
    for mesh in (1, 2):
        unit[f"x{mesh}"] = np.where(columns["mesh"] == mesh, 1.0, unit[f"x{mesh}"])
    return unit


def units(run: HasColumns) -> pd.DataFrame:
    """Unit of each quantity's errors, index ``impact``, columns the section quantities."""
    import pandas as pd

    return pd.DataFrame(_units(run), index=run.section.index)


def sampling_error(run: HasColumns) -> tuple[float, str]:
    """Largest standard error of the section means and sds in units of the sd, and where it is."""
    unit, columns = _units(run), run.columns
    worst, where = 0.0, "nothing varies"
    for q in SECTION:
        for name, prefix in (("mean", "se_"), ("sd", "se_sd_")):
            errors = np.nan_to_num(columns[prefix + q] / unit[q])
            k = int(errors.argmax())
            if errors[k] > worst:
                worst, where = float(errors[k]), f"{name} of {q} at impact {k + 1}"
    return worst, where


def step_error(run: Ensemble) -> tuple[float, float]:
    """Largest bias of the step in units of the sd, and its standard error."""
    unit, bias = units(run), run.step_bias
    scale = np.array([unit.at[k, q] for k, q in zip(bias["impact"], bias["quantity"], strict=True)])
    share = bias["bias"].abs() / scale
    worst = int(share.to_numpy().argmax())
    return float(share.iloc[worst]), float(bias["se_bias"].iloc[worst] / scale[worst])


def pilot(scene: Scene, scheme: str, simulate: Simulate) -> Ensemble:
    """A small run that shows what accuracy takes: spread, and for a scheme with a step bias that bias."""
    exact = SCHEMES[scheme].weak_order is None
    levels = 1 if exact else COARSEST
    dt = min(SCHEMES[scheme].step if exact else FIRST_STEP, 0.99 * largest_step(scene, scheme)[0] / levels)
    return simulate(paths=PILOT, scheme=scheme, dt=dt, step_bias=not exact, control=exact and faint(scene))


def faint(scene: Scene) -> bool:
    """Whether noise is so weak that the linearised path may be worth its time."""
    return scene.sigma <= FAINT * scene.alpha


def _candidate(scene: Scene, scheme: str, accuracy: float, simulate: Simulate) -> tuple[Candidate, Ensemble]:
    """Step, paths and work that a scheme needs, and the pilot run that says so."""
    kind, first = SCHEMES[scheme], pilot(scene, scheme, simulate)
    exact, dt = kind.weak_order is None, first.dt
    error, _ = sampling_error(first)
    if not exact:  # half of what is allowed: order 1 is that of the limit dt -> 0
        dt *= min(1.0, 0.5 * accuracy / max(step_error(first)[0], 1e-300))
    blocks = max(LEAST // BLOCK, math.ceil(first.paths * (error / accuracy) ** 2 / BLOCK))
    steps = first.path_steps / first.paths * first.dt / dt  # of all step sizes
    work = steps * kind.step_ns + first.impacts * kind.impact_ns * (1.0 if exact else 3.0)
    return Candidate(scheme, dt, blocks * BLOCK, 1e-9 * work * blocks * BLOCK), first


def reach(
    scene: Scene, simulate: Simulate, *, accuracy: float, scheme: str | None, blocks: Blocks, budget: float,
    progress: str | None,
) -> Ensemble:  # fmt: skip
    """Simulate until both errors are within `accuracy`, or the budget is spent.

    Parameters
    ----------
    scene : Scene
    simulate : callable
        `montecarlo.simulate` with all that does not change: scene, impacts, seed, workers.
    accuracy : float
    scheme : str or None
        The one to use; None for the one that pilot runs expect to cost least.
    blocks : callable
        Who runs the blocks.
    budget : float
        Seconds.
    progress : str or None

    Returns
    -------
    Ensemble
        With `Ensemble.reach`.
    """
    started = time.perf_counter()
    names = [scheme] if scheme else sorted(SCHEMES, key=lambda name: SCHEMES[name].weak_order is not None)
    tried = [_candidate(scene, names[0], accuracy, simulate)]
    if tried[0][0].core_seconds > ENOUGH:
        tried += [_candidate(scene, name, accuracy, simulate) for name in names[1:]]
    best, first = min(tried, key=lambda pair: pair[0].core_seconds)
    exact = SCHEMES[best.scheme].weak_order is None
    settings = {"scheme": best.scheme, "control": exact and faint(scene), "step_bias": not exact, "progress": progress}
    dt, paths = best.dt, min(best.paths, GROWTH * PILOT)
    before = time.perf_counter()
    run = extended(first, paths, blocks, progress) if exact else simulate(paths=paths, dt=dt, **settings)
    paths -= first.paths if exact else 0
    while True:
        seconds_per_path = (time.perf_counter() - before) / paths
        error, worst = sampling_error(run)
        step, se_step = (0.0, 0.0) if exact else step_error(run)
        wanted = math.ceil(run.paths * (error / accuracy) ** 2 / BLOCK) * BLOCK
        shorten = step > accuracy and step > 3.0 * se_step
        if step > accuracy and not shorten:  # a bias that may be noise
            wanted = max(wanted, 2 * run.paths)
        more = 2 * run.paths if shorten else max(wanted - run.paths, 0)
        left = budget - (time.perf_counter() - started)
        affordable = int(min(left / seconds_per_path, 1e15)) // BLOCK * BLOCK
        if more == 0 or affordable <= 0 or (shorten and affordable < more):
            candidates = [candidate for candidate, _ in tried]
            reached = Reach(accuracy, error, step, worst, candidates, more * seconds_per_path)
            return replace(run, reach=reached)
        before = time.perf_counter()
        if shorten:
            paths, dt = run.paths, 0.5 * dt
            run = simulate(paths=paths, dt=dt, **settings)
        else:
            paths = min(more, affordable, (GROWTH - 1) * run.paths)
            run = extended(run, run.paths + paths, blocks, progress)
