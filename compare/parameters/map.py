"""The curve along which a closure stops holding, over two parameters: a search at each value of the
second one."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from rattle.closure.mean_map import find_closure
from rattle.compare.engine.cluster import Cluster
from rattle.compare.engine.run import Runner, open_cells, run
from rattle.compare.engine.store import Cell, Content, Facts, Store
from rattle.compare.judge.verdict import DECIDED
from rattle.compare.parameters.boundary import (
    BOUNDARY_IMPACTS,
    SCAN_POINTS,
    boundary,
    state_effort,
)
from rattle.compare.parameters.search import Edge
from rattle.compare.report.finding import Finding
from rattle.compare.report.render import render_sentences
from rattle.compare.study.parameters import find_parameter, find_range
from rattle.montecarlo.kernel.blocks import Blocks
from rattle.montecarlo.seed import read_whole_seed
from rattle.scene import InputError, RattleError, Scene, check_keys, check_scene, count, positive
from rattle.scene.numpy_errors import numpy_defaults

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEARCH_SETTINGS = ("between", "impacts", "points", "width", "tolerances", "rng")
"""Settings of every search; those of `boundary`."""
NOWHERE = "nowhere accurate"


@dataclass(frozen=True)
class Search(Cell):
    """The search at one value of the second parameter."""

    packages = ("closure", "montecarlo", "compare/parameters", "compare/validation")
    group = "searches"

    scene: Scene
    at: str  # the second parameter with its value
    asked: Facts  # of `boundary`; its budget is that of one search by itself
    at_once: int = 1  # searches that run at the same time, whose processor time is counted together

    @property
    def label(self) -> str:
        """Short description for the progress line."""
        return f"the search at {self.at}"

    @property
    def settings(self) -> Facts:
        """Everything that determines the result besides the dimensionless scene."""
        closure = self.asked["closure"]
        gears = self.scene.gears
        names = {"kind": "boundary", "closure": closure.digest if closure.own else closure.name}
        return self.asked | names | {"gears": gears and gears.values}

    def evaluate(self, blocks: Blocks | None = None) -> tuple[pd.DataFrame, Facts]:
        """Search."""
        budget = self.asked.get("budget")
        limit = {"budget": budget and self.at_once * budget}
        result = boundary(self.scene, **self.asked | limit)
        return result.points, {"edges": result.edges, "path_steps": result.path_steps}


@numpy_defaults
@dataclass(frozen=True, repr=False)
class BoundaryMap(Finding):
    """The curve along which a closure stops holding, over two parameters, from `boundary_map`.

    Attributes
    ----------
    scene : Scene
    closure, over, along : str
    curve : DataFrame
        A row for each edge: the value of the second parameter (column ``along``), ``accurate,
        wrong`` (the first parameter, as in `boundary`) and ``why``.  Where there is no edge,
        ``accurate`` is the largest value at which it is accurate and ``wrong`` the smallest at
        which it is shown wrong; NaN where there is none.
    points : DataFrame
        Every value that was judged, as of `boundary`, with a column ``along``.
    path_steps : int
        Steps of all simulated paths.
    units : tuple of str
        Of both parameters, empty where they have none.

    Examples
    --------
    >>> from rattle import DAT21, Scene
    >>> scene = Scene.from_gears(DAT21)
    >>> found = boundary_map(
    ...     scene, along="alpha", between=(0.01, 0.1), impacts=1, points=2, values=2
    ... )
    >>> found.curve["along"].unique()
    array([0.75, 3.  ])
    """

    title = "Boundary of {closure} over {over} and {along}"
    shown = "curve"

    scene: Scene
    closure: str
    over: str
    along: str
    curve: pd.DataFrame
    points: pd.DataFrame
    path_steps: int
    units: tuple[str, str] = ("", "")

    @property
    def answer(self) -> list[str]:
        """The curve in words, and what is not known."""
        curve = self.curve.assign(up=self.curve["accurate"] < self.curve["wrong"])
        has_edge = curve[["accurate", "wrong"]].notna().all(axis="columns")
        edges = curve[has_edge]
        along = edges["along"]
        return render_sentences(
            "parameters/map_answer.j2",
            self.scene.words,
            found=self,
            edges=edges.sort_values("accurate").to_dict("records"),
            rest=curve[~has_edge].to_dict("records"),
            several=along[along.duplicated()].unique().tolist(),
            nowhere=NOWHERE,
            number=len(self.points),
        )

    def plot(self) -> "Figure":
        """Draw where the closure is accurate, where it is wrong, and what lies between.

        Returns
        -------
        Figure
            Of matplotlib; a notebook shows it, ``savefig`` writes it.
        """
        from rattle.compare.parameters.figures import map_figure

        return map_figure(self.curve, self.points, self.along, self.over)


@numpy_defaults
def boundary_map(
    scene: Scene,
    *,
    along: str,
    reach: tuple[float, float] | None = None,
    values: int = 9,
    closure: Any = "saltation",
    over: str = "sigma",
    folder: str | Path | None = None,
    budget: float | None = None,
    workers: int = 1,
    scheduler: str | None = None,
    progress: bool = False,
    **settings: Any,
) -> BoundaryMap:
    """Trace the curve along which a closure stops holding.

    It is a `boundary` at each value of a second parameter.
    The first and the last value are searched first, then those between; what was found on both
    sides says where each search begins.  What is said of the whole map is right with 95 %
    probability.  Nothing is said between the values.

    Parameters
    ----------
    scene : Scene
        What is modelled.
    along : str
        The second parameter, named as `over` is.
    reach : pair of float, optional
        Its range; half its own value to twice it by default, or as far as a scene can have it.
    values : int
        How many values of it, evenly spaced in the logarithm.
    closure : str, callable or Closure
        The closure, as in `boundary`.
    over : str
        The parameter along which each search goes, as in `boundary`.
    folder : path, optional
        Where results are stored: the same map continues there after an interruption.
    budget : float, optional
        Seconds of processor time, all threads together, shared equally by the searches; what they
        leave undecided is said.  Without it there is no limit.
    workers : int
        Threads; the result does not depend on it.
    scheduler : str, optional
        Address of a running Dask cluster that computes instead, as in ``tcp://host:8786``.
    progress : bool
        Whether to show a progress bar on a terminal or in a notebook, and to log the expected time
        first.
    **settings
        Those of `boundary`: `between`, `impacts`, `points`, `width`, `tolerances` and `rng`.

    Returns
    -------
    BoundaryMap

    Raises
    ------
    InputError
        For an unknown closure or parameter, or values of both that no scene can have together;
        before any search.

    Examples
    --------
    >>> from rattle import DAT21, Scene
    >>> scene = Scene.from_gears(DAT21)
    >>> found = boundary_map(
    ...     scene, along="epsilon", reach=(0.8, 0.9), values=2, impacts=1, points=2, width=0.9
    ... )
    >>> found.curve["accurate"].notna().all()
    np.True_
    """
    check_scene(scene)
    check_keys("boundary_map", settings, SEARCH_SETTINGS)
    method = find_closure("closure", closure)
    first = find_parameter(scene, over)
    second = find_parameter(scene, along, "along")
    over, along = first.name, second.name
    if along == over:
        raise InputError("along", along, "is the first parameter too; give another one")
    between = settings.get("between")
    low, high = find_range(second, reach, 2.0)
    grid = np.geomspace(low, high, count("values", values, least=2))
    at = [float(f"{value:.6g}") for value in grid]
    scenes = [second.scene_at(value) for value in at]
    for changed in scenes:
        here = find_parameter(changed, over)
        method.check(here.scene_at(find_range(here, between)[0]))
    settings["rng"] = read_whole_seed(settings.get("rng", 0))
    asked = settings | {"closure": method, "over": over, "searches": values}
    if budget is not None:
        asked["budget"] = positive("budget", budget) / values
    if progress:
        lowest = first.scene_at(find_range(first, between)[0])
        points = values * settings.get("points", SCAN_POINTS)
        state_effort("boundary", first, lowest, points, settings.get("impacts", BOUNDARY_IMPACTS))
    store = open_cells(Path(folder) if folder else None)
    cells = [
        Search(changed, f"{along} = {value:.4g}", asked)
        for value, changed in zip(at, scenes, strict=True)
    ]
    searches = _trace(cells, store, workers, scheduler, progress)
    ordered = list(zip(at, searches, strict=True))
    rows = [row for value, search in ordered for row in curve_rows(value, search)]
    judged = [s.table.assign(along=value) for value, s in ordered if len(s.table)]
    table = pd.concat(judged, ignore_index=True)
    steps = sum(search.facts["path_steps"] for search in searches)
    units = (first.unit, second.unit)
    return BoundaryMap(scene, method.name, over, along, pd.DataFrame(rows), table, steps, units)


def _trace(
    cells: list[Search], store: Store, workers: int, scheduler: str | None, progress: bool
) -> list[Content]:
    """Search at both ends, then between, from the edges that were found on both sides."""
    searches: dict[int, Content] = {}
    wave: dict[int, tuple[int, ...]] = {0: (), len(cells) - 1: ()}
    while wave:
        begun = {}
        at_once = 1 if scheduler else min(workers, len(wave))
        for i, beside in wave.items():
            near = expect([searches[j] for j in beside])
            begun[i] = replace(cells[i], asked=cells[i].asked | {"near": near}, at_once=at_once)
        runner = Cluster(scheduler) if scheduler else Runner(workers)
        failed = run(list(begun.values()), store, runner, show=progress).failed
        if len(failed) == len(begun) and not searches:
            raise RattleError(next(iter(failed.values())))
        for i, cell in begun.items():
            why = failed.get(cell.key)
            nothing = Content(pd.DataFrame(), {"edges": [], "path_steps": 0, "failure": why})
            searches[i] = nothing if why else store.read(cell)
        wave = {(i + j) // 2: (i, j) for i, j in pairwise(sorted(searches)) if j - i > 1}
    return [searches[i] for i in sorted(searches)]


def expect(beside: Sequence[Content]) -> list[float]:
    """Where edges are expected between two values of the second parameter, from those found at
    both."""
    edges = [search.facts["edges"] for search in beside]
    if len(edges) == 2 and len(edges[0]) == len(edges[1]):
        return [
            math.sqrt(u * v)
            for a, b in zip(*edges, strict=True)
            for u, v in zip(a[:2], b[:2], strict=True)
        ]
    return [value for one in edges for edge in one for value in edge[:2]]


def curve_rows(value: float, search: Content) -> list[Facts]:
    """The rows of one value of the second parameter."""
    if edges := search.facts["edges"]:
        return [{"along": value, **Edge(*edge)._asdict()} for edge in edges]
    row = {"along": value, "accurate": math.nan, "wrong": math.nan}
    if failure := search.facts.get("failure"):
        return [row | {"why": failure}]
    points = search.table
    good, bad = (points.loc[points["verdict"] == verdict, "value"] for verdict in DECIDED)
    why = "accurate throughout" if len(good) else NOWHERE
    if len(good) + len(bad) < len(points):
        why = "undecided: " + next(text for text in points["remark"] if text)
    return [row | {"accurate": good.max(), "wrong": bad.min(), "why": why}]
