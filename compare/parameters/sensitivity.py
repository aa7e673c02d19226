"""Relative change of stationary quantities for a small change of each parameter: central
differences of long runs."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from rattle.compare.parameters.changed_motion import (
    GROUP_NUMBERS,
    PATHS_OF_A_GROUP,
    ChangedMotion,
    Shared,
    count_work,
)
from rattle.compare.parameters.finding import quantity_words
from rattle.compare.report.finding import Finding
from rattle.compare.report.json_text import Facts
from rattle.compare.report.render import render_sentences, render_text
from rattle.compare.stationary.result import unit_of
from rattle.compare.study.parameters import (
    CHANGE,
    PERCENT,
    RELATIVE_CHANGES,
    Parameter,
    choose_parameters,
)
from rattle.montecarlo.kernel.blocks import Budget
from rattle.montecarlo.long_run.estimates import check_quantity
from rattle.montecarlo.looks import begin_budget
from rattle.montecarlo.seed import Rng, read_whole_seed
from rattle.montecarlo.statistics.intervals import CONFIDENCE, half_width, tail_of
from rattle.scene import (
    Floats,
    InputError,
    Scene,
    check_scene,
    choice,
    compile_ahead,
    duration_text,
    line,
    positive,
)
from rattle.scene.changes import same_speed, words_of_value
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.progress import ESTIMATES, ProgressBar, do

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EFFECT_ACCURACY = 0.001
SENSITIVITY_BUDGET = 60.0  # core-seconds, by default
BENT_SHARE = 0.1  # share of an effect by which the two steps must differ to call it not linear
# of the budget that may be planned for by counted work; the rest is for what nobody counts
PLANNED_SHARE = 0.8
# of what is planned, for a first look at all parameters; the rest goes where intervals are wide
FIRST_SHARE = 0.6
# periods after the burn-in at which all parameters are looked at first, at the least and at the
# most, and those after which none is followed further
SHORTEST_PERIODS = 2
WANTED_PERIODS = 6
FIRST_LOOK_PERIODS = 64
LONGEST_PERIODS = 4096
SHORT_SHARE = 4  # of the first look at all parameters, what comes before the rest of it
PERIODS_OF_BURN_IN = 4  # of the first look, for each period of burn-in at the least
SETTLE_PERIODS = 24  # of the unchanged motion: its burn-in, and what follows
ESTIMATE_SECONDS = 0.0025  # nominal, of the quantities of a group


@numpy_defaults
@dataclass(frozen=True, repr=False)
class Sensitivity(Finding):
    """Effects of the parameters of a scene on its stationary motion, from `sensitivity`.

    Attributes
    ----------
    scene : Scene
    table : DataFrame
        A row for each quantity and parameter.  Columns ``quantity, parameter, value, unit`` (of the
        parameter), ``effect, se, low, high`` (relative change of the quantity for 1 % more of the
        parameter, with its 95 % interval), ``small_step, large_step`` (the same from either step
        alone), ``linear`` (False where both differ), ``gain`` (variance that independent random
        numbers would have over the one with shared numbers) and ``remark`` (why there is no
        effect).
    values : DataFrame
        Index ``quantity``; columns ``value, low, high, unit`` of the scene itself, in physical
        units if it has gears.
    groups : int
        Independent groups of long runs that the intervals rest on.
    reached : bool
        Whether all intervals are as narrow as was asked for.
    said : str
        What was simulated, as a sentence.

    Examples
    --------
    >>> from rattle import DAT21, Scene
    >>> scene = Scene.from_gears(DAT21, sigma=0.5)
    >>> found = sensitivity(scene, quantities=["power"], parameters=["amplitude"], accuracy=0.01)
    >>> bool(found.table.loc[0, "low"] > 0.0)
    True
    """

    title = "Sensitivity"
    shown = "table"

    scene: Scene
    table: pd.DataFrame
    values: pd.DataFrame
    groups: int
    reached: bool
    said: str

    @property
    def answer(self) -> list[str]:
        """The strongest lever of each quantity, a sentence each, and what was simulated."""
        effects = self.table.dropna(subset="effect")
        strongest = effects["effect"].abs().groupby(effects["quantity"], sort=False).idxmax()
        return render_sentences(
            "parameters/sensitivity_answer.j2",
            self.scene.words,
            strongest=effects.loc[strongest].to_dict("records"),
            values=self.values,
            said=self.said,
            change=PERCENT,
            quantity_words=partial(quantity_words, self.scene),
            words_of_value=words_of_value,
        )

    def of(self, quantity: str) -> pd.DataFrame:
        """The effects on one quantity, the strongest first.

        Parameters
        ----------
        quantity : str
            One of those that were asked for.

        Returns
        -------
        DataFrame
            Its rows of `table`, index ``parameter``.

        Raises
        ------
        InputError
            For a quantity that was not asked for.
        """
        choice("quantity", quantity, self.table["quantity"].unique())
        rows = self.table[self.table["quantity"] == quantity].set_index("parameter")
        return rows.drop(columns="quantity").sort_values("effect", key=abs, ascending=False)

    def plot(self) -> "Figure":
        """Draw the effects on every quantity as bars, the strongest first (a tornado diagram).

        Returns
        -------
        Figure
            Of matplotlib; a notebook shows it, ``savefig`` writes it.
        """
        from rattle.compare.parameters.figures import tornado

        return tornado(self, list(self.values.index))


def default_quantities(wheels: int) -> tuple[str, ...]:
    """Impacts that are not slow and energy lost, per unit of time, and mean and 95 % speed of
    impacts, by mesh."""
    names = ("power", "rate_above", "speed_above", "q95_speed_above")
    if wheels == 1:
        return names
    meshes = range(1, wheels + 1)
    return ("power", "rate_above", *(f"{name}_mesh{m}" for m in meshes for name in names))


@numpy_defaults
def sensitivity(
    scene: Scene,
    *,
    quantities: Sequence[str] | None = None,
    parameters: Sequence[str] | None = None,
    accuracy: float = EFFECT_ACCURACY,
    slow: float = 0.1,
    budget: float | None = SENSITIVITY_BUDGET,
    rng: Rng = 0,
    workers: int = 1,
    progress: str | None = None,
) -> Sensitivity:
    """Find what 1 % more of each parameter does to the rattle.

    The rattle is its impacts per unit of time, the energy that they lose, and their speeds.
    The effect is a central difference of logarithms, from long runs with the parameter 2 and 4 % up
    and down, all with the same random numbers.  Where both steps differ by more than chance it is
    extrapolated to a small step; where they differ by a tenth of it, it is called not linear:
    chaotic motion has windows in which it is another.

    Parameters
    ----------
    scene : Scene
        What is modelled.  For a scene with gears its values in physical units are changed: a drive
        with the same amplitude in mm, and ``sigma`` as it is.
    quantities : sequence of str, optional
        Quantities of `stationary`; by default ``power`` and ``rate_above``, by mesh too, and the
        mean and the 95 % quantile of the speed at each mesh.
    parameters : sequence of str, optional
        Parameters to change; all that are not 0 by default.
    accuracy : float
        Largest half width of the 95 % intervals of the effects: 0.001 is 0.1 % for 1 % of a
        parameter.
    slow : float
        Speed below which an impact counts as slow; of gears it stays the same in mm/s.
    budget : float, optional
        Seconds of processor time, all threads together; compiling is not counted.  All parameters
        are looked at first, then those with wide intervals are followed further, so that a smaller
        budget gives wider intervals.  None for no limit.
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
    Sensitivity

    Raises
    ------
    InputError
        For an unknown quantity or parameter, or a motion at rest.
    BurnInError
        If the motion of the scene does not forget its start.

    Examples
    --------
    >>> from rattle import DAT21, Scene
    >>> scene = Scene.from_gears(DAT21, sigma=0.5)
    >>> found = sensitivity(scene, quantities=["rate_above"], parameters=["omega"], accuracy=0.01)
    >>> found.table["parameter"].tolist(), found.groups
    (['omega'], 16)
    """
    check_scene(scene)
    compile_ahead.expect("sensitivity", len(scene.drive))
    seed = read_whole_seed(rng)
    names = default_quantities(scene.stages) if quantities is None else quantities
    asked = [check_quantity("quantities", name, scene.stages) for name in dict.fromkeys(names)]
    chosen = choose_parameters(scene, parameters)
    positive("accuracy", accuracy)
    search = _Search(scene, chosen, asked, positive("slow", slow), begin_budget(budget))
    return search.measure(accuracy, seed, workers, progress)


@dataclass
class _Search:
    """The motions that are compared, and how far each is followed.

    How far is planned by counted work, so that the clock only ends what takes longer than expected.
    """

    scene: Scene
    parameters: dict[str, Parameter]
    asked: list[str]  # the quantities
    slow: float
    limit: Budget
    groups: int = GROUP_NUMBERS[0]
    shared: Shared | None = None
    _work: float = 0.0  # core-seconds of a period of a group

    def __post_init__(self) -> None:
        self.base = ChangedMotion(self.scene)
        self.motions: dict[str, list[ChangedMotion]] = {}
        self.remarks: dict[str, str] = {}  # why a parameter has no effect
        for name, parameter in self.parameters.items():
            try:
                scenes = change_scenes(parameter, RELATIVE_CHANGES).items()
                self.motions[name] = [ChangedMotion(one, name, factor) for factor, one in scenes]
            except InputError as error:
                self.remarks[name] = f"cannot be changed by {RELATIVE_CHANGES[1]:.0%}: {error}"
        self.left_out: list[str] = []  # parameters for which the budget was too small
        self._planned = PLANNED_SHARE * self.limit.seconds  # core-seconds that are left to plan

    def measure(self, accuracy: float, seed: int, workers: int, label: str | None) -> Sensitivity:
        """Follow the motions until all intervals are narrow enough, or the budget is spent."""
        with ThreadPoolExecutor(workers) as pool, ThreadPoolExecutor(workers) as inner:
            self.plan(pool, label)
            with ProgressBar(label=label, unit="period") as bar:
                self.begin(seed, pool, inner, bar)
                while True:
                    table = self.find_effects()
                    halves = 0.5 * (table["high"] - table["low"])
                    widest = halves.groupby(table["parameter"]).max()
                    if not self.refine(widest[widest > accuracy]):
                        break
        half = float(widest.max())
        reached = math.isfinite(half) and not ((widest > accuracy).any() or self.left_out)
        sentence = self.describe(half, accuracy, reached)
        return Sensitivity(self.scene, table, self.find_values(), self.groups, reached, sentence)

    def plan(self, pool: ThreadPoolExecutor, label: str | None) -> None:
        """Find what is exact, or choose the number of groups, and state what is expected."""
        scene = self.scene
        slow = self.slow
        changed = [motion for four in self.motions.values() for motion in four]
        if self.base.find_exact(slow):
            list(pool.map(lambda one: one.find_exact(same_speed(slow, scene, one.scene)), changed))
            return
        do("sensitivity: timing a few paths")
        with self.limit.pause():
            self._work = PATHS_OF_A_GROUP * count_work(scene, slow)
        periods = len(changed) * WANTED_PERIODS + SETTLE_PERIODS
        room = FIRST_SHARE * self._planned
        fitting = [n for n in GROUP_NUMBERS if n * self._work * periods <= room]
        self.groups = max(fitting, default=GROUP_NUMBERS[-1])
        if not label:
            return
        most = ""
        if math.isfinite(self.limit.seconds):
            most = f", {duration_text(self.limit.seconds)} at the most"
        least = min(self.groups * self._work * periods, self.limit.seconds)
        time = f"about {duration_text(least, 2)} of processor time at the least{most}"
        paths = PATHS_OF_A_GROUP * self.groups
        ESTIMATES.info("%s", f"{label}: {len(changed) + 1} motions of {paths} paths each, {time}")

    def _cost(self, periods: float) -> float:
        """Counted core-seconds of so many periods of the motions of a parameter."""
        return 2 * len(RELATIVE_CHANGES) * self.groups * (self._work * periods + ESTIMATE_SECONDS)

    def begin(
        self, seed: int, pool: ThreadPoolExecutor, inner: ThreadPoolExecutor, bar: ProgressBar
    ) -> None:
        """Follow all motions equally far, or as many of them as the budget allows."""
        if not self._work:
            return
        do("sensitivity: the motion as it is")
        shared = Shared(self.scene, self.slow, seed, self.groups, self.limit, inner, bar)
        self.shared = shared
        self._pool = pool
        self._bar = bar
        # of the stationary motion: the few paths that chose the groups have hardly begun
        self._work = PATHS_OF_A_GROUP * shared.work
        self._planned -= self.groups * self._work * shared.base.elapsed
        least = shared.burn_in
        room = FIRST_SHARE * self._planned / max(len(self.motions), 1)
        periods = FIRST_LOOK_PERIODS
        while True:
            # an effect takes as long to develop as the start takes to be forgotten, which the test
            # of the burn-in cannot see where all motions begin alike
            burn_in = max(least, periods // PERIODS_OF_BURN_IN)
            if periods <= SHORTEST_PERIODS or self._cost(burn_in + periods) <= room:
                break
            periods -= 1
        shared.burn_in = burn_in
        affordable = max(self._planned / self._cost(burn_in + periods), 1.0)
        names = list(self.motions)
        if affordable < len(names):
            self.left_out = names[int(affordable) :]
            names = names[: int(affordable)]
        self.base.follow(shared, periods)
        self.base.note_rest()
        # where a motion costs more than was counted, all parameters have been looked at shortly
        # before the clock ends the longer look
        shortly = max(periods // SHORT_SHARE, 1)
        self._follow(dict.fromkeys(names, shortly), burn_in)
        if periods > shortly and self.limit.remaining > 0.0:
            self._follow(dict.fromkeys(names, periods), 0)

    def refine(self, wide: pd.Series) -> bool:
        """Follow the parameters with the widest intervals further; False if none can be.

        Shapes: `wide` (parameters,).
        """
        until = {}
        room = self._planned
        for name in wide.sort_values(ascending=False).index:
            periods = max(motion.periods for motion in self.motions.get(str(name), [self.base]))
            cost = self._cost(periods)
            if 0 < periods < LONGEST_PERIODS and cost <= room:
                room -= cost
                until[str(name)] = 2 * periods
        if not until or self.limit.remaining <= 0.0:
            return False
        self._follow(until, 0)
        return True

    def _follow(self, until: dict[str, int], burn_in: int) -> None:
        """Follow the motions of some parameters until so many periods after their burn-in."""
        shared = self.shared
        assert shared is not None
        jobs = [
            (motion, periods) for name, periods in until.items() for motion in self.motions[name]
        ]
        before = {name: self.motions[name][0].periods for name in until}
        missing = sum(until[name] - before[name] + burn_in for name in until)
        self._bar.total = self._bar.n + 2 * len(RELATIVE_CHANGES) * missing
        list(self._pool.map(lambda job: job[0].follow(shared, job[1]), jobs))
        self._planned -= sum(self._cost(until[name] - before[name] + burn_in) for name in until)

    def find_effects(self) -> pd.DataFrame:
        """The effects as far as the motions have been followed."""
        ended = "the budget ended before it was changed"
        logs = {}  # of all quantities, by parameter; (groups, down and up by step, quantities)
        for name, four in self.motions.items():
            for motion in four:
                motion.note_rest()
            why = next((motion.why for motion in four if motion.why), "")
            unfinished = any(not (motion.periods or motion.exact) for motion in four)
            if why or unfinished:
                self.remarks[name] = why or ended
                if not why and name not in self.left_out:
                    self.left_out.append(name)
                continue
            logs[name] = np.stack([one.logs(self.asked, self.groups) for one in four], axis=1)
        rows = []
        for i, quantity in enumerate(self.asked):
            for name, parameter in self.parameters.items():
                remark = self.remarks.get(name, "")
                if not remark and not np.isfinite(logs[name][:, :, i]).all():
                    remark = "no such impacts"
                checks = len(self.parameters) * len(self.asked)
                effect = {} if remark else _effect(logs[name][:, :, i], checks)
                place = {"quantity": quantity, "parameter": name}
                now = {"value": parameter.value, "unit": parameter.unit}
                rows.append(place | now | effect | {"remark": remark})
        numbers = [*EFFECTS, "se", "gain"]
        table = pd.DataFrame(rows, columns=SENSITIVITY_COLUMNS)
        return table.astype(dict.fromkeys(numbers, float))

    def find_values(self) -> pd.DataFrame:
        """The quantities of the scene itself, over all groups."""
        values = np.exp(self.base.logs(self.asked, self.groups))
        mean = values.mean(axis=0)
        half = _half_width(values)
        unit = [unit_of(name, self.scene.gears, "physical")[0] for name in self.asked]
        index = pd.Index(self.asked, name="quantity")
        columns = {"value": mean, "low": mean - half, "high": mean + half, "unit": unit}
        return pd.DataFrame(columns, index=index)

    def describe(self, half: float, accuracy: float, reached: bool) -> str:
        """What was simulated, what it gives, and what a larger budget would give."""
        periods = [motion.periods for four in self.motions.values() for motion in four]
        text = render_text(
            "parameters/sensitivity_said.j2",
            search=self,
            paths=PATHS_OF_A_GROUP,
            number=len(periods),
            periods=[number for number in periods if number] or [0],
            half=half,
            change=PERCENT,
            reached=reached,
            accuracy=accuracy,
        )
        return line(text)


def change_scenes(parameter: Parameter, steps: tuple[float, float]) -> dict[float, Scene]:
    """The scenes with a parameter changed down and up by each step, by what it is multiplied by."""
    factors = [1.0 + sign * step for step in steps for sign in (-1.0, 1.0)]
    return {factor: parameter.scene_at(factor * parameter.value) for factor in factors}


EFFECTS = ["effect", "low", "high", "small_step", "large_step"]
SENSITIVITY_COLUMNS = [
    *("quantity", "parameter", "value", "unit", "effect", "se", "low", "high"),
    *("small_step", "large_step", "linear", "gain", "remark"),
]


def _effect(logs: Floats, checks: int) -> Facts:
    """Effect of a parameter on a quantity from logarithms at each factor, shape (groups,
    factors)."""
    one = math.log1p(CHANGE)
    span, slopes, shown, linear = find_slopes(logs, RELATIVE_CHANGES, checks)
    half = _half_width(shown)
    alone = float((logs.var(axis=0, ddof=1).reshape(-1, 2).sum(axis=1) / span**2).sum())
    paired = float(slopes.var(axis=0, ddof=1).sum())
    mean = shown.mean()
    # what both steps together miss of a bend that is too small to be told from chance
    missed = float(_extrapolate(slopes, span).mean() - mean) if linear else 0.0
    low = mean - half + min(missed, 0.0)
    high = mean + half + max(missed, 0.0)
    logarithms = [mean, low, high, *(of_step.mean() for of_step in slopes.T)]
    effects = {name: math.expm1(one * v) for name, v in zip(EFFECTS, logarithms, strict=True)}
    return effects | {
        "se": one * _se(shown),
        "linear": linear,
        "gain": alone / paired if paired > 0.0 else math.nan,
    }


def find_slopes(
    values: Floats, steps: tuple[float, float], checks: int
) -> tuple[Floats, Floats, Floats, bool]:
    """Slopes of a value over the logarithm of a parameter, from its values at both steps down and
    up.

    Returns the differences of the logarithm (steps,), the slope of each group and step (groups,
    steps), that of each group from both steps (groups,), and whether these agree.  Shapes: `values`
    (groups, down and up by step).
    """
    span = np.array([math.log((1.0 + h) / (1.0 - h)) for h in steps])
    change = values[:, 1::2] - values[:, ::2]
    slopes = change / span
    bent = slopes[:, 0] - slopes[:, 1]
    differ = abs(bent.mean()) > _half_width(bent, checks)
    if differ and abs(bent.mean()) > BENT_SHARE * max(abs(slopes.mean(axis=0))):
        return span, slopes, slopes[:, 0], False
    if differ:
        return span, slopes, _extrapolate(slopes, span), True
    return span, slopes, change @ span / (span @ span), True  # least squares through both steps


def _extrapolate(slopes: Floats, span: Floats) -> Floats:
    """Slopes at a small step: the error of a central difference grows with the square of the step
    (Richardson)."""
    bent = slopes[:, 0] - slopes[:, 1]
    return np.asarray(slopes[:, 0] + bent / (span[1] ** 2 / span[0] ** 2 - 1.0))


def _se(values: Floats) -> Any:
    return values.std(axis=0, ddof=1) / math.sqrt(len(values))


def _half_width(values: Floats, checks: int = 1) -> Any:
    """Half width of the interval of a mean over independent groups, one of so many at once."""
    return half_width(len(values), tail_of(checks, 1.0 - CONFIDENCE)) * _se(values)
