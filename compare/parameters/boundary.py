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
from rattle.compare.engine.store import Store, open_store
from rattle.compare.judge.verdict import Tolerances, Verdict
from rattle.compare.parameters import search
from rattle.compare.parameters.finding import AlongParameter
from rattle.compare.parameters.search import Edge, JudgedValue, SearchRange, Widths
from rattle.compare.report.interrupt import stop_after
from rattle.compare.report.json_text import json_digest
from rattle.compare.study.cells import Sample
from rattle.compare.study.estimate import expect_work
from rattle.compare.study.parameters import Parameter, find_parameter, find_range
from rattle.montecarlo.looks import BUDGET_ENDED, begin_budget
from rattle.montecarlo.seed import Rng, read_whole_seed
from rattle.scene import InputError, Scene, check_scene, count, positive
from rattle.scene.errors import BudgetEnded
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.progress import ProgressBar

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOMENT_ORDER = 4  # of the closures' moments
BOUNDARY_IMPACTS = 12  # that must be accurate, by default
SCAN_POINTS = 8  # values of the scan, by default


@numpy_defaults
@dataclass(frozen=True, repr=False)
class Boundary(AlongParameter):
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
    first = Verdict.ACCURATE
    grows_with = "sigma"  # the error: more noise never helps a closure

    scene: Scene
    closure: str
    over: str
    edges: tuple[Edge, ...]
    points: pd.DataFrame
    path_steps: int
    unit: str = ""

    def plot(self) -> "Figure":
        """Draw the error of the worst row over its tolerance at every value.

        Returns
        -------
        Figure
            Of matplotlib; a notebook shows it, ``savefig`` writes it.
        """
        from rattle.compare.parameters.figures import boundary_figure

        return boundary_figure(self)


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
    budget: float | None = search.SEARCH_BUDGET,
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
        Seconds of processor time, all threads together; compiling and the closure itself are not
        counted.  A look at more paths that would take more than a fourth of what is left is not
        begun, and its value stays undecided.  With a `folder`, a larger budget continues.  None for
        no limit.
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
    given = check_search(scene, over, between, points, width, budget, rng)
    z = search.critical(count("impacts", impacts), scene.stages, count("searches", searches))
    limits = Tolerances(*(tolerances or ()))
    method = find_closure("closure", closure)
    first = given.parameter.scene_at(given.scan[0])
    method.check(first)
    if progress:
        state_effort(progress, given.parameter, first, points, impacts)
    return _find_edges(
        given, method, impacts, z, limits, near, open_store(folder), workers, progress
    )


def _find_edges(
    given: SearchRange,
    method: Closure,
    impacts: int,
    z: Widths,
    limits: Tolerances,
    near: Iterable[float],
    store: Store,
    workers: int,
    progress: str | None,
) -> Boundary:
    """Search a range for the values between which a closure stops holding."""
    parameter = given.parameter
    steps = 0

    def judge(value: float) -> JudgedValue:
        def simulate(changed: Scene, paths: int, near_branches: bool) -> Any:
            nonlocal steps
            bar.set_postfix_str(f"{parameter.name} = {value:.4g}, {paths:,} paths")
            cell = Sample(
                changed,
                impacts,
                seed_of(changed, given.seed),
                paths=paths,
                near_branches=near_branches,
            )
            run = store.obtain(cell, runner.compute)
            steps += run.facts["path_steps"]
            return run

        seconds = given.time_left.remaining
        try:
            if seconds <= 0.0:
                raise BudgetEnded
            changed = parameter.scene_at(value)
            with stop_after(seconds if method.own else math.inf):
                predicted = predict(changed, method, impacts, MOMENT_ORDER)
            return search.judge_value(
                value, changed, predicted.phase_reduced, simulate, z, limits, given.time_left
            )
        # what this scene cannot have, or what cannot be simulated there, is undecided
        except (BudgetEnded, InputError) as error:
            return JudgedValue(value, Verdict.UNDECIDED, remark=str(error) or BUDGET_ENDED)
        finally:
            bar.update()

    with (
        Runner(workers, given.time_left) as runner,
        ProgressBar(label=progress, unit=" values") as bar,
    ):
        changes, table = search.find_changes(judge, *given.scan, first=Boundary.first, near=near)
    edges = tuple(Edge(good.value, bad.value, bad.row) for good, bad in changes)
    return Boundary(
        parameter.scene, method.name, parameter.name, edges, table, steps, parameter.unit
    )


def state_effort(label: str, parameter: Parameter, scene: Scene, points: int, impacts: int) -> None:
    """State what so many values of a search are expected to take, as those of one scene."""
    cells = [
        Sample(scene, impacts, 0, paths=paths)
        for paths in (search.PATHS_OF_LOOKS[0], search.PATHS_OF_LOOKS[-1])
    ]
    with suppress(InputError):  # it cannot be simulated, which the search says of its value
        least, most = (work.core_seconds for work in expect_work(cells).values())
        search.state_effort(label, parameter.name, points, least, most)


def seed_of(scene: Scene, seed: int) -> int:
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
    rng: Rng,
) -> SearchRange:
    """What every search is given: its parameter, its range, its seed, and its budget, which
    begins."""
    check_scene(scene)
    count("points", points, least=2)
    if not positive("width", width) < 1.0:
        raise InputError("width", width, "must be below 1")
    parameter = find_parameter(scene, over)
    scan = (*find_range(parameter, between), points, width)
    return SearchRange(parameter, scan, begin_budget(budget), read_whole_seed(rng))
