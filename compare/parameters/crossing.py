"""Where along a parameter a quantity of the long run crosses a level: the public entry and its
result."""

import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import pandas as pd

from rattle.compare.engine.run import Runner
from rattle.compare.engine.store import Store, open_store
from rattle.compare.judge.verdict import Verdict
from rattle.compare.parameters.boundary import check_search, seed_of
from rattle.compare.parameters.finding import AlongParameter
from rattle.compare.parameters.search import (
    LOOK_SHARE,
    MOST_VALUES,
    SEARCH_BUDGET,
    SearchRange,
    find_changes,
    state_effort,
)
from rattle.compare.stationary.result import unit_of
from rattle.compare.stationary.study import LongCell, LongResult
from rattle.montecarlo.kernel.blocks import Budget
from rattle.montecarlo.long_run import expect_run
from rattle.montecarlo.long_run.estimates import check_quantity, most_unseen
from rattle.montecarlo.looks import BUDGET_ENDED, Looks
from rattle.montecarlo.seed import Rng
from rattle.montecarlo.statistics.intervals import half_width, tail_of
from rattle.scene import InputError, Scene, positive
from rattle.scene.changes import same_speed
from rattle.scene.errors import BudgetEnded
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.progress import ProgressBar, do

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CROSSING_PATHS = 64  # of each long run but the first, which is shorter
FIRST_LENGTH = 64
PATH_PERIODS_OF_LOOKS = (1024, 4096, 16_384, 65_536, 262_144)
"""Periods of all paths together after which a value is judged."""
TAIL = tail_of(len(PATH_PERIODS_OF_LOOKS) * MOST_VALUES)
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
class Crossing(AlongParameter):
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
    ...     scene,
    ...     quantity="rate_above",
    ...     level=600.0,
    ...     over="amplitude",
    ...     between=(0.1, 0.6),
    ...     points=2,
    ...     width=0.5,
    ... )
    >>> set(found.points["verdict"]) <= {"below", "above", "undecided"}
    True
    """

    title = "Crossing of {quantity} = {level:g} over {over}"
    first = BELOW_LEVEL

    scene: Scene
    quantity: str
    level: float
    over: str
    edges: tuple[Sides, ...]
    points: pd.DataFrame
    unit: str = ""
    quantity_unit: str = ""

    def plot(self) -> "Figure":
        """Draw the quantity, with its interval, at every value, and the level.

        Returns
        -------
        Figure
            Of matplotlib; a notebook shows it, ``savefig`` writes it.
        """
        from rattle.compare.parameters.figures import crossing_figure

        return crossing_figure(
            self, self.level, f"{self.quantity}, {self.quantity_unit}".rstrip(", ")
        )

    @property
    def answer(self) -> list[str]:
        """Where it crosses the level in words, also by the estimates alone, and what is not
        known."""
        *sentences, number = super().answer
        near = [f"{value:.3g}" for value in self._cross_estimates()]
        if near:
            places = f"{', '.join(near)} {self.unit}".rstrip()
            sentences.append(f"By the estimates alone it crosses near {places}.")
        return [*sentences, number]

    def _cross_estimates(self) -> Iterator[float]:
        """Where the straight line between two neighbouring estimates crosses the level, over the
        logarithm of the parameter."""
        points = self.points.dropna(subset="estimate")
        away = points["estimate"] - self.level
        for (a, da), (b, db) in pairwise(zip(points["value"], away, strict=True)):
            if da * db < 0.0:
                yield a * (b / a) ** (da / (da - db))


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
    budget: float | None = SEARCH_BUDGET,
    rng: Rng = 0,
    workers: int = 1,
    progress: str | None = None,
) -> Crossing:
    """Find where along a parameter a quantity of the long run crosses a level.

    For one: from which drag torque on is a pair quiet.  A coarse scan, then halving of the
    logarithm wherever the quantity changes sides.  At each value long runs of 16 paths and 64
    periods, then of 64 paths and 64 to 4,096 periods, are made until its interval is on one side of
    the level.  What is said of the
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
        Seconds of processor time, all threads together; compiling is not counted.  A longer run
        that would take more than a fourth of what is left is not begun, and its value stays
        undecided.  With a `folder`, a larger budget continues.  None for no limit.
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
    ...     scene,
    ...     quantity="power",
    ...     level=1e3,
    ...     over="amplitude",
    ...     between=(0.1, 0.6),
    ...     points=2,
    ...     width=0.5,
    ... )
    >>> found.quantity_unit
    'mW'
    """
    given = check_search(scene, over, between, points, width, budget, rng)
    check_quantity("quantity", quantity, scene.stages)
    level = float(positive("level", level))
    positive("slow", slow)
    if progress:
        _state_effort(progress, given, slow)
    return _find_crossings(given, quantity, level, slow, open_store(folder), workers, progress)


def _state_effort(label: str, given: SearchRange, slow: float) -> None:
    """State what the values of a search are expected to take, as those of the first one."""
    do(f"{label}: timing a few paths")
    with suppress(InputError):  # it cannot be simulated, which the search says of its value
        low, _, points, _ = given.scan
        first = given.parameter.scene_at(low)
        least = PATH_PERIODS_OF_LOOKS[0]
        most = PATH_PERIODS_OF_LOOKS[-1]
        seconds = expect_run(first, least // FIRST_LENGTH, FIRST_LENGTH, slow=slow).core_seconds
        state_effort(label, given.parameter.name, points, seconds, seconds * most / least)


def _find_crossings(
    given: SearchRange,
    quantity: str,
    level: float,
    slow: float,
    store: Store,
    workers: int,
    progress: str | None,
) -> Crossing:
    """Search a range for the values between which a quantity crosses a level."""
    parameter = given.parameter
    scene = parameter.scene

    def judge(value: float) -> SideOfLevel:
        changed = parameter.scene_at(value)
        # gears do not have the value of a field that they fix
        factor = unit_of(quantity, changed.gears or scene.gears, "physical")[1]
        slow_there = same_speed(slow, scene, changed)
        its_seed = seed_of(changed, given.seed)

        def run(paths: int, periods: int) -> LongResult:
            size = f"{periods:,} periods of {paths} paths"
            bar.set_postfix_str(f"{parameter.name} = {value:.4g}, {size}")
            cell = LongCell(
                changed,
                its_seed,
                (),
                paths=paths,
                periods=periods,
                slow=slow_there,
                limit=given.time_left,
            )
            result: LongResult = store.obtain(cell, runner.compute)
            return result

        side = judge_level(value, quantity, level / factor, run, given.time_left)
        bar.update()
        return side._replace(
            estimate=factor * side.estimate, low=factor * side.low, high=factor * side.high
        )

    with (
        Runner(workers, given.time_left) as runner,
        ProgressBar(label=progress, unit=" values") as bar,
        ThreadPoolExecutor(workers) as pool,
    ):
        changes, table = find_changes(judge, *given.scan, first=Crossing.first, map_scan=pool.map)
    edges = tuple(Sides(below.value, above.value) for below, above in changes)
    unit = unit_of(quantity, scene.gears, "physical")[0]
    return Crossing(scene, quantity, level, parameter.name, edges, table, parameter.unit, unit)


def judge_level(
    value: float,
    quantity: str,
    level: float,
    run: Callable[[int, int], LongResult],
    time_left: Budget | None = None,
) -> SideOfLevel:
    """Lengthen the long run at one value until a quantity is shown to be on one side of a level.

    `run`: Makes a long run of so many paths and periods.
    """
    side = SideOfLevel(value, Verdict.UNDECIDED)
    looks = Looks(PATH_PERIODS_OF_LOOKS, budget=time_left, share=LOOK_SHARE)
    for size in looks:
        paths = min(size // FIRST_LENGTH, CROSSING_PATHS)
        periods = size // paths
        try:
            result = run(paths, periods)
        except BudgetEnded:
            return side._replace(remark=BUDGET_ENDED)
        except InputError as error:  # no stationary motion is reached
            return side._replace(remark=str(error))
        estimate, low, high = find_interval(result, quantity)
        side = SideOfLevel(value, Verdict.UNDECIDED, periods, estimate, low, high)
        if high < level:
            return side._replace(verdict=BELOW_LEVEL)
        if low > level:
            return side._replace(verdict=ABOVE_LEVEL)
        looks.why = "there are no such impacts" if math.isnan(estimate) else TOO_NEAR
        if estimate > 0.0:
            margin = abs(estimate - level)
            half = 0.5 * (high - low)
            looks.expect(size * (half / margin) ** 2 if margin > 0.0 else math.inf)
    return side._replace(remark=looks.why)


def find_interval(result: LongResult, quantity: str) -> tuple[float, float, float]:
    """A quantity of a long run with the interval that counts all looks at all values."""
    # at rest there is no such row
    columns = ["value", "se", "effective_paths"]
    value, se, paths = result.table.reindex(index=[quantity], columns=columns).to_numpy(float)[0]
    facts = result.facts
    if facts["kind"] != "simulated":
        return value, value, value
    # none was seen: the upper limit of a Poisson count
    if quantity.startswith("rate") and value == 0.0:
        time = 2.0 * math.pi * facts["paths"] * facts["periods"]
        return 0.0, 0.0, most_unseen(time, TAIL)
    if not se > 0.0:
        return math.nan, math.nan, math.nan
    half = float(half_width(paths, TAIL)) * se
    return value, value - half, value + half
