"""What a closure says 1 % more of each parameter does to its section moments, beside a simulation,
with verdicts."""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import repeat
from typing import Any

import numpy as np
import pandas as pd

from rattle.closure.closure import Closure
from rattle.closure.mean_map import find_closure, predict
from rattle.compare.judge.verdict import JUDGED, Tolerances, judge
from rattle.compare.parameters.finding import by_error
from rattle.compare.parameters.sensitivity import change_scenes, find_slopes
from rattle.compare.report.finding import Finding
from rattle.compare.report.json_text import Facts
from rattle.compare.report.render import render_sentences
from rattle.compare.study.parameters import CHANGE, PERCENT, Parameter, choose_parameters
from rattle.montecarlo import Sampling, default_step, simulate
from rattle.montecarlo.diagnostics.accuracy import small_noise
from rattle.montecarlo.diagnostics.reference import at_wall
from rattle.montecarlo.kernel.blocks import Budget, clock
from rattle.montecarlo.looks import begin_budget
from rattle.montecarlo.seed import Rng, read_whole_seed
from rattle.montecarlo.statistics.intervals import CONFIDENCE, half_width, tail_of
from rattle.scene import (
    Floats,
    InputError,
    Scene,
    check_scene,
    count,
    duration_text,
    section_names,
)
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.progress import ESTIMATES, ProgressBar

# independent groups of paths, within a budget; random numbers are shared within each
CLOSURE_GROUPS = 16
FEWEST_GROUPS = 4
SIMULATED_CHANGES = (0.005, 0.01)  # relative changes of a parameter that is simulated, up and down
PREDICTED_CHANGE = 1e-3  # the same of the closure, which has no noise
CHANGED_MOMENTS = ("mean", "sd")
CHANGED_ORDER = 4  # of the closure's moments
PAIRED_SCHEME = "exact-flight"
NO_SDS = "without noise there are no standard deviations; give one above 0"
CHANGE_COLUMNS = [
    *("parameter", "impact", "quantity", "moment", "predicted", "simulated", "se", "error"),
    *("low", "high", "tolerance", "linear", "verdict", "paths_needed"),
]


@numpy_defaults
@dataclass(frozen=True, repr=False)
class ClosureSensitivity(Finding):
    """Changes of the section moments of a closure for 1 % more of each parameter, from
    `closure_sensitivity`.

    Attributes
    ----------
    scene : Scene
    closure : str
    table : DataFrame
        A row for each parameter, impact, quantity and moment.  Columns ``parameter, impact,
        quantity, moment, predicted, simulated, se, error, low, high, tolerance, linear, verdict,
        paths_needed``; changes are in units of the sd of the quantity, the interval holds for all
        rows at once (95 %).
    paths : int
        Simulated paths of each scene.

    Examples
    --------
    >>> from rattle import DAT21, Scene
    >>> found = closure_sensitivity(
    ...     Scene.from_gears(DAT21, sigma=0.01), parameters=["omega"], impacts=1, paths=4096
    ... )
    >>> sorted(set(found.table["moment"]))
    ['mean', 'sd']
    """

    title = "Sensitivity of {closure}"
    shown = "table"

    scene: Scene
    closure: str
    table: pd.DataFrame
    paths: int

    @property
    def answer(self) -> list[str]:
        """How many changes are accurate, and the worst, in sentences."""
        rows = self.table[self.table["verdict"].isin(JUDGED)]
        number = rows["verdict"].value_counts()
        return render_sentences(
            "parameters/of_closure_answer.j2",
            self.scene.words,
            found=self,
            change=PERCENT,
            counts={verdict: number.get(verdict, 0) for verdict in JUDGED},
            worst=None if rows.empty else by_error(rows).iloc[0],
            bent=(~self.table["linear"]).sum(),
            step=SIMULATED_CHANGES[1],
        )


@numpy_defaults
def closure_sensitivity(
    scene: Scene,
    *,
    closure: str | Closure | Callable[..., Any] = "saltation",
    parameters: Sequence[str] | None = None,
    impacts: int = 4,
    paths: int = 16_384,
    tolerances: Tolerances | None = None,
    budget: float | None = None,
    rng: Rng = 0,
    workers: int = 1,
    progress: str | None = None,
) -> ClosureSensitivity:
    """Judge what a closure says that 1 % more of each parameter does to its section moments.

    The closure's change is a central difference; the simulated one is that of paths with the same
    random numbers at 0.5 and 1 % less and more, in independent groups, as in `sensitivity`; the
    start stays as it is in dimensionless numbers.  A change is accurate if the whole interval of
    its error is within 5 % (means) or 10 % (sds) of the change itself, or of 1 % of the standard
    deviation where that is more.  Where both steps differ it is not linear and excluded, as where
    another mesh is struck first.

    Parameters
    ----------
    scene : Scene
        What is modelled; with noise.
    closure : str, callable or Closure
        The closure: a name, or one's own as in `validate`.
    parameters : sequence of str, optional
        Parameters to change, as in `sensitivity`; all that are not 0 by default.
    impacts : int
        Impacts that are judged.
    paths : int
        Paths of each scene, 1,024 or more.
    tolerances : Tolerances, optional
        In place of 5 and 10 %.
    budget : float, optional
        Seconds of processor time after which no more paths are begun; a fourth of them are in any
        case.
    rng : int, SeedSequence, Generator or BitGenerator
        Seed; a generator of numpy gives a child of its seed sequence, another one each time.
        The result is the same for any number of workers.
    workers : int
        Threads.
    progress : str, optional
        Label of a progress bar on a terminal or in a notebook; with it the expected time is logged
        first.

    Returns
    -------
    ClosureSensitivity

    Raises
    ------
    InputError
        For an unknown closure or parameter, or a scene without noise.

    Examples
    --------
    >>> from rattle import DAT21, Scene
    >>> scene = Scene.from_gears(DAT21, sigma=0.01)
    >>> found = closure_sensitivity(scene, parameters=["amplitude"], impacts=1, paths=4096)
    >>> bool(found.table["verdict"].value_counts()["accurate"] > 6)
    True
    """
    check_scene(scene)
    seed = read_whole_seed(rng)
    if scene.sigma == 0.0:
        raise InputError("sigma", 0.0, NO_SDS)
    count("impacts", impacts)
    time_left = begin_budget(budget)
    group_paths = -(-count("paths", paths, least=64 * CLOSURE_GROUPS) // CLOSURE_GROUPS)
    method = find_closure("closure", closure)
    method.check(scene)
    allowed = Tolerances(*(tolerances or ()))
    runs = _ChangedRuns(scene, parameters, impacts, group_paths, seed)
    return runs.compare(method, allowed, runs.follow(time_left, workers, progress))


@dataclass
class _ChangedRuns:
    """Runs of a scene and of its changes, with the same random numbers in each group of paths."""

    scene: Scene
    asked: Sequence[str] | None  # the parameters
    impacts: int
    group_paths: int
    seed: int

    def __post_init__(self) -> None:
        self.scenes = [self.scene]  # as it is, then with each parameter down and up by step
        self.changed: dict[str, Parameter] = {}
        for name, parameter in choose_parameters(self.scene, self.asked).items():
            try:
                self.scenes += change_scenes(parameter, SIMULATED_CHANGES).values()
                self.changed[name] = parameter
            except InputError:  # a restitution of 1 cannot be changed so
                if self.asked is not None:
                    raise
        self._simulate = partial(
            simulate,
            paths=self.group_paths,
            impacts=self.impacts,
            # the same, so that random numbers are shared
            dt=min(default_step(one, PAIRED_SCHEME, False) for one in self.scenes),
            scheme=PAIRED_SCHEME,
        )

    def find_moments(self, scene: Scene, group: int) -> Floats:
        """Means and sds of a scene from a group of paths; shape (moments, quantities, impacts)."""
        stream = np.random.SeedSequence([self.seed, group])
        sampling = Sampling(control=small_noise(self.scene))  # where a control variate pays
        run = self._simulate(scene.phase_reduced, rng=stream, sampling=sampling)
        return _moments(run.section, scene, self.impacts)

    def follow(self, time_left: Budget, workers: int, label: str | None) -> Floats:
        """Means and sds of all scenes, from groups that are begun within a budget.

        Shapes: result (scenes, groups, moments, quantities, impacts).
        """
        total = CLOSURE_GROUPS * len(self.scenes)
        if label:
            self.find_moments(self.scene, 0)  # compiles
            began = clock()
            self.find_moments(self.scene, 0)
            time = f"about {duration_text(total * (clock() - began), 2)} of processor time"
            ESTIMATES.info("%s", f"{label}: {total} runs of {self.group_paths:,} paths, {time}")
        groups: list[list[Floats]] = []
        with (
            ThreadPoolExecutor(workers) as pool,
            ProgressBar(label=label, total=total, unit="run") as bar,
        ):
            for group in range(1, CLOSURE_GROUPS + 1):
                if group > FEWEST_GROUPS and time_left.remaining <= 0.0:
                    break
                groups.append([])
                for moments in pool.map(self.find_moments, self.scenes, repeat(group)):
                    groups[-1].append(moments)
                    bar.update()
        return np.array(groups).swapaxes(0, 1)

    def compare(self, method: Closure, allowed: Tolerances, values: Floats) -> ClosureSensitivity:
        """Judge the changes that a closure predicts by the means and sds of all scenes.

        Shapes: `values` (scenes, groups, moments, quantities, impacts).
        """
        paths = values.shape[1] * self.group_paths
        mesh = self._simulate(self.scene, rng=self.seed).section["mesh"].to_numpy()
        unit = values[0, :, 1].mean(axis=0)
        quantities = section_names(self.scene.stages)
        unit[at_wall(np.array(quantities)[:, None], mesh)] = math.nan
        rows = []
        for k, (name, parameter) in enumerate(self.changed.items()):
            slope = _predict_slope(parameter, method, self.impacts)
            # (groups, down and up by step, moments, quantities, impacts)
            changed = values[1 + 4 * k : 5 + 4 * k].swapaxes(0, 1)
            for (m, q, i), predicted in np.ndenumerate(slope):
                checks = slope.size * len(self.changed)
                change = _change(predicted, changed[:, :, m, q, i], unit[q, i], checks, allowed[m])
                change |= {"parameter": name, "impact": i + 1, "quantity": quantities[q]}
                rows.append(change | {"moment": CHANGED_MOMENTS[m]})
        table = judge(pd.DataFrame(rows).assign(paths=float(paths)))
        return ClosureSensitivity(self.scene, method.name, table[CHANGE_COLUMNS], paths)


def _predict_slope(parameter: Parameter, method: Closure, impacts: int) -> Floats:
    """Derivative of a closure's section moments by the logarithm of a parameter."""
    ends = []
    for factor in (1.0 - PREDICTED_CHANGE, 1.0 + PREDICTED_CHANGE):
        scene = parameter.scene_at(factor * parameter.value)
        predicted = predict(scene, method, impacts, CHANGED_ORDER).phase_reduced
        ends.append(_moments(predicted.section, scene, impacts))
    return (ends[1] - ends[0]) / math.log((1.0 + PREDICTED_CHANGE) / (1.0 - PREDICTED_CHANGE))


def _moments(section: pd.DataFrame, scene: Scene, impacts: int) -> Floats:
    """Means and sds of a section table, physical where there are gears; shape (moments, quantities,
    impacts)."""
    quantities = section_names(scene.stages)
    names = [prefix + quantity for prefix in ("", "sd_") for quantity in quantities]
    table = section.reindex(index=range(1, impacts + 1), columns=names)
    if scene.gears is not None:
        units = [scene.gears.units.of_column(name) for name in names]
        table *= [unit[1] for unit in units if unit]
    return table.to_numpy(float).T.reshape(len(CHANGED_MOMENTS), len(quantities), impacts)


def _change(predicted: float, values: Floats, unit: float, checks: int, tolerance: float) -> Facts:
    """A change for 1 % more in units of an sd, predicted and simulated; excluded where that is
    NaN, or it bends.

    Shapes: `values` (groups, down and up by step).
    """
    judged = unit > 0.0
    one = math.log1p(CHANGE) / unit if judged else math.nan
    _, _, shown, linear = find_slopes(values, SIMULATED_CHANGES, checks)
    simulated = one * float(shown.mean())
    se = one * float(shown.std(ddof=1)) / math.sqrt(len(shown))
    noise = float(half_width(len(shown), tail_of(checks, 1.0 - CONFIDENCE))) * se
    error = one * predicted - simulated
    return {
        "predicted": one * predicted,
        "simulated": simulated,
        "se": se,
        "error": error,
        "low": error - noise,
        "high": error + noise,
        "noise": noise,
        "tolerance": tolerance * max(abs(simulated), CHANGE),
        "linear": bool(linear or not judged),
        "judged": bool(linear and judged),
    }
