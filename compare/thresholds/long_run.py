"""Claims about the long run: quantities of a model against a simulation that grows until they are decided."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from rattle.closure.stationary import Law
from rattle.compare.stationary.cell import LongCell
from rattle.compare.stationary.laws import values_of
from rattle.compare.stationary.verdicts import CLOSURES_JUDGED, judge_rows, laws, tolerance_of
from rattle.compare.thresholds.claim import Claim
from rattle.compare.thresholds.decision import OUTCOMES, Decision, look_until_decided
from rattle.compare.thresholds.prediction import name_of
from rattle.compare.thresholds.sessions import Thresholds, TimedRun
from rattle.compare.validation.verdict import widest
from rattle.montecarlo.long_run.names import all_names
from rattle.montecarlo.long_run.run import PATHS
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.validate import choice

PERIODS = (64, 256, 1024)
"""Length of the simulation at the first looks; the later ones take more paths of the last."""

LongModel = str | Callable[[Scene, Sequence[str]], Mapping[str, float]]
"""A closure's name, or a function of a scene and names of quantities that gives their values."""


class LongPrediction(NamedTuple):
    """What a model says of the long run."""

    name: str  # of the model
    values: dict[str, float]  # of each quantity


def predict_long(model: LongModel, scene: Scene, quantities: Sequence[str]) -> LongPrediction:
    """Evaluate a model for quantities of the long run.

    `model`: A key of `CLOSURES_JUDGED`, or a function ``(scene, quantities) -> mapping`` of names to values.
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
    label = model if isinstance(model, str) else name_of(model)
    values = {}
    for name in dict.fromkeys(quantities):
        try:
            values[name] = float(found[name])
        except (LookupError, TypeError, ValueError):
            why = "is missing or no number; return it, or leave it out"
            raise InputError(f"result of {label}", name, why) from None
        if not np.isfinite(values[name]):
            raise InputError(f"result of {label}", name, "is not predicted; leave it out of quantities")
    return LongPrediction(label, values)


def decide_long(prediction: LongPrediction, claim: Claim, session: Thresholds) -> Decision:
    """Compare a prediction with long runs that grow until every quantity is decided, first in length, then in paths.

    ``paths_needed`` are paths of the longest run; ``effective_paths`` and ``widened`` are how many paths of the run its
    standard error rests on, and the half width of its interval in standard errors.
    """
    names, settings, longest = list(prediction.values), session.settings, PERIODS[-1]
    sizes = {periods * PATHS: (periods, PATHS) for periods in PERIODS}
    sizes |= {longest * paths: (longest, paths) for paths in settings.sizes(PATHS, claim.budget)}
    z = widest(len(names) * len(sizes), settings.false_alarm)

    def look(size: int | None) -> tuple[pd.DataFrame, TimedRun]:
        periods, paths = sizes[size or 0]
        run = session.simulate(LongCell(claim.scene, settings.seed, (), periods=periods, paths=paths))
        result = run.run
        simulated = {str(name): float(value) for name, value in result.table["value"].items()}
        rows = pd.DataFrame({"quantity": names, "predicted": list(prediction.values.values()), "se_predicted": 0.0})
        rows["tolerance"] = [tolerance_of(name, simulated) for name in names]
        table = judge_rows(rows, result.table, z, size or 0).rename(columns={"periods_needed": "paths_needed"})
        return table.assign(outcome=table["verdict"].map(OUTCOMES), periods=periods, paths=paths), run

    table, runs = look_until_decided(tuple(sizes), look)
    return Decision(table.assign(paths_needed=np.ceil(table["paths_needed"] / longest)), runs, z)
