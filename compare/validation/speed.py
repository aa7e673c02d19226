"""What a closure costs beside a simulation that is no more accurate."""

import math
import time
from collections.abc import Callable
from typing import NamedTuple

import pandas as pd

from rattle.closure import mean_map
from rattle.compare.validation.validate import Validation
from rattle.compare.validation.validity import judged_rows, validity
from rattle.montecarlo import simulate

__all__ = ["Speed", "best_of", "path_seconds", "paths_for", "speed"]

CALLS, SPAN = 5, 0.3  # a call is timed so often at most, and for so many seconds
TIMED_PATHS = 4096


class Speed(NamedTuple):
    """Time of a closure beside that of a simulation as accurate, both on one core.

    ``impacts`` is how far the closure is accurate, and both go that far; ``worst`` and ``median`` are its errors there
    in units of the quantities' sds.  Where the interval of the worst error holds zero (``resolved`` is False) the
    error may be smaller, and the speed-up larger.
    """

    closure: str
    sigma: float
    impacts: int
    worst: float
    median: float
    resolved: bool
    closure_seconds: float
    paths: int
    monte_carlo_seconds: float
    speed_up: float


def best_of(call: Callable[[], object]) -> float:
    """Seconds of the fastest of a few calls of something that is compiled; a long one is called once."""
    times: list[float] = []
    while not times or (len(times) < CALLS and sum(times) < SPAN):
        started = time.perf_counter()
        call()
        times.append(time.perf_counter() - started)
    return min(times)


def path_seconds(v: Validation) -> float:
    """Seconds per impact of one path on one core, for the scene, scheme and step of a validation."""
    plan = v.run.plan
    control = "control" in v.run.result.sums

    def call() -> None:
        simulate(
            plan.scene, paths=TIMED_PATHS, impacts=plan.impacts, dt=plan.dt, scheme=plan.scheme, rng=plan.seed,
            control=control,
        )  # fmt: skip

    return best_of(call) / TIMED_PATHS / plan.impacts


def paths_for(rows: pd.DataFrame, error: float) -> int:
    """Paths that make the standard error of every moment as small as `error`, in units of its sd.

    Parameters
    ----------
    rows : DataFrame
        A moment each: its unit ``unit``, and the standard error ``se`` of one path.
    error : float

    Examples
    --------
    >>> paths_for(pd.DataFrame({"unit": [1.0, 0.5], "se": [1.0, 1.0]}), 0.01)
    40000
    """
    return math.ceil(round(float(((rows["se"] / (error * rows["unit"])) ** 2).max()), 6))


def speed(v: Validation, closure: str, seconds_per_impact: float) -> Speed | None:
    """Time a closure as far as it is accurate, or None where it is not; `seconds_per_impact` is from `path_seconds`."""
    reached = validity(v, closure).accurate
    if reached == 0:
        return None
    rows = judged_rows(v, closure)
    rows = rows[(rows["impact"] <= reached) & (rows["unit"] > 0.0) & (rows["verdict"] != "not predicted")]
    errors = rows["error"].abs() / rows["unit"]
    worst = rows.iloc[int(errors.argmax())]
    order = v.predictions[closure].order
    seconds = best_of(lambda: mean_map(v.scene, impacts=reached, closure=closure, order=order))
    paths = paths_for(rows.assign(se=rows["se"] * math.sqrt(v.run.paths)), float(errors.max()))
    cost = paths * reached * seconds_per_impact
    return Speed(
        closure=closure,
        sigma=v.scene.sigma,
        impacts=reached,
        worst=float(errors.max()),
        median=float(errors.median()),
        resolved=bool(worst["low"] > 0.0 or worst["high"] < 0.0),
        closure_seconds=seconds,
        paths=paths,
        monte_carlo_seconds=cost,
        speed_up=cost / seconds,
    )
