"""Sweeps of the largest exponent over a field of the scene, of the orbit and along noisy paths; changes of its sign."""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtri

from rattle.closure import mean_map
from rattle.compare.chaos.exponents import CONFIDENCE, DRIFT, ORBIT, Exponents, drift_exponents, lyapunov
from rattle.scene.errors import InputError
from rattle.scene.parts import Start
from rattle.scene.scene import Scene
from rattle.scene.validate import choice, count, finite

ALPHAS = "0.05:2.5:100"
FIELDS = ("alpha", "epsilon", "beta1", "beta2", "gamma1", "gamma2", "mu", "gap1", "gap2", "sigma")
T = TypeVar("T")
PUBLISHED = 30  # impacts through which the published map is followed at each value


def values(name: str, text: str) -> tuple[float, ...]:
    """Read evenly spaced values from ``LOW:HIGH:POINTS``."""
    words = text.split(":")
    try:
        low, high, points = float(words[0]), float(words[1]), int(words[2])
    except (ValueError, IndexError):
        raise InputError(name, text, f"give LOW:HIGH:POINTS, as in {ALPHAS}") from None
    if len(words) > 3 or not finite(f"{name} LOW", low) < finite(f"{name} HIGH", high):
        raise InputError(name, text, f"give LOW:HIGH:POINTS with LOW below HIGH, as in {ALPHAS}")
    count(f"{name} POINTS", points, least=2)
    return tuple(float(v) for v in np.linspace(low, high, points))


def with_field(scene: Scene, name: str, value: float) -> Scene:
    """Return the same scene with another value of a field; a default start is adapted to new gaps."""
    choice("field", name, FIELDS)
    usual = scene.start == Start(0.0, scene.gap1, 2.0, scene.gap2, 2.0, mesh=1)
    changes: dict[str, Any] = {name: value} | ({"start": None} if usual else {})
    return replace(scene, **changes)


def paper_noise(scene: Scene) -> Scene:
    """Return the scene with the paper's noise intensity, ``sigma = sqrt(alpha)``."""
    return scene.with_sigma(math.sqrt(scene.alpha))


def over_field(
    scene: Scene,
    at: Sequence[float],
    field: str,
    noise: Callable[[Scene], Scene] | None,
    workers: int,
    found_at: Callable[[Scene], T],
) -> list[T]:
    """Evaluate something of a scene at each value of a field.

    `noise`: Maps each scene to the same with its noise set; without it, the noise of `scene` is used.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> over_field(Scene.from_gears(DAT21), (0.5, 1.0), "alpha", None, 1, lambda s: s.alpha)
    [0.5, 1.0]
    """
    changed = [with_field(scene, field, value) for value in at]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(found_at, map(noise, changed) if noise else changed))


def _row(of: str, e: Exponents) -> dict[str, object]:
    value, low, high = e.largest
    found = {"of": of, "largest": value, "low": low, "high": high, "rate": e.rate, "sum_error": e.sum_error}
    return found | {"impacts": e.impacts, "regime": e.regime.kind, "reason": e.regime.reason}


def _exponents_at(scene: Scene, width: float, seed: int) -> list[dict[str, object]]:
    orbit = lyapunov(scene, width=width)
    drift = drift_exponents(scene, width=width, seed=seed)
    rows = [_row(ORBIT, orbit), _row("mean map (corrected, saltation)", orbit), _row(DRIFT, drift)]
    if scene.start.mesh == 1 and scene.sigma > 0.0:
        m = mean_map(scene, impacts=PUBLISHED, closure="published")
        how = f"not realizable from impact {m.breakdown.impact}" if m.breakdown else "realizable throughout"
        reason = f"{how}; {m.stopped or f'followed through {PUBLISHED} impacts'}"
        empty = dict.fromkeys(("largest", "low", "high", "rate", "sum_error"), np.nan)
        row = {"of": "mean map (published)", **empty, "impacts": m.trace.found}
        rows.append(row | {"regime": "breaks down", "reason": reason})
    return rows


def sweep(
    scene: Scene,
    at: Sequence[float],
    *,
    field: str = "alpha",
    noise: Callable[[Scene], Scene] | None = None,
    width: float = 0.01,
    seed: int = 0,
    workers: int = 2,
) -> pd.DataFrame:
    """Compute the largest exponent over a field: of the orbit, the mean maps, and the drift along a noisy path.

    `noise`: Maps each scene to the same with its noise set, such as `paper_noise`; without it, the noise of
    `scene` is used. `width`: Required width of the interval of each largest exponent; wider ones are reported as
    they are. Returns: Columns: the field, ``of`` (the linearised system), ``largest, low, high`` (largest
    exponent and its 95 % interval; NaN where there is no record), ``rate, sum_error, impacts`` as of `Exponents`,
    and ``regime, reason`` as of `Regime`.
    """
    found = over_field(scene, at, field, noise, workers, lambda s: _exponents_at(s, width, seed))
    return pd.DataFrame([{field: value, **row} for value, rows in zip(at, found, strict=True) for row in rows])


def signs(rows: pd.DataFrame) -> NDArray[np.int64]:
    """Determine the sign of the largest exponent in each row, at 95 % simultaneous coverage (Bonferroni).

    Returns: 1 or -1; 0 if the widened interval contains zero, or there is none. Shapes: result (rows,).

    Examples
    --------
    >>> signs(pd.DataFrame({"low": [0.5, -1.0, np.nan], "high": [1.5, 1.0, np.nan]})).tolist()
    [1, 0, 0]
    """
    wider = float(ndtri(0.5 * (1.0 - CONFIDENCE) / len(rows)) / ndtri(0.5 * (1.0 - CONFIDENCE)))
    middle, half = 0.5 * (rows["high"] + rows["low"]), 0.5 * wider * (rows["high"] - rows["low"])
    return np.where(middle - half > 0.0, 1, np.where(middle + half < 0.0, -1, 0))


def crossings(table: pd.DataFrame, field: str = "alpha", of: str = ORBIT) -> pd.DataFrame:
    """Find where the largest exponent changes its sign along a sweep.

    A change is bracketed by the last value of the field with one sign and the first with the other (see `signs`).
    Values between whose sign is undecided, or at which the orbit has no exponents, make the bracket wider.

    Returns: Columns: ``of, low, high`` (bracket of the field's value), ``to`` (+1: becomes positive, -1:
    negative) and ``undecided`` (number of values inside the bracket).

    Examples
    --------
    >>> t = pd.DataFrame({"alpha": [1.0, 2.0, 3.0], "of": "orbit", "low": [-2.0, -1, 1], "high": [-1.0, 1, 2]})
    >>> crossings(t).to_dict("records")
    [{'of': 'orbit', 'low': 1.0, 'high': 3.0, 'to': 1, 'undecided': 1}]
    """
    rows = table[table["of"] == of].sort_values(field)
    sign = signs(rows)
    x = rows[field].to_numpy()
    known = np.flatnonzero(sign)
    found = [
        {"of": of, "low": x[a], "high": x[b], "to": int(sign[b]), "undecided": int(b - a - 1)}
        for a, b in pairwise(known)
        if sign[a] != sign[b]
    ]
    return pd.DataFrame(found, columns=["of", "low", "high", "to", "undecided"])
