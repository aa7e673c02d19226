"""Relative change of stationary quantities for a small change of each parameter: central
differences of long runs."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from rattle.compare.parameters.finding import quantity_words, same_speed, value_text
from rattle.compare.report.finding import Finding
from rattle.compare.stationary.measure import stationary
from rattle.compare.stationary.result import unit_of
from rattle.compare.study.parameters import (
    CHANGE,
    PERCENT,
    RELATIVE_CHANGES,
    Parameter,
    choose_parameters,
    find_parameters,
)
from rattle.montecarlo.long_run import expect_run
from rattle.montecarlo.long_run.estimates import all_names
from rattle.montecarlo.looks import begin_budget
from rattle.montecarlo.seed import Rng, read_whole_seed
from rattle.montecarlo.settings import is_random
from rattle.montecarlo.statistics.intervals import CONFIDENCE, half_width, tail_of
from rattle.scene import (
    Floats,
    InputError,
    Scene,
    check_scene,
    choice,
    compile_ahead,
    duration_text,
    positive,
)
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.progress import ESTIMATES, ProgressBar, do

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# of each long run; a group is one long run of every scene
GROUP_PATHS = 32
GROUP_PERIODS = 64
# independent groups after which the intervals are looked at
GROUPS_OF_LOOKS = (4, 6, 9, 13, 19, 28, 42, 64)
EFFECT_ACCURACY = 0.001
BENT_SHARE = 0.1  # share of an effect by which the two steps must differ to call it not linear


class _Job(NamedTuple):
    """A long run of a group: of the scene itself, or with one parameter changed."""

    name: str  # empty for the scene itself
    factor: float
    scene: Scene


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
        known = find_parameters(self.scene)
        said = []
        for quantity, rows in self.table.dropna(subset="effect").groupby("quantity", sort=False):
            row = rows.iloc[int(rows["effect"].abs().argmax())]
            words = quantity_words(str(quantity))
            if not (row["low"] > 0.0 or row["high"] < 0.0):
                said.append(f"For {words} no effect is larger than its error.")
                continue
            lever = _effect_words(known[row["parameter"]], row)
            the = "" if lever.startswith("`") else "the "  # a field, or a parameter of the gears
            now = value_text(*self.values.loc[str(quantity), ["value", "unit"]])
            said.append(f"The strongest lever on {words} (now {now}) is {the}{lever}.")
        if not said:
            said.append("Nothing that was changed has an effect that can be stated.")
        return [*said, self.said]

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

        return tornado(self.table, list(self.values.index))


def _effect_words(parameter: Parameter, row: pd.Series) -> str:
    half = 50.0 * (row["high"] - row["low"])
    does = "takes {} % off it" if row["effect"] < 0.0 else "adds {} %"
    digits = int(np.clip(1 - np.floor(np.log10(max(half, 1e-3))), 1, 3))
    amount = f"{abs(100.0 * row['effect']):.{digits}f} ± {half:.{digits}f}"
    bent = "" if row["linear"] else " (not linear here)"
    now = value_text(parameter.value, parameter.unit)
    return f"{parameter.words} (now {now}): {PERCENT} more {does.format(amount)}{bent}"


def default_quantities(stages: int) -> tuple[str, ...]:
    """Impacts that are not slow and energy lost, per unit of time, and mean and 95 % speed of
    impacts, by mesh."""
    names = ("power", "rate_above", "speed_above", "q95_speed_above")
    if stages == 1:
        return names
    return ("power", "rate_above", *(f"{name}_mesh{m}" for m in (1, 2) for name in names))


@numpy_defaults
def sensitivity(
    scene: Scene,
    *,
    quantities: Sequence[str] | None = None,
    parameters: Sequence[str] | None = None,
    accuracy: float = EFFECT_ACCURACY,
    slow: float = 0.1,
    budget: float | None = None,
    rng: Rng = 0,
    workers: int = 1,
    progress: str | None = None,
) -> Sensitivity:
    """Find what 1 % more of each parameter does to the rattle.

    The rattle is its impacts per second, the energy that they lose, and their speeds.
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
        Seconds of processor time after which no more groups of runs are begun.
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
    (['omega'], 4)
    """
    check_scene(scene)
    compile_ahead.expect("sensitivity", len(scene.drive))
    seed = read_whole_seed(rng)
    chosen_names = default_quantities(scene.stages) if quantities is None else quantities
    asked = list(dict.fromkeys(chosen_names))
    for name in asked:
        choice("quantities", name, all_names(scene.stages))
    chosen = choose_parameters(scene, parameters)
    positive("accuracy", accuracy)
    time_left = begin_budget(budget)
    remarks: dict[str, str] = {}
    jobs = [_Job("", 1.0, scene)]
    for name, parameter in chosen.items():
        try:
            scenes = change_scenes(parameter, RELATIVE_CHANGES)
            jobs += [_Job(name, factor, changed) for factor, changed in scenes.items()]
        except InputError as error:
            remarks[name] = f"cannot be changed by {RELATIVE_CHANGES[1]:.0%}: {error}"
    if progress and is_random(scene):
        _state_estimate(progress, scene, GROUPS_OF_LOOKS[0] * len(jobs), slow)
    of_parameter = np.array([job.name for job in jobs])
    runs: list[list[Floats]] = []  # logarithms of the quantities, for each group and job
    bar = ProgressBar(label=progress, unit="run")
    with ThreadPoolExecutor(workers) as pool, bar:
        for groups in GROUPS_OF_LOOKS:
            bar.total = groups * len(jobs)
            for group in range(len(runs), groups):
                runs.append([])
                stream = np.random.SeedSequence([seed, group])
                call = partial(_run, scene=scene, asked=asked, slow=slow, rng=stream)
                for job, (values, why) in zip(jobs, pool.map(call, jobs), strict=True):
                    runs[group].append(values)
                    if why:
                        remarks.setdefault(job.name, why)
                    bar.update()
            logs = np.array(runs)
            changed = {name: logs[:, of_parameter == name] for name in chosen}
            table = _effects(chosen, asked, changed, remarks)
            half = 0.5 * (table["high"] - table["low"])
            reached = not bool((half > accuracy).any())
            if reached or time_left.remaining < 0.0 or bool((table["se"].fillna(0.0) == 0.0).all()):
                break
    said = (
        f"{len(runs)} groups of {len(jobs)} long runs,"
        f" {GROUP_PATHS} paths of {GROUP_PERIODS} periods each;"
        f" widest interval ± {half.max():.2g} for {PERCENT} of a parameter"
        + ("" if reached else f", NOT the {accuracy:g} asked for")
    )
    values_now = _values(scene, asked, np.exp(logs[:, 0]))
    return Sensitivity(scene, table, values_now, len(runs), reached, f"{said}.")


def _state_estimate(label: str, scene: Scene, runs: int, slow: float) -> None:
    """State what so many long runs are expected to take, as those of the scene itself."""
    do(f"{label}: timing a few paths")
    seconds = runs * expect_run(scene, GROUP_PATHS, GROUP_PERIODS, slow=slow).core_seconds
    time = f"about {duration_text(seconds, 2)} of processor time"
    more = GROUPS_OF_LOOKS[-1] // GROUPS_OF_LOOKS[0]
    longer = f"up to {more} times as many where the accuracy needs them"
    ESTIMATES.info("%s", f"{label}: {runs} long runs at the least, {time}; {longer}")


def change_scenes(parameter: Parameter, steps: tuple[float, float]) -> dict[float, Scene]:
    """The scenes with a parameter changed down and up by each step, by what it is multiplied by."""
    factors = [1.0 + sign * step for step in steps for sign in (-1.0, 1.0)]
    return {factor: parameter.scene_at(factor * parameter.value) for factor in factors}


def _run(
    job: _Job, scene: Scene, asked: list[str], slow: float, rng: np.random.SeedSequence
) -> tuple[Floats, str]:
    """Logarithms of the quantities in physical units, or why there are none; -inf where a quantity
    is 0."""
    nothing = np.full(len(asked), np.nan)
    there = same_speed(slow, scene, job.scene)
    try:
        found = stationary(
            job.scene, periods=GROUP_PERIODS, paths=GROUP_PATHS, slow=there, closures=(), rng=rng
        )
    except InputError as error:  # no stationary motion is reached
        if not job.name:
            raise
        return nothing, str(error)
    if found.kind == "rest":
        if not job.name:
            why = found.said.removeprefix("At rest: ")
            raise InputError("scene", "at rest", f"{why} Give a larger drive or less drag")
        return nothing, f"comes to rest at {job.factor - 1.0:+.0%}"
    factors = [unit_of(name, job.scene.gears, "physical")[1] for name in asked]
    with np.errstate(divide="ignore"):
        return np.log(factors * found.table["value"].reindex(asked).fillna(0.0).to_numpy()), ""


EFFECTS = ["effect", "low", "high", "small_step", "large_step"]


def _effects(
    chosen: dict[str, Parameter],
    asked: list[str],
    logs: dict[str, Floats],
    remarks: dict[str, str],
) -> pd.DataFrame:
    """The table of a `Sensitivity`, from the logarithms of all quantities by parameter.

    Shapes: `logs` (groups, down and up by step, quantities).
    """
    rows = []
    for i, quantity in enumerate(asked):
        for name, parameter in chosen.items():
            values = logs[name][:, :, i]
            remark = remarks.get(name, "")
            if not remark and not np.isfinite(values).all():
                remark = "no such impacts"
            effect = {} if remark else _effect(values, len(chosen) * len(asked))
            place = {"quantity": quantity, "parameter": name}
            rows.append(place | parameter._asdict() | effect | {"remark": remark})
    numbers = ["effect", "se", "low", "high", "small_step", "large_step"]
    columns = ["quantity", "parameter", "value", "unit", *numbers, "linear", "gain", "remark"]
    return pd.DataFrame(rows, columns=columns).astype(dict.fromkeys([*numbers, "gain"], float))


def _effect(logs: Floats, checks: int) -> dict[str, Any]:
    """Effect of a parameter on a quantity from logarithms at each factor, shape (groups,
    factors)."""
    one = math.log1p(CHANGE)
    span, slopes, shown, linear = find_slopes(logs, RELATIVE_CHANGES, checks)
    half = _half_width(shown)
    alone = float((logs.var(axis=0, ddof=1).reshape(-1, 2).sum(axis=1) / span**2).sum())
    paired = float(slopes.var(axis=0, ddof=1).sum())
    mean = shown.mean()
    logarithms = [mean, mean - half, mean + half, *(of_step.mean() for of_step in slopes.T)]
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
    if differ:  # Richardson: the error of a central difference grows with the square of the step
        return span, slopes, slopes[:, 0] + bent / (span[1] ** 2 / span[0] ** 2 - 1.0), True
    return span, slopes, change @ span / (span @ span), True  # least squares through both steps


def _se(values: Floats) -> Any:
    return values.std(axis=0, ddof=1) / math.sqrt(len(values))


def _half_width(values: Floats, checks: int = 1) -> Any:
    """Half width of the interval of a mean over independent groups, one of so many at once."""
    return half_width(len(values), tail_of(checks, 1.0 - CONFIDENCE)) * _se(values)


def _values(scene: Scene, asked: list[str], found: Floats) -> pd.DataFrame:
    """The quantities of the scene itself, over all groups."""
    mean = found.mean(axis=0)
    half = _half_width(found)
    unit = [unit_of(name, scene.gears, "physical")[0] for name in asked]
    index = pd.Index(asked, name="quantity")
    return pd.DataFrame(
        {"value": mean, "low": mean - half, "high": mean + half, "unit": unit}, index=index
    )
