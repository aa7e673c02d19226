"""Where a closure stops holding: the public entry and its result."""

import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from rattle.closure.closure import Closure
from rattle.closure.mean_map import find_closure, predict
from rattle.compare.engine.run import Runner
from rattle.compare.engine.store import open_store
from rattle.compare.parameters import search
from rattle.compare.parameters.finding import Finding, list_undecided, list_values
from rattle.compare.parameters.search import Edge, Judgement
from rattle.compare.report.interrupt import BudgetEnded, stop_after
from rattle.compare.report.json_text import json_digest
from rattle.compare.study.cells import Sample
from rattle.compare.study.estimate import expect_work
from rattle.compare.study.parameters import Parameter, find_parameter
from rattle.compare.validation.verdict import Tolerances, Verdict
from rattle.montecarlo.kernel.blocks import Budget
from rattle.montecarlo.looks import BUDGET_ENDED, begin_budget
from rattle.montecarlo.seed import Rng, read_whole_seed
from rattle.scene import InputError, Scene, check_scene, count, positive
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.progress import ProgressBar

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIGMA_RANGE = (1e-3, 2.0)  # where the noise intensity is searched by default
MOMENT_ORDER = 4  # of the closures' moments
BOUNDARY_IMPACTS = 12  # that must be accurate, by default
SCAN_POINTS = 8  # values of the scan, by default
AROUND = 4.0  # other parameters: from a fourth of their value to four times it


@numpy_defaults
@dataclass(frozen=True, repr=False)
class Boundary(Finding):
    """The values of a parameter between which a closure stops holding, from `boundary`.

    Attributes
    ----------
    scene : Scene
    closure, over : str
    edges : tuple of Edge
        Each with ``accurate`` and ``wrong``: the closure is accurate at the first value and shown
        wrong at the second.
    points : DataFrame
        Every value that was judged, in their order: ``value, verdict, paths, error, low, high, row,
        remark``; ``error`` is that of the worst row over its tolerance.
    path_steps : int
        Steps of all simulated paths.
    unit : str
        Of the parameter, empty where it has none.

    Examples
    --------
    >>> from rattle import DAT21, Scene
    >>> scene = Scene.from_gears(DAT21)
    >>> found = boundary(
    ...     scene, closure="corrected", between=(0.001, 1.0), impacts=2, points=3, width=0.5
    ... )
    >>> set(found.points["verdict"]) <= {"accurate", "inaccurate", "undecided"}
    True
    """

    title = "Boundary of {closure} over {over}"
    shown = "points"
    plain = ("closure", "over", "unit", "answer", "edges", "path_steps", "points")

    scene: Scene
    closure: str
    over: str
    edges: tuple[Edge, ...]
    points: pd.DataFrame
    path_steps: int
    unit: str = ""

    @property
    def answer(self) -> list[str]:
        """The edges in words, and what is not known."""
        unit = f" {self.unit}" if self.unit else ""
        closure = f"`{self.closure}`"
        over = self.over
        table = self.points
        span = f"from {over} = {table['value'].min():.4g} to {table['value'].max():.4g}{unit}"
        said = []
        for edge in self.edges:
            way = "up to" if edge.accurate < edge.wrong else "down to"
            accurate = f"{closure} is accurate {way} {over} = {edge.accurate:.4g}{unit}"
            said.append(f"{accurate} and shown wrong at {edge.wrong:.4g} ({edge.why}).")
        if len(self.edges) > 1:
            said.append("Its range of validity is not one interval.")
        verdicts = set(table["verdict"])
        if verdicts == {Verdict.ACCURATE}:
            said += [
                f"{closure} is accurate {span}: no boundary in there.",
                _side(over, unit, table, accurate=True),
            ]
        elif verdicts == {Verdict.INACCURATE}:
            said += [
                f"{closure} is nowhere accurate {span}.",
                _side(over, unit, table, accurate=False),
            ]
        elif not self.edges:
            best = table[table["verdict"] != Verdict.UNDECIDED]
            also = (
                f"; it is {best['verdict'].iloc[0]} at {list_values(best['value'])}{unit}"
                if len(best)
                else ""
            )
            said.append(f"No boundary of {closure} was decided {span}{also}.")
        said += list_undecided(table, over, unit)
        return [*said, f"{len(table)} values were judged, with {self.path_steps:.3g} path-steps."]

    def plot(self) -> "Figure":
        """Draw the error of the worst row over its tolerance at every value.

        Returns
        -------
        Figure
            Of matplotlib; a notebook shows it, ``savefig`` writes it.
        """
        from rattle.compare.parameters.figures import boundary_figure

        return boundary_figure(self.over, self.unit, self.edges, self.points)


@numpy_defaults
def boundary(
    scene: Scene,
    *,
    closure: str | Closure | Callable[..., Any] = "saltation",
    over: str = "sigma",
    between: tuple[float, float] | None = None,
    near: Iterable[float] = (),
    impacts: int = BOUNDARY_IMPACTS,
    points: int = SCAN_POINTS,
    width: float = 0.1,
    tolerances: Tolerances | None = None,
    searches: int = 1,
    folder: str | Path | None = None,
    budget: float | None = None,
    rng: Rng = 0,
    workers: int = 1,
    progress: str | None = None,
) -> Boundary:
    """Find where along a parameter a closure stops holding.

    It is accurate up to one value and shown wrong from another.
    A coarse scan, then halving of the logarithm wherever the verdict changes.  At each value paths
    are added until every section mean and sd is accurate or one is inaccurate, as `validate` judges
    them, at most 1,048,576.  What is said of the whole search is right with 95 % probability: all
    looks at all values are counted.  Between the values of the scan nothing is said: the range of
    validity need not be an interval.

    Parameters
    ----------
    scene : Scene
        What is modelled.
    closure : str, callable or Closure
        The closure: a name, or one's own as in `validate`.
    over : str
        A parameter: a value of the gears in physical units (``torque1``, ``amplitude``, ...), a
        field of the scene (``alpha``, ``correlation_time``, ``start.y1``, ...), of an order of the
        drive (``drive.2.amplitude``), or ``sigma``.
    between : pair of float, optional
        Where to search; for ``sigma`` 0.001 to 2 by default, else a fourth of the scene's own value
        to four times it, or as far as a scene can have it.
    near : iterable of float
        Where an edge is expected: tried, in this order, before halving.
    impacts : int
        Impacts that must be accurate.
    points : int
        Values of the scan.
    width : float
        To which every edge is narrowed: 0.1 for ± 10 %.
    tolerances : Tolerances, optional
        What counts as accurate: 5 % of an sd for means, 10 % for sds.
    searches : int
        Searches of which this is one: what is said of all of them is right with 95 % probability.
    folder : path, optional
        Where results are stored: the same search continues there after an interruption.
    budget : float, optional
        Seconds of processor time after which no further value is judged.
    rng : int, SeedSequence, Generator or BitGenerator
        Seed; a generator of numpy gives a child of its seed sequence, another one each time.
    workers : int
        Threads; the result does not depend on it.
    progress : str, optional
        Label of a progress bar on a terminal or in a notebook; with it the expected time is logged
        first.

    Returns
    -------
    Boundary

    Raises
    ------
    InputError
        For an unknown closure or parameter, or a range that no scene can have.

    Examples
    --------
    >>> from rattle import DAT21, Scene
    >>> found = boundary(
    ...     Scene.from_gears(DAT21), closure="published", between=(0.01, 0.1), impacts=2, points=2
    ... )
    >>> found.points["verdict"].tolist(), found.edges
    (['inaccurate', 'inaccurate'], ())
    """
    parameter, low, high, time_left = check_search(scene, over, between, points, width, budget)
    seed = read_whole_seed(rng)
    z = search.critical(count("impacts", impacts), scene.stages, count("searches", searches))
    limits = Tolerances(*tolerances) if tolerances else Tolerances()
    method = find_closure("closure", closure)
    method.check(parameter.scene_at(low))
    if progress:
        state_effort(progress, parameter, parameter.scene_at(low), points, impacts)
    steps = 0
    bar = ProgressBar(label=progress, unit=" values")
    store = open_store(folder)
    with Runner(workers) as runner, bar:

        def judge(value: float) -> Judgement:
            def simulate(changed: Scene, paths: int, near_branches: bool) -> Any:
                nonlocal steps
                bar.set_postfix_str(f"{over} = {value:.4g}, {paths:,} paths")
                cell = Sample(
                    changed,
                    impacts,
                    own_seed(changed, seed),
                    paths=paths,
                    near_branches=near_branches,
                )
                run = store.obtain(cell, runner.compute)
                steps += run.facts["path_steps"]
                return run

            seconds = time_left.remaining
            ended = Judgement(value, Verdict.UNDECIDED, remark=BUDGET_ENDED)
            if seconds < 0.0:
                return ended
            try:
                changed = parameter.scene_at(value)
                with stop_after(seconds if method.own else math.inf):
                    predicted = predict(changed, method, impacts, MOMENT_ORDER).phase_reduced
                found = search.judge_value(value, changed, predicted, simulate, z, limits)
            except BudgetEnded:
                return ended
            # what this scene cannot have, or what cannot be simulated there
            except InputError as error:
                found = Judgement(value, Verdict.UNDECIDED, remark=str(error))
            bar.update()
            return found

        changes, table = search.find_changes(
            judge, low, high, points, width, first=Verdict.ACCURATE, near=near
        )
    edges = tuple(Edge(good.value, bad.value, bad.row) for good, bad in changes)
    return Boundary(scene, method.name, over, edges, table, steps, parameter.unit)


def state_effort(label: str, parameter: Parameter, scene: Scene, points: int, impacts: int) -> None:
    """State what so many values of a search are expected to take, as those of one scene."""
    cells = [
        Sample(scene, impacts, 0, paths=paths)
        for paths in (search.PATHS_OF_LOOKS[0], search.PATHS_OF_LOOKS[-1])
    ]
    with suppress(InputError):  # it cannot be simulated, which the search says of its value
        least, most = (work.core_seconds for work in expect_work(cells).values())
        search.state_effort(label, parameter.name, points, least, most)


def _side(over: str, unit: str, table: pd.DataFrame, accurate: bool) -> str:
    """On which side of the range to look for a boundary that is not in it."""
    first = table.iloc[0]
    last = table.iloc[-1]
    grows = last["low"] > first["high"]
    falls = first["low"] > last["high"]
    if not falls and over == "sigma":
        grows = True  # where the intervals do not tell it: more noise never helps
    if not grows and not falls:
        return (
            f"If there is one, it lies below {first['value']:.4g} or above"
            f" {last['value']:.4g}{unit}."
        )
    above = grows == accurate
    return (
        f"If there is one, it lies {'above' if above else 'below'}"
        f" {(last if above else first)['value']:.4g}{unit}."
    )


def own_seed(scene: Scene, seed: int) -> int:
    """A seed for each scene: where a search goes next depends on what it saw, so the next noise
    must be another."""
    return int(json_digest({"scene": replace(scene, gears=None).to_dict(), "seed": seed})[:8], 16)


def check_search(
    scene: Scene,
    over: str,
    between: Sequence[float] | None,
    points: int,
    width: float,
    budget: float | None,
) -> tuple[Parameter, float, float, Budget]:
    """What every search is given: its parameter, its range, and its budget, which begins."""
    check_scene(scene)
    count("points", points, least=2)
    if not positive("width", width) < 1.0:
        raise InputError("width", width, "must be below 1")
    parameter = find_parameter(scene, over)
    return parameter, *find_range(parameter, between), begin_budget(budget)


def find_range(
    parameter: Parameter,
    between: Sequence[float] | None,
    name: str = "between",
    around: float = AROUND,
) -> tuple[float, float]:
    """The range of a search; both ends are values that a scene can have."""
    over = parameter.name
    own = parameter.value
    if between is None and over != "sigma" and not own > 0.0:
        raise InputError(name, None, f"give a range: {over} is {own:.4g} in this scene")
    low, high = between or (SIGMA_RANGE if over == "sigma" else (own / around, own * around))
    if not positive(name, low) < positive(name, high):
        raise InputError(name, (low, high), "give a smaller and a larger value")
    for end in (low, high):
        try:
            parameter.scene_at(end)
        except InputError as error:
            if between is not None:
                raise InputError(
                    name, end, f"no scene can have {over} = {end:.4g} ({error})"
                ) from None
            low, high = (own, high) if end == low else (low, own)
    return low, high
