"""Claims about the long run: quantities of a model against a simulation that grows until they are decided."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from rattle.closure.stationary import Law
from rattle.compare.stationary.cell import LongCell, LongResult
from rattle.compare.stationary.judged import CLOSURES_JUDGED, judged_rows, laws, tolerance_of
from rattle.compare.stationary.laws import values_of
from rattle.compare.study.obtain import kept, obtain
from rattle.compare.study.store import Store
from rattle.compare.thresholds.judging import OUTCOMES
from rattle.compare.validation.verdict import widest
from rattle.montecarlo.long_run.names import all_names
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.validate import choice

__all__ = ["LOOKS", "LongDecision", "LongModel", "LongPrediction", "decide_long", "predict_long"]

LOOKS = (64, 256, 1024)
"""Periods of the simulation at each look."""

LongModel = str | Callable[[Scene, Sequence[str]], Mapping[str, float]]
"""A closure's name, or a function of a scene and names of quantities that gives their values."""


class LongPrediction(NamedTuple):
    """What a model says of the long run.

    Attributes
    ----------
    name : str
        Of the model.
    values : dict of str to float
        Of each quantity.
    """

    name: str
    values: dict[str, float]


class LongDecision(NamedTuple):
    """What long runs say of a prediction.

    Attributes
    ----------
    table : DataFrame
        Columns ``quantity, predicted, simulated, se, error, low, high, tolerance, verdict, periods_needed, outcome``; a
        row is that of the look that decided it.
    result : LongResult
        The longest simulation.
    z : float
        Half width of the intervals in standard errors.
    drawn, computed : int
        Simulations used, and those of them that were not in the store.
    seconds : float
        That these took.
    """

    table: pd.DataFrame
    result: LongResult
    z: float
    drawn: int
    computed: int
    seconds: float


def predict_long(model: LongModel, scene: Scene, quantities: Sequence[str]) -> LongPrediction:
    """Evaluate a model for quantities of the long run.

    Parameters
    ----------
    model : str or callable
        A key of `CLOSURES_JUDGED`, or a function ``(scene, quantities) -> mapping`` of names to values.
    scene : Scene
        What is modelled.
    quantities : sequence of str
        Names of `rattle.montecarlo.long_run.names.all_names`.

    Returns
    -------
    LongPrediction

    Raises
    ------
    InputError
        For an unknown closure or quantity, a closure that says nothing of the long run, or a value that is missing.
    """
    if isinstance(quantities, str) or not quantities:
        raise InputError("quantities", quantities, "give a list, as in quantities=['rate', 'energy']")
    for name in quantities:
        choice("quantities", name, all_names(scene.stages))
    if isinstance(model, str):
        law = laws(scene, (choice("closure", model, CLOSURES_JUDGED),))[model]
        if not isinstance(law, Law):
            raise InputError("closure", model, f"says nothing of the long run: {law}")
        found: Mapping[str, Any] = values_of(law, scene, 0.1)
    elif callable(model):
        found = model(scene, tuple(quantities))
    else:
        raise InputError("model", model, "give a closure's name, or a function (scene, quantities) -> mapping")
    label = model if isinstance(model, str) else getattr(model, "__name__", type(model).__name__)
    values = {}
    for name in dict.fromkeys(quantities):
        try:
            values[name] = float(found[name])
        except (LookupError, TypeError, ValueError):
            raise InputError(
                f"result of {label}", name, "is missing or no number; return it, or leave it out"
            ) from None
        if not np.isfinite(values[name]):
            raise InputError(f"result of {label}", name, "is not predicted; leave it out of quantities")
    return LongPrediction(label, values)


def decide_long(
    prediction: LongPrediction, scene: Scene, store: Store, seed: int, false_alarm: float
) -> LongDecision:  # fmt: skip
    """Compare a prediction with long runs of growing length, until every quantity is decided.

    Parameters
    ----------
    prediction : LongPrediction
        From `predict_long`.
    scene : Scene
        What is modelled.
    store : Store
        Where simulations are kept.
    seed : int
        Of the simulation.
    false_alarm : float
        Probability that a true claim fails: the share of this test in that of the session.

    Returns
    -------
    LongDecision
    """
    names = list(prediction.values)
    z = widest(len(names) * len(LOOKS), false_alarm)
    table, drawn, computed, seconds = pd.DataFrame(), 0, 0, 0.0
    for periods in LOOKS:
        cell = LongCell(scene, seed, (), periods=periods)
        new = kept(store, cell) is None
        result = cell.opened(obtain(store, cell))
        drawn, computed, seconds = drawn + 1, computed + new, seconds + new * result.facts["seconds"]
        simulated = {str(name): float(value) for name, value in result.table["value"].items()}
        rows = pd.DataFrame({"quantity": names, "predicted": list(prediction.values.values()), "se_predicted": 0.0})
        rows["tolerance"] = [tolerance_of(name, simulated) for name in names]
        now = judged_rows(rows, result.table, z, max(result.facts["periods"], 1))
        now["outcome"] = now["verdict"].map(OUTCOMES)
        table = now if table.empty else table.where(table["outcome"] != "undecided", now)
        if not (table["outcome"] == "undecided").any() or (table["outcome"] == "fail").any():
            break
    return LongDecision(table, result, z, drawn, computed, seconds)
