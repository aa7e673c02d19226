"""Computing time of a closure compared with that of a simulation of equal accuracy.

An accuracy is that of `rattle.montecarlo.simulate_to`: with 95 % probability no section mean or sd is off by more.
"""

import math
import time
from collections.abc import Callable
from typing import NamedTuple

import pandas as pd

from rattle.closure import mean_map
from rattle.compare.validation.validate import Validation
from rattle.compare.validation.validity import judged_rows, validity
from rattle.compare.validation.verdict import widest
from rattle.montecarlo import simulate
from rattle.montecarlo.accuracy import LEAST, share_of_look
from rattle.montecarlo.expected_paths import expected_paths
from rattle.montecarlo.pilots import LOOKS
from rattle.montecarlo.settings import computed

__all__ = ["WANTED", "Cost", "Speed", "best_of", "path_seconds", "paths_for", "simulation_cost", "speed"]

CALLS, SPAN = 5, 0.3  # a call is repeated at most so often, and for at most so many seconds
WANTED = 0.01  # accuracy, in sds, for which the cost of a simulation is stated
TIMED_PATHS = 4096  # paths of the simulation whose time per path and impact is measured


class Speed(NamedTuple):
    """Time of a closure and of a simulation of equal accuracy, both on one core.

    Attributes
    ----------
    closure : str
    sigma : float
        Noise intensity.
    impacts : int
        The impact up to which the closure is accurate; both sides are timed up to it.
    worst, median : float
        Worst and median error of the closure's section means and sds, in units of the quantities' sds.
    resolved : bool
        Whether the interval of the worst error excludes zero; if not, the error may be smaller and the speed-up larger.
    closure_seconds, simulation_seconds : float
        Seconds on one core.
    paths : int
        Paths that bound all errors by the worst error of the closure.
    speed_up : float
        Ratio of the two times.
    """

    closure: str
    sigma: float
    impacts: int
    worst: float
    median: float
    resolved: bool
    closure_seconds: float
    paths: int
    simulation_seconds: float
    speed_up: float


class Cost(NamedTuple):
    """What a simulation takes until with 95 % probability no section mean or sd is off by more than `WANTED` sds.

    Attributes
    ----------
    sigma : float
        Noise intensity.
    impacts : int
        Number of impacts.
    paths : int
        Of the scheme of the validation.
    seconds : float
        On one core; NaN if no time was measured.
    """

    sigma: float
    impacts: int
    paths: int
    seconds: float


def best_of(call: Callable[[], object]) -> float:
    """Seconds of the fastest of a few calls; a call that takes long is made once.

    Parameters
    ----------
    call : callable
        Without arguments; already compiled, as every call is timed.

    Returns
    -------
    float
    """
    times: list[float] = []
    while not times or (len(times) < CALLS and sum(times) < SPAN):
        started = time.perf_counter()
        call()
        times.append(time.perf_counter() - started)
    return min(times)


def path_seconds(v: Validation) -> float:
    """Seconds per impact of one path on one core, for the scene, scheme and step of a validation.

    Parameters
    ----------
    v : Validation
        The validation that is shown.

    Returns
    -------
    float
    """
    plan = v.run.plan
    control = "control" in v.run.result.sums

    def call() -> None:
        simulate(
            plan.scene, paths=TIMED_PATHS, impacts=plan.impacts, dt=plan.dt, scheme=plan.scheme, rng=plan.seed,
            control=control,
        )  # fmt: skip

    return best_of(call) / TIMED_PATHS / plan.impacts


def paths_for(rows: pd.DataFrame, error: float) -> int:
    """Number of paths for which with 95 % probability no moment is off by more than `error`.

    Parameters
    ----------
    rows : DataFrame
        A row for each moment: ``unit``, the sd of its quantity, and ``se``, its standard error for a single path.
    error : float
        In units of ``unit``.

    Returns
    -------
    int

    Examples
    --------
    >>> paths_for(pd.DataFrame({"unit": [1.0], "se": [1.0]}), 0.0196)  # 1.96 standard errors
    10000
    """
    return math.ceil(round(float(((widest(len(rows)) * rows["se"] / (error * rows["unit"])) ** 2).max()), 6))


def simulation_cost(v: Validation, seconds_per_impact: float = math.nan) -> Cost:
    """What a run of the same scheme to an accuracy of `WANTED` takes, as the run of a validation foresees it.

    Branches that the run cannot have seen count.

    Parameters
    ----------
    v : Validation
        The validation that is shown.
    seconds_per_impact : float
        Of one simulated path, from `path_seconds`.

    Returns
    -------
    Cost
    """
    impacts, foreseen = len(v.run.section), expected_paths(v.run, WANTED, share_of_look(LOOKS))
    paths = max(math.ceil(foreseen.paths), computed(v.scene, LEAST))
    return Cost(v.scene.sigma, impacts, paths, paths * impacts * seconds_per_impact)


def speed(v: Validation, closure: str, seconds_per_impact: float) -> Speed | None:
    """Time a closure up to the last impact at which it is accurate.

    Parameters
    ----------
    v : Validation
        The validation that is shown.
    closure : str
        Name of the closure.
    seconds_per_impact : float
        Of one simulated path, from `path_seconds`.

    Returns
    -------
    Speed or None
        None if the closure is not accurate at the first impact.
    """
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
        simulation_seconds=cost,
        speed_up=cost / seconds,
    )
