"""The largest exponent over a field of the scene, of the orbit and along noisy paths, and where it changes its sign."""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from rattle.closure import mean_map
from rattle.compare.chaos.exponents import CONFIDENCE, ORBIT, Exponents, drift_exponents, lyapunov
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene, Start
from rattle.scene.validate import choice, count, finite

__all__ = ["ALPHAS", "FIELDS", "crossings", "paper_noise", "signs", "sweep", "values", "with_field"]

ALPHAS = "0.05:2.5:100"
FIELDS = ("alpha", "epsilon", "beta1", "beta2", "gamma1", "gamma2", "mu", "gap1", "gap2", "sigma")
PUBLISHED = 30  # impacts through which the published map is followed at each value


def values(name: str, text: str) -> tuple[float, ...]:
    """Values from ``LOW:HIGH:POINTS``, evenly spaced.

    Raises
    ------
    InputError

    Examples
    --------
    >>> values("alpha", "0.5:1.5:3")
    (0.5, 1.0, 1.5)
    """
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
    """The same scene with another value of a field; the paper's start goes with its gaps.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> with_field(Scene.from_gears(DAT21), "gap1", 0.4).start.x1
    0.4
    """
    choice("field", name, FIELDS)
    usual = scene.start == Start(0.0, scene.gap1, 2.0, scene.gap2, 2.0, mesh=1)
    kept = {f.name: getattr(scene, f.name) for f in fields(scene) if f.init}
    kept |= {name: value} | ({"start": None} if usual else {})
    return Scene(**kept)


def paper_noise(scene: Scene) -> Scene:
    """The scene with the paper's noise, ``sigma = sqrt(alpha)``."""
    return scene.with_sigma(math.sqrt(scene.alpha))


class _Job(NamedTuple):
    value: float
    scene: Scene
    width: float
    seed: int


def _row(name: str, job: _Job, e: Exponents) -> dict[str, object]:
    value, low, high = e.largest
    return {
        name: job.value, "of": e.of, "largest": value, "low": low, "high": high, "rate": e.rate,
        "sum_error": e.sum_error, "impacts": e.impacts, "regime": e.regime.kind, "reason": e.regime.reason,
    }  # fmt: skip


def _at(name: str, job: _Job) -> list[dict[str, object]]:
    orbit = lyapunov(job.scene, width=job.width, strict=False)
    rows = [_row(name, job, orbit), _row(name, job, orbit) | {"of": "mean map (corrected, saltation)"}]
    rows.append(_row(name, job, drift_exponents(job.scene, width=job.width, strict=False, seed=job.seed)))
    if job.scene.start.mesh == 1 and job.scene.sigma > 0.0:
        m = mean_map(job.scene, impacts=PUBLISHED, closure="published")
        how = f"not realizable from impact {m.breakdown.impact}" if m.breakdown else "realizable throughout"
        empty = dict.fromkeys(("largest", "low", "high", "rate", "sum_error"), np.nan)
        rows.append({
            name: job.value, "of": "mean map (published)", **empty, "impacts": m.trace.found, "regime": "breaks down",
            "reason": f"{how}; {m.stopped or f'followed through {PUBLISHED} impacts'}",
        })  # fmt: skip
    return rows


def sweep(
    scene: Scene, at: Sequence[float], *, field: str = "alpha", noise: Callable[[Scene], Scene] | None = None,
    width: float = 0.01, seed: int = 0, workers: int = 2,
) -> pd.DataFrame:  # fmt: skip
    """Largest exponent of the orbit, of the mean maps and of the drift's linearisation along a noisy path over a field.

    Parameters
    ----------
    scene : Scene
    at : sequence of float
        Values of the field.
    field : str
        One of `FIELDS`.
    noise : callable, optional
        Gives each scene its noise; the scene's own by default, `paper_noise` is the paper's.
    width : float
        Widest interval of each largest exponent.
    seed : int
        All values have the same noise, so that what changes along the field is not the sample.
    workers : int
        Threads; the result does not depend on it.

    Returns
    -------
    DataFrame
        Columns: the field, ``of, largest, low, high, rate, sum_error, impacts, regime, reason``.  Where an orbit rests,
        its exponents are NaN and ``regime`` and ``reason`` say so.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> t = sweep(Scene.from_gears(DAT21), (0.05, 0.3), noise=paper_noise, width=0.1)
    >>> t[t["of"] == "orbit"]["regime"].tolist()
    ['rests', 'runs']
    """
    count("workers", workers)
    jobs = []
    for value in at:
        changed = with_field(scene, field, value)
        jobs.append(_Job(value, noise(changed) if noise else changed, width, seed))
    with ThreadPoolExecutor(workers) as pool:
        found = list(pool.map(lambda job: _at(field, job), jobs))
    return pd.DataFrame([row for rows in found for row in rows])


def signs(rows: pd.DataFrame) -> NDArray[np.int64]:
    """Sign of the largest exponent at each value: 0 where its interval, corrected for their number, holds zero.

    Examples
    --------
    >>> signs(pd.DataFrame({"low": [0.5, -1.0, np.nan], "high": [1.5, 1.0, np.nan]})).tolist()
    [1, 0, 0]
    """
    wider = float(stats.norm.isf(0.5 * (1.0 - CONFIDENCE) / len(rows)) / stats.norm.isf(0.5 * (1.0 - CONFIDENCE)))
    middle, half = 0.5 * (rows["high"] + rows["low"]), 0.5 * wider * (rows["high"] - rows["low"])
    return np.where(middle - half > 0.0, 1, np.where(middle + half < 0.0, -1, 0))


def crossings(table: pd.DataFrame, field: str = "alpha", of: str = ORBIT) -> pd.DataFrame:
    """Where the largest exponent changes its sign along a sweep.

    A change lies between the last value at which the interval is on one side of zero and the first at which it is on
    the other, all intervals together at 95 %; values that cannot say, or at which the orbit rests, widen it.

    Returns
    -------
    DataFrame
        Columns: ``of, low, high`` (of the field), ``to`` (+1: becomes positive, -1: negative) and ``undecided`` (values
        between that cannot say).

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
