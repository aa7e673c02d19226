"""The curve along which a closure stops holding, over two parameters: a search at each value of the
second one."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
import pandas as pd

from rattle.closure.mean_map import find_closure
from rattle.compare.engine.cluster import Cluster
from rattle.compare.engine.run import Runner, open_cells, run
from rattle.compare.engine.store import Cell, Content
from rattle.compare.parameters.boundary import (
    BOUNDARY_IMPACTS,
    SCAN_POINTS,
    boundary,
    find_range,
    state_effort,
)
from rattle.compare.parameters.finding import PARAMETER_TEXTS, Finding, list_values, with_unit
from rattle.compare.parameters.search import Edge
from rattle.compare.study.parameters import find_parameter
from rattle.compare.validation.verdict import DECIDED
from rattle.montecarlo.kernel.blocks import Blocks
from rattle.montecarlo.seed import read_whole_seed
from rattle.scene import InputError, RattleError, Scene, check_keys, check_scene, count
from rattle.scene.numpy_errors import numpy_defaults

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEARCH_SETTINGS = ("between", "impacts", "points", "width", "tolerances", "rng")
"""Settings of every search; those of `boundary`."""
NOWHERE = "nowhere accurate"


class Found(NamedTuple):
    """The outcome of one search."""

    edges: tuple[Edge, ...]
    points: pd.DataFrame
    facts: dict[str, Any]  # ``path_steps, seconds``


@dataclass(frozen=True)
class Search(Cell):
    """The search at one value of the second parameter."""

    packages: ClassVar[tuple[str, ...]] = (
        "closure",
        "montecarlo",
        "compare/parameters",
        "compare/validation",
    )
    group: ClassVar[str] = "searches"

    scene: Scene
    at: str  # the second parameter with its value
    asked: dict[str, Any]  # of `boundary`

    @property
    def label(self) -> str:
        """Short description for the progress line."""
        return f"the search at {self.at}"

    @property
    def settings(self) -> dict[str, Any]:
        """Everything that determines the result besides the dimensionless scene."""
        closure = self.asked["closure"]
        gears = self.scene.gears
        names = {"kind": "boundary", "closure": closure.digest if closure.own else closure.name}
        return self.asked | names | {"gears": gears and gears.values}

    def evaluate(self, blocks: Blocks | None = None) -> tuple[pd.DataFrame, dict[str, Any]]:
        """Search."""
        found = boundary(self.scene, **self.asked)
        return found.points, {"edges": found.edges, "path_steps": found.path_steps}

    def restore(self, content: Content) -> Found:
        """Turn a stored result back into edges."""
        return Found(
            tuple(Edge(*edge) for edge in content.facts["edges"]), content.table, content.facts
        )


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
    plain = ("closure", "over", "along", "units", "answer", "path_steps", "curve", "points")

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
        closure = f"`{self.closure}`"
        over = self.over
        along = self.along
        first, second = (f" {unit}" if unit else "" for unit in self.units)
        edges = self.curve[self.curve["accurate"].notna() & self.curve["wrong"].notna()]
        said = []
        stated = edges.index
        if len(edges):
            up = edges["accurate"] < edges["wrong"]
            ends = edges.sort_values("accurate").iloc[[0, -1]]
            low, high = (f"{value:.4g}{first}" for value in ends["accurate"])
            least, most = (f"{value:.4g}{second}" for value in ends["along"])
            values = {"low": low, "high": high, "least": least, "most": most}
            values |= {
                "closure": closure,
                "over": over,
                "along": along,
                "way": "up to" if up.all() else "down to",
            }
            one_way = "one_way" if up.all() or not up.any() else "both_ways"
            headline = PARAMETER_TEXTS["edges"]["same" if low == high else one_way].format(**values)
            nowhere = self.curve[self.curve["why"] == NOWHERE]
            if len(nowhere):  # the least edge is not the least range of validity
                at = f"{along} = {list_values(nowhere['along'])}{second}"
                headline = (
                    f"{headline.removesuffix('.')}, of the values of {along} with an edge; at {at}"
                    f" {NOWHERE}."
                )
            said.append(headline)
            stated = stated.union(nowhere.index)
        several = edges["along"][edges["along"].duplicated()].unique()
        if len(several):
            said.append(
                f"Its range of validity is not one interval at {along} ="
                f" {list_values(several)}{second}."
            )
        for why, rows in self.curve.drop(stated).groupby("why", sort=False):
            said.append(f"At {along} = {list_values(rows['along'])}{second}: {why}.")
        judged = (
            f"{len(self.points)} values of {over} were judged at {self.curve['along'].nunique()}"
            f" values of {along}"
        )
        with_steps = f"with {self.path_steps:.3g} path-steps"
        return [
            *said,
            f"{judged}, {with_steps}; all that is said holds together with 95 % probability.",
        ]

    def plot(self) -> "Figure":
        """Draw where the closure is accurate, where it is wrong, and what lies between.

        Returns
        -------
        Figure
            Of matplotlib; a notebook shows it, ``savefig`` writes it.
        """
        from rattle.compare.parameters.figures import map_figure

        across = with_unit(self.along, self.units[1])
        up = with_unit(self.over, self.units[0])
        return map_figure(self.curve, self.points, across, up)


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
    if along == over:
        raise InputError("along", along, "is the first parameter too; give another one")
    method = find_closure("closure", closure)
    first = find_parameter(scene, over)
    second = find_parameter(scene, along, "along")
    low, high = find_range(second, reach, "reach", 2.0)
    at = [
        float(f"{value:.6g}") for value in np.geomspace(low, high, count("values", values, least=2))
    ]
    scenes = [second.scene_at(value) for value in at]
    for changed in scenes:
        here = find_parameter(changed, over)
        method.check(here.scene_at(find_range(here, settings.get("between"))[0]))
    settings["rng"] = read_whole_seed(settings.get("rng", 0))
    asked = settings | {"closure": method, "over": over, "searches": values}
    if progress:
        low, _ = find_range(first, settings.get("between"))
        points = settings.get("points", SCAN_POINTS)
        impacts = settings.get("impacts", BOUNDARY_IMPACTS)
        state_effort("boundary", first, first.scene_at(low), values * points, impacts)
    found: dict[int, Found | str] = {}
    wave: dict[int, tuple[int, ...]] = {0: (), values - 1: ()}
    store = open_cells(Path(folder) if folder else None)
    while wave:
        cells = {
            i: Search(
                scenes[i],
                f"{along} = {at[i]:.4g}",
                asked | {"near": expect([found[j] for j in beside])},
            )
            for i, beside in wave.items()
        }
        runner = Cluster(scheduler) if scheduler else Runner(workers)
        outcome = run(list(cells.values()), store, runner, show=progress)
        if len(outcome.failed) == len(cells) and not found:
            raise RattleError(next(iter(outcome.failed.values())))
        found |= {i: outcome.failed.get(cell.key) or store.read(cell) for i, cell in cells.items()}
        wave = {(i + j) // 2: (i, j) for i, j in pairwise(sorted(found)) if j - i > 1}
    done = {at[i]: one for i, one in sorted(found.items())}
    curve = pd.DataFrame([row for value, one in done.items() for row in curve_rows(value, one)])
    points = pd.concat(
        [one.points.assign(along=value) for value, one in done.items() if isinstance(one, Found)],
        ignore_index=True,
    )
    steps = sum(one.facts["path_steps"] for one in done.values() if isinstance(one, Found))
    return BoundaryMap(
        scene, method.name, over, along, curve, points, steps, (first.unit, second.unit)
    )


def expect(beside: Sequence[Found | str]) -> list[float]:
    """Where edges are expected between two values of the second parameter, from those found at
    both."""
    edges = [one.edges for one in beside if isinstance(one, Found)]
    if len(edges) == 2 and len(edges[0]) == len(edges[1]):
        return [
            math.sqrt(u * v)
            for a, b in zip(*edges, strict=True)
            for u, v in zip(a[:2], b[:2], strict=True)
        ]
    return [value for one in edges for edge in one for value in edge[:2]]


def curve_rows(value: float, found: Found | str) -> list[dict[str, Any]]:
    """The rows of one value of the second parameter."""
    if isinstance(found, str):
        return [{"along": value, "accurate": math.nan, "wrong": math.nan, "why": found}]
    if found.edges:
        return [{"along": value, **edge._asdict()} for edge in found.edges]
    good, bad = (
        found.points.loc[found.points["verdict"] == verdict, "value"] for verdict in DECIDED
    )
    why = "accurate throughout" if len(good) else NOWHERE
    if len(good) + len(bad) < len(found.points):
        why = "undecided: " + next(text for text in found.points["remark"] if text)
    return [{"along": value, "accurate": good.max(), "wrong": bad.min(), "why": why}]
