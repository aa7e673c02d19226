"""Where along a parameter a quantity of the long run crosses a level: the public entry and its
result."""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd

from rattle.compare.engine.run import Runner
from rattle.compare.engine.store import open_store
from rattle.compare.parameters.boundary import check_search, own_seed
from rattle.compare.parameters.finding import Finding, list_undecided, with_unit
from rattle.compare.parameters.search import MOST_VALUES, find_changes, state_effort
from rattle.compare.stationary.result import unit_of
from rattle.compare.stationary.study import LongCell, LongResult
from rattle.compare.validation.verdict import Verdict
from rattle.montecarlo.kernel.blocks import Budget
from rattle.montecarlo.long_run import expect_run
from rattle.montecarlo.long_run.estimates import all_names, most_unseen
from rattle.montecarlo.looks import Looks
from rattle.montecarlo.seed import Rng, read_whole_seed
from rattle.montecarlo.statistics.intervals import half_width, tail_of
from rattle.scene import InputError, Scene, choice, positive
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.progress import ProgressBar, do

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CROSSING_PATHS = 64  # of each long run
PERIODS_OF_LOOKS = (64, 256, 1024, 4096)
"""Periods after which a value is judged."""
TAIL = tail_of(len(PERIODS_OF_LOOKS) * MOST_VALUES)
"""Probability on each side of the interval of every look at every value."""
TOO_NEAR = "too near the level to decide"
BELOW_LEVEL = "below"
ABOVE_LEVEL = "above"


class SideOfLevel(NamedTuple):
    """A value of the parameter, and on which side of the level the quantity is there."""

    value: float
    verdict: str  # `BELOW_LEVEL`, `ABOVE_LEVEL` or `Verdict.UNDECIDED`
    periods: int = 0
    estimate: float = math.nan  # of the quantity, with the bounds of its interval
    low: float = math.nan
    high: float = math.nan
    remark: str = ""  # why it is undecided


class Sides(NamedTuple):
    """Two values of the parameter between which the quantity crosses the level."""

    below: float
    above: float


@numpy_defaults
@dataclass(frozen=True, repr=False)
class Crossing(Finding):
    """The values of a parameter between which a quantity of the long run crosses a level, from
    `crossing`.

    Attributes
    ----------
    scene : Scene
    quantity : str
    level : float
        In physical units for a scene with gears.
    over : str
    edges : tuple
        Each with ``below`` and ``above``: the values at which the quantity is shown below and above
        the level.
    points : DataFrame
        Every value that was judged, in their order: ``value, verdict, periods, estimate, low, high,
        remark``.
    unit : str
        Of the parameter, empty where it has none.
    quantity_unit : str
        Of the quantity and the level.

    Examples
    --------
    >>> from rattle import DAT21, Scene
    >>> scene = Scene.from_gears(DAT21, sigma=0.5)
    >>> found = crossing(
    ...     scene, quantity="rate_above", level=600.0, over="amplitude", points=2, width=0.5
    ... )
    >>> set(found.points["verdict"]) <= {"below", "above", "undecided"}
    True
    """

    title = "Crossing of {quantity} = {level:g} over {over}"
    shown = "points"
    plain = ("quantity", "level", "quantity_unit", "over", "unit", "answer", "edges", "points")

    scene: Scene
    quantity: str
    level: float
    over: str
    edges: tuple[Sides, ...]
    points: pd.DataFrame
    unit: str = ""
    quantity_unit: str = ""

    @property
    def answer(self) -> list[str]:
        """The crossings in words, and what is not known."""
        unit = f" {self.unit}" if self.unit else ""
        level = f"{self.level:g} {self.quantity_unit}".rstrip()
        table = self.points
        over = f"{self.over} = "
        span = f"from {over}{table['value'].min():.4g} to {table['value'].max():.4g}{unit}"
        said = []
        for edge in self.edges:
            first, then = (
                (BELOW_LEVEL, ABOVE_LEVEL)
                if edge.below < edge.above
                else (ABOVE_LEVEL, BELOW_LEVEL)
            )
            up_to = f"{level} up to {over}{min(edge):.4g}{unit}"
            said.append(f"`{self.quantity}` is {first} {up_to} and {then} it at {max(edge):.4g}.")
        if len(self.edges) > 1:
            said.append("It crosses the level more than once.")
        sides = set(table["verdict"])
        if len(sides) == 1 and Verdict.UNDECIDED not in sides:
            said.append(
                f"`{self.quantity}` is {sides.pop()} {level} {span}: it does not cross it there."
            )
            one, other = table.iloc[[0, -1]].to_dict("records")
            # towards the end that is nearer the level
            if one["low"] > other["high"] or other["low"] > one["high"]:
                up = abs(other["estimate"] - self.level) < abs(one["estimate"] - self.level)
                end = f"above {other['value']:.4g}" if up else f"below {one['value']:.4g}"
                said.append(f"If it does, it is {end}{unit}.")
        elif not self.edges:
            said.append(f"No crossing of {level} by `{self.quantity}` was decided {span}.")
        said += list_undecided(table, self.over, unit)
        return [*said, f"{len(table)} values were judged."]

    def plot(self) -> "Figure":
        """Draw the quantity, with its interval, at every value, and the level.

        Returns
        -------
        Figure
            Of matplotlib; a notebook shows it, ``savefig`` writes it.
        """
        from rattle.compare.parameters.figures import crossing_figure

        across = with_unit(self.over, self.unit)
        up = with_unit(self.quantity, self.quantity_unit)
        return crossing_figure(self.level, self.edges, self.points, across, up)


@numpy_defaults
def crossing(
    scene: Scene,
    *,
    quantity: str,
    level: float,
    over: str = "sigma",
    between: tuple[float, float] | None = None,
    points: int = 8,
    width: float = 0.1,
    slow: float = 0.1,
    folder: str | Path | None = None,
    budget: float | None = None,
    rng: Rng = 0,
    workers: int = 1,
    progress: str | None = None,
) -> Crossing:
    """Find where along a parameter a quantity of the long run crosses a level.

    For one: from which drag torque on is a pair quiet.  A coarse scan, then halving of the
    logarithm wherever the quantity changes sides.  At each value long runs of 64 paths and 64 to
    4,096 periods are made until its interval is on one side of the level.  What is said of the
    whole search is right with 95 % probability: all looks at all values are counted.  Between the
    values of the scan nothing is said: a quantity may cross the level more than once.

    Parameters
    ----------
    scene : Scene
        What is modelled.
    quantity : str
        A quantity of `stationary`: ``rate_above`` (of impacts that are not slow), ``power``,
        ``q95_speed_above``, ...
    level : float
        The level; for a scene with gears in physical units (impacts per second, mW, mm/s).
    over : str
        A parameter, as in `boundary`.
    between : pair of float, optional
        Where to search, as in `boundary`.
    points : int
        Values of the scan.
    width : float
        To which every crossing is narrowed: 0.1 for ± 10 %.
    slow : float
        Speed below which an impact counts as slow; of gears it stays the same in mm/s.
    folder : path, optional
        Where results are stored: the same search continues there after an interruption.
    budget : float, optional
        Seconds of processor time after which no further long run is begun.
    rng : int, SeedSequence, Generator or BitGenerator
        Seed; a generator of numpy gives a child of its seed sequence, another one each time.
    workers : int
        Threads; the result does not depend on it.
    progress : str, optional
        Label of a progress bar on a terminal or in a notebook; with it the expected time is logged
        first.

    Returns
    -------
    Crossing

    Raises
    ------
    InputError
        For an unknown quantity or parameter, a level that is not positive, or a range that no scene
        can have.

    Examples
    --------
    >>> from rattle import DAT21, Scene
    >>> scene = Scene.from_gears(DAT21, sigma=0.5)
    >>> found = crossing(
    ...     scene, quantity="power", level=1e3, over="amplitude", between=(0.1, 0.6), points=2
    ... )
    >>> found.quantity_unit
    'mW'
    """
    parameter, low, high, time_left = check_search(scene, over, between, points, width, budget)
    whole = read_whole_seed(rng)
    choice("quantity", quantity, all_names(scene.stages))
    level = float(positive("level", level))
    positive("slow", slow)
    if progress:
        do(f"{progress}: timing a few paths")
        with suppress(InputError):  # it cannot be simulated, which the search says of its value
            expected = expect_run(
                parameter.scene_at(low), CROSSING_PATHS, PERIODS_OF_LOOKS[0], slow=slow
            )
            most = expected.lengthen(PERIODS_OF_LOOKS[-1] - PERIODS_OF_LOOKS[0])
            state_effort(progress, over, points, expected.core_seconds, most)
    units = "dimensionless" if scene.gears is None else "physical"
    bar = ProgressBar(label=progress, unit=" values")
    store = open_store(folder)
    with Runner(workers) as runner, bar:

        def judge(value: float) -> SideOfLevel:
            changed = parameter.scene_at(value)
            # gears do not have the value of a field that they fix
            gears = changed.gears or scene.gears
            same_speed = (
                scene.gears.units.speed / gears.units.speed if scene.gears and gears else 1.0
            )
            factor = unit_of(quantity, gears, units)[1]

            def run(periods: int) -> LongResult:
                bar.set_postfix_str(f"{over} = {value:.4g}, {periods:,} periods")
                seed = own_seed(changed, whole)
                cell = LongCell(
                    changed, seed, (), periods=periods, paths=CROSSING_PATHS, slow=slow * same_speed
                )
                found: LongResult = store.obtain(cell, runner.compute)
                return found

            found = judge_level(value, quantity, level / factor, run, time_left)
            bar.update()
            return found._replace(
                estimate=factor * found.estimate, low=factor * found.low, high=factor * found.high
            )

        with ThreadPoolExecutor(workers) as pool:
            changes, table = find_changes(
                judge, low, high, points, width, first=BELOW_LEVEL, each=pool.map
            )
    edges = tuple(Sides(below.value, above.value) for below, above in changes)
    unit = unit_of(quantity, scene.gears, units)[0]
    return Crossing(scene, quantity, level, over, edges, table, parameter.unit, unit)


def judge_level(
    value: float,
    quantity: str,
    level: float,
    run: Callable[[int], LongResult],
    time_left: Budget | None = None,
) -> SideOfLevel:
    """Lengthen the long run at one value until a quantity is shown to be on one side of a level.

    `run`: Makes a long run of so many periods.
    """
    found = SideOfLevel(value, Verdict.UNDECIDED)
    looks = Looks(PERIODS_OF_LOOKS, budget=time_left)
    for periods in looks:
        try:
            result = run(periods)
        except InputError as error:  # no stationary motion is reached
            return found._replace(remark=str(error))
        estimate, low, high = find_interval(result, quantity)
        found = SideOfLevel(value, Verdict.UNDECIDED, periods, estimate, low, high)
        if high < level:
            return found._replace(verdict=BELOW_LEVEL)
        if low > level:
            return found._replace(verdict=ABOVE_LEVEL)
        looks.why = "there are no such impacts" if math.isnan(estimate) else TOO_NEAR
        if estimate > 0.0:
            margin = abs(estimate - level)
            half = 0.5 * (high - low)
            looks.expect(periods * (half / margin) ** 2 if margin > 0.0 else math.inf)
    return found._replace(remark=looks.why)


def find_interval(result: LongResult, quantity: str) -> tuple[float, float, float]:
    """A quantity of a long run with the interval that counts all looks at all values."""
    if quantity not in result.table.index:  # at rest
        return math.nan, math.nan, math.nan
    row = result.table.loc[quantity].to_dict()
    value = float(row["value"])
    se = float(row["se"])
    if result.facts["kind"] != "simulated":
        return value, value, value
    # none was seen: the upper limit of a Poisson count
    if quantity.startswith("rate") and value == 0.0:
        return (
            0.0,
            0.0,
            most_unseen(2.0 * math.pi * result.facts["paths"] * result.facts["periods"], TAIL),
        )
    if not se > 0.0:
        return math.nan, math.nan, math.nan
    half = float(half_width(np.asarray(row["effective_paths"]), TAIL)) * se
    return value, value - half, value + half
