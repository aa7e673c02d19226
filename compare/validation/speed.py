"""Work of a closure compared with that of a simulation of equal accuracy, and what an accuracy takes by simulation.

An accuracy is that of `rattle.montecarlo.simulate_to`: with 95 % probability no section mean or sd is off by more.
Work is counted at nominal costs (`rattle.montecarlo.accuracy.cost`, `rattle.closure.cost`): no clock decides what is
advised.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import pandas as pd

from rattle.closure import mean_map
from rattle.closure.cost import closure_seconds
from rattle.compare.validation.comparison import Comparison
from rattle.compare.validation.validity import find_validity, rows_to_judge
from rattle.compare.validation.verdict import widest
from rattle.montecarlo.accuracy.cost import cost_of, cost_to

WANTED = 0.01  # accuracy, in sds, for which the cost of a simulation is stated


class Speed(NamedTuple):
    """Nominal time of a closure and of a simulation of equal accuracy, both on one core."""

    closure: str
    sigma: float  # noise intensity
    impacts: int  # the impact up to which the closure is accurate; both sides are counted up to it
    # worst, median: worst and median error of the closure's section means and sds, in units of the quantities' sds
    worst: float
    median: float
    # whether the interval of the worst error excludes zero; if not, the error may be smaller and the speed-up larger
    resolved: bool
    closure_seconds: float  # closure_seconds, simulation_seconds: nominal seconds on one core
    paths: int  # paths that bound all errors by the worst error of the closure
    simulation_seconds: float
    speed_up: float  # ratio of the two times


def paths_for(rows: pd.DataFrame, error: float) -> int:
    """Number of paths for which with 95 % probability no moment is off by more than `error`.

    `rows`: A row for each moment: ``unit``, the sd of its quantity, and ``se``, its standard error for a single
    path.

    Examples
    --------
    >>> paths_for(pd.DataFrame({"unit": [1.0], "se": [1.0]}), 0.0196)  # 1.96 standard errors
    10000
    """
    return math.ceil(round(float(((widest(len(rows)) * rows["se"] / (error * rows["unit"])) ** 2).max()), 6))


def simulation_costs(validations: Sequence[Comparison]) -> pd.DataFrame:
    """What a run of the scheme of each validation to an accuracy of `WANTED` takes, as its paths let expect."""
    rows = [{"sigma": v.scene.sigma, "impacts": v.run.impacts, **cost_to(v.run, WANTED)._asdict()} for v in validations]
    return pd.DataFrame(rows)


def measure_speeds(validations: Sequence[Comparison]) -> pd.DataFrame:
    """`measure_speed` of every closure of some validations that is accurate at the first impact."""
    found = [s for v in validations for closure in v.predictions if (s := measure_speed(v, closure))]
    return pd.DataFrame(found, columns=list(Speed._fields))


def measure_speed(v: Comparison, closure: str) -> Speed | None:
    """Count the work of a closure up to the last impact at which it is accurate; None if there is none, or no sd."""
    reached, prediction = find_validity(v, closure).accurate, v.predictions[closure]
    rows = rows_to_judge(v, closure)
    rows = rows[(rows["impact"] <= reached) & (rows["unit"] > 0.0) & (rows["verdict"] != "not predicted")]
    if rows.empty:
        return None
    errors = rows["error"].abs() / rows["unit"]
    worst = rows.iloc[int(errors.argmax())]
    if reached < prediction.impacts:
        prediction = mean_map(v.scene, impacts=reached, closure=closure, order=prediction.order)
    paths = paths_for(rows.assign(se=rows["se"] * math.sqrt(v.run.paths)), float(errors.max()))
    seconds, cost = closure_seconds(prediction), cost_of(v.run, paths).core_seconds * reached / v.run.impacts
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
