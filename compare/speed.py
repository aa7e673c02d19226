"""What a closure costs beside a simulation that is no more accurate."""

import math
import time
from collections.abc import Callable
from typing import NamedTuple

import pandas as pd

from closure import mean_map
from compare.frontier import frontier, judged_rows
from compare.validate import Validation
from montecarlo import simulate
from montecarlo.step import largest_step

__all__ = ["Cost", "Speed", "best_of", "monte_carlo_cost", "path_step_seconds", "speed"]

CALLS, SPAN = 5, 0.3  # a call is timed so often at most, and for so many seconds
TIMED_PATHS = 1024
RICHARDSON = 1.5  # work of a run with 2 dt beside dt, in runs with dt alone


class Cost(NamedTuple):
    """The cheaper way to simulate to an accuracy: paths, step, and whether 2 dt runs beside it to extrapolate."""

    paths: int
    dt: float
    extrapolated: bool
    seconds: float


class Speed(NamedTuple):
    """Time of a closure beside that of a simulation as accurate, both on one core.

    ``impacts`` is how far the reading is accurate, and both go that far; ``worst`` and ``median`` are its errors there
    in units of the quantities' sds.  Where the interval of the worst error holds zero (``resolved`` is False) the
    error may be smaller, and the speed-up larger.
    """

    reading: str
    sigma: float
    impacts: int
    worst: float
    median: float
    resolved: bool
    closure_seconds: float
    paths: int
    dt: float
    extrapolated: bool
    monte_carlo_seconds: float
    speed_up: float


def best_of(call: Callable[[], object]) -> float:
    """Seconds of the fastest of a few calls, after one that compiles."""
    call()
    times: list[float] = []
    while len(times) < CALLS and sum(times) < SPAN:
        started = time.perf_counter()
        call()
        times.append(time.perf_counter() - started)
    return min(times)


def path_step_seconds(v: Validation) -> float:
    """Seconds of one step of one path on one core, for the scene, scheme and step of a validation."""
    r = v.run
    steps = 0

    def call() -> None:
        nonlocal steps
        run = simulate(r.scene, paths=TIMED_PATHS, impacts=r.impacts, dt=r.dt, scheme=r.scheme, rng=r.plan.seed)
        steps = run.path_steps

    return best_of(call) / steps


def monte_carlo_cost(rows: pd.DataFrame, error: float, dt: float, flight: float, longest: float, step: float) -> Cost:
    """What it takes to simulate every moment to an error in units of its sd.

    Parameters
    ----------
    rows : DataFrame
        A moment each: ``unit`` (its sd), and of a run with step `dt` the standard errors of one path ``se`` and, after
        Richardson's extrapolation, ``se_corrected``; the first-order ``bias`` of the step and the ``rest`` that
        extrapolation leaves.
    error : float
        Standard error and step bias may each be as large.
    dt, flight, longest, step : float
        Step of that run; mean time to simulate; the longest step allowed; seconds of one step of one path.

    Returns
    -------
    Cost
        With the first-order bias taken to be proportional to the step, and the rest to its square.

    Examples
    --------
    >>> rows = pd.DataFrame({"unit": [1.0], "se": [1.0], "se_corrected": [1.0], "bias": [0.1], "rest": [0.001]})
    >>> cost = monte_carlo_cost(rows, 0.01, dt=0.01, flight=1.0, longest=0.1, step=1e-8)
    >>> cost.paths, round(cost.dt, 4), cost.extrapolated, round(cost.seconds, 4)
    (10000, 0.0316, True, 0.0047)
    """
    allowed = error * rows["unit"]
    costs = []
    for extrapolated, se, rest, power in ((False, "se", "bias", 1.0), (True, "se_corrected", "rest", 0.5)):
        paths = math.ceil(float(((rows[se] / allowed) ** 2).max()))
        excess = float((rows[rest].abs() / allowed).max())
        widest = longest / 2.0 if extrapolated else longest
        chosen = min(widest, dt * excess**-power) if excess > 0.0 else widest
        seconds = paths * flight / chosen * step * (RICHARDSON if extrapolated else 1.0)
        costs.append(Cost(paths, chosen, extrapolated, seconds))
    return min(costs, key=lambda c: c.seconds)


def speed(v: Validation, reading: str, step: float) -> Speed | None:
    """Time a reading as far as it is accurate, or None where it is not; `step` is from `path_step_seconds`."""
    reached = frontier(v, reading).accurate
    if reached == 0:
        return None
    rows = judged_rows(v, reading)
    rows = rows[(rows["impact"] <= reached) & (rows["unit"] > 0.0) & (rows["verdict"] != "not predicted")]
    keys = ["impact", "quantity", "moment"]
    rows = rows.merge(v.run.step_bias[[*keys, "se_corrected", "rest"]], on=keys)
    rows[["se", "se_corrected"]] *= math.sqrt(v.run.paths)
    errors = rows["error"].abs() / rows["unit"]
    worst = rows.iloc[int(errors.argmax())]
    closure = v.closures[reading]
    seconds = best_of(lambda: mean_map(v.scene, impacts=reached, reading=reading, order=closure.order))
    flight = float(v.run.section["tau"].loc[reached]) - v.scene.start.tau
    cost = monte_carlo_cost(rows, float(errors.max()), v.run.dt, flight, largest_step(v.scene)[0], step)
    return Speed(
        reading=reading,
        sigma=v.scene.sigma,
        impacts=reached,
        worst=float(errors.max()),
        median=float(errors.median()),
        resolved=bool(worst["low"] > 0.0 or worst["high"] < 0.0),
        closure_seconds=seconds,
        paths=cost.paths,
        dt=cost.dt,
        extrapolated=cost.extrapolated,
        monte_carlo_seconds=cost.seconds,
        speed_up=cost.seconds / seconds,
    )
