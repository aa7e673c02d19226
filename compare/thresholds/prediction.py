"""Predictions of a closure or of a user's own model, validated before they are used."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from rattle.closure import CLOSURES, mean_map
from rattle.compare.thresholds.claim import Claim
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.text import line
from rattle.scene.validate import choice

Model = str | Callable[[Scene, int], pd.DataFrame]
"""A closure's name, or a function of a scene and a number of impacts."""


@dataclass(frozen=True)
class ModelPrediction:
    """Predicted section moments, complete and finite where the claim needs them."""

    closure: str  # name of the closure or model
    section: pd.DataFrame  # index ``impact``; the columns of the claim


def predict(model: Model, claim: Claim) -> ModelPrediction:
    """Evaluate a model for the section moments of a claim.

    `model`: A closure (``"saltation"``), or a function ``(scene, impacts) -> DataFrame`` whose table has the
    index ``impact`` from 1, columns ``tau, flight, x1, y1, x2, y2`` for means and ``sd_tau, ...`` for standard
    deviations; those that the claim does not need may be missing.

    Examples
    --------
    >>> from pathlib import Path
    >>> from rattle.scene import DAT21, Scene
    >>> from rattle.compare.thresholds.claim import read_claim
    >>> claim = read_claim({"scene": Scene.from_gears(DAT21, sigma=0.1), "impacts": 1, "quantities": "tau"}, Path())
    >>> predict("saltation", claim).section.round(4).to_dict("list")
    {'tau': [0.56], 'sd_tau': [0.0016]}
    """
    impacts = claim.impacts[-1]
    if isinstance(model, str):
        found = mean_map(claim.scene, impacts=impacts, closure=choice("closure", model, CLOSURES))
        why = f" ({found.stopped})" if found.stopped else ""
        return ModelPrediction(model, _complete(model, found.section, claim, why))
    if not callable(model):
        raise InputError("model", model, "give a closure's name, or a function (scene, impacts) -> DataFrame")
    name = name_of(model)
    return ModelPrediction(name, _complete(name, model(claim.scene, impacts), claim))


def name_of(model: Callable[..., object]) -> str:
    """Name of a user's function, on one line."""
    return line(str(getattr(model, "__name__", type(model).__name__)))


def _complete(name: str, table: object, claim: Claim, why: str = "") -> pd.DataFrame:
    """The part of a table that the claim needs, as finite numbers."""
    if not isinstance(table, pd.DataFrame):
        raise InputError(f"result of {name}", type(table).__name__, "return a DataFrame, a row for each impact")
    if missing := [c for c in claim.columns if c not in table.columns]:
        remedy = "add it, or change the marker's quantities and moments"
        raise InputError(f"columns of {name}", list(table.columns), f"{missing[0]!r} is missing; {remedy}")
    if not (table.index.is_unique and set(claim.impacts) <= set(table.index)):
        why = f"must hold each impact once, from 1 to {claim.impacts[-1]}"
        raise InputError(f"index of {name}", table.index.tolist(), why)
    picked = table.loc[list(claim.impacts), list(claim.columns)].rename_axis(index="impact")
    try:
        values = picked.astype(float)
    except (TypeError, ValueError):
        wrong = [c for c in picked if not pd.api.types.is_numeric_dtype(picked[c])]
        raise InputError(f"column {wrong[0]!r} of {name}", picked[wrong[0]].tolist(), "must hold numbers") from None
    bad = np.argwhere(~np.isfinite(values.to_numpy()))
    if bad.size:
        impact, column = values.index[bad[0][0]], values.columns[bad[0][1]]
        remedy = "leave it out of the marker's quantities, moments or impacts, or correct the model"
        value = float(values.loc[impact, column])
        raise InputError(f"{column} of {name} at impact {impact}", value, f"is not a finite number{why}; {remedy}")
    return values
