"""The exponents of the closures as iterated maps, and the largest exponent over a field of the scene, with its sign.

In `corrected`, `saltation` and `branching` the moments depend on the orbit but not the orbit on the moments.  Such a
skew product has a block-triangular Jacobian, so its exponents are those of the orbit together with those of the moments
along the orbit.  Only `published` feeds the shifts of its means back into the next impact.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import ndtri

from rattle.closure import closures_for, mean_map
from rattle.closure.long_orbit import LongOrbit
from rattle.compare.chaos.exponents import CONFIDENCE, DRIFT, ORBIT, Exponents, drift_exponents, lyapunov
from rattle.compare.chaos.record import in_threads
from rattle.compare.report.texts import read_texts
from rattle.scene.errors import InputError, choice, count, finite
from rattle.scene.parts import Start
from rattle.scene.scene import SWEPT, Scene
from rattle.scene.types import Ints

ALPHAS = "0.05:2.5:100"
PUBLISHED = 30  # impacts through which the published map is followed at each value
FOLLOWED = 400  # impacts through which moments are followed
SPREAD = 2000  # impacts of the orbit from which the sd of its own y1 is taken
TOO_WIDE = 1.0  # a closure's sd of y1 above this fraction of the orbit's own no longer localises the state
COLUMNS = ("largest", "low", "high", "rate", "sum_error", "impacts", "regime", "reason")
MAPS: dict[str, dict[str, str]] = read_texts("chaos")["maps"]
"""Of each closure the map that it iterates, the exponents of its means, and how its second moments grow along it."""


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


def paper_noise(scene: Scene) -> Scene:
    """Return the scene with the paper's noise intensity, ``sigma = sqrt(alpha)``."""
    return scene.with_sigma(math.sqrt(scene.alpha))


def vary(
    scene: Scene, field: str, at: Iterable[float], noise: Callable[[Scene], Scene] = lambda scene: scene
) -> dict[float, Scene]:
    """The same scene at each value of a field; a default start is adapted to new gaps.

    `noise`: Maps each scene to the same with its noise set, such as `paper_noise`.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> [s.alpha for s in vary(Scene.from_gears(DAT21), "alpha", (0.5, 1.0)).values()]
    [0.5, 1.0]
    """
    choice("field", field, SWEPT)
    usual = scene.start == Start(0.0, scene.gap1, 2.0, scene.gap2, 2.0, mesh=1)
    fresh: dict[str, Any] = {"start": None} if usual else {}
    return {value: noise(replace(scene, **(fresh | {field: value}))) for value in at}


def mean_maps(scene: Scene, orbit: Exponents) -> pd.DataFrame:
    """Iterate each closure as a map, and report its exponents and where it breaks down.

    Returns: Columns: ``closure, map, exponents`` (which exponents its means have), ``largest, low, high``
    (largest exponent and its 95 % interval), ``moments, not_realizable`` (first impact whose moments are not
    realizable), ``leaves_gap`` (first impact whose mean lies beyond a wall), ``too_wide`` (first impact whose sd
    of y1 exceeds the sd of y1 along the orbit), ``ends`` (impacts that could be evaluated) and ``followed``
    (impacts requested). Impacts are NaN if there is none.
    """
    along = LongOrbit(scene).stretch(SPREAD, tangent=False).before[:, 1]
    spread = float(along.std()) if along.size else np.inf
    walls = np.array(scene.windows)[: scene.stages] * (1.0 + 1e-9)
    rows = []
    for closure in closures_for(scene):
        own = closure == "published"  # its means have dynamics of their own, different from the orbit's
        value, low, high = (np.nan,) * 3 if own else orbit.largest
        said = MAPS[closure]
        row: dict[str, Any] = {"closure": closure, "map": said["map"], "exponents": said["exponents"]}
        row |= {"largest": value, "low": low, "high": high, "moments": said["moments"]}
        if closure == "branching":  # its cost grows with every impact, and its components follow different orbits
            rows.append(row | {"followed": 0})
            continue
        m = mean_map(scene, impacts=FOLLOWED, closure=closure, order=4)
        t, ends = m.trace, m.trace.found
        beyond = (np.abs(t.mean[1 : ends + 1, : 2 * scene.stages : 2]) > walls).any(axis=1)
        wide = t.sd[1 : ends + 1, 3] > TOO_WIDE * spread
        row |= {
            "not_realizable": m.breakdown.impact if m.breakdown else np.nan,
            "leaves_gap": beyond.argmax() + 1 if beyond.any() else np.nan,
            "too_wide": wide.argmax() + 1 if wide.any() and not own else np.nan,
        }
        rows.append(row | {"ends": ends, "followed": FOLLOWED})
    return pd.DataFrame(rows)


def _row(of: str, e: Exponents) -> dict[str, object]:
    numbers = (*e.largest, e.rate, e.sum_error, e.impacts, e.regime.kind, e.regime.reason)
    return {"of": of} | dict(zip(COLUMNS, numbers, strict=True))


def _exponents_at(scene: Scene, width: float, seed: int) -> list[dict[str, object]]:
    orbit = lyapunov(scene, width=width)
    drift = drift_exponents(scene, width=width, seed=seed)
    rows = [_row(ORBIT, orbit), _row("mean map (corrected, saltation)", orbit), _row(DRIFT, drift)]
    if scene.sigma > 0.0 and "published" in closures_for(scene):
        m = mean_map(scene, impacts=PUBLISHED, closure="published")
        how = f"not realizable from impact {m.breakdown.impact}" if m.breakdown else "realizable throughout"
        reason = f"{how}; {m.stopped or f'followed through {PUBLISHED} impacts'}"
        rows.append({"of": "mean map (published)", "impacts": m.trace.found, "regime": "breaks down", "reason": reason})
    return rows


def sweep(
    scenes: Mapping[float, Scene], field: str = "alpha", *, width: float = 0.01, seed: int = 0, workers: int = 2
) -> pd.DataFrame:
    """Compute the largest exponent over a field: of the orbit, the mean maps, and the drift along a noisy path.

    `scenes`: As of `vary`. `width`: Required width of the interval of each largest exponent; wider ones are reported as
    they are. Returns: Columns: the field, ``of`` (the linearised system), ``largest, low, high`` (largest
    exponent and its 95 % interval; NaN where there is no record), ``rate, sum_error, impacts`` as of `Exponents`,
    and ``regime, reason`` as of `Regime`.
    """
    found = in_threads(workers, lambda scene: _exponents_at(scene, width, seed), scenes.values())
    return pd.DataFrame([{field: value, **row} for value, rows in zip(scenes, found, strict=True) for row in rows])


def signs(rows: pd.DataFrame) -> Ints:
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
    changes = [(a, b) for a, b in pairwise(np.flatnonzero(sign)) if sign[a] != sign[b]]
    found = [(of, x[a], x[b], int(sign[b]), int(b - a - 1)) for a, b in changes]
    return pd.DataFrame(found, columns=["of", "low", "high", "to", "undecided"])


def say_crossings(table: pd.DataFrame, field: str, of: str) -> str:
    """Where the largest exponent changes its sign, in words."""
    changes = crossings(table, field, of).to_dict("records")
    where = [f"{'+' if c['to'] > 0 else '-'} between {c['low']:.3g} and {c['high']:.3g}" for c in changes]
    return "; ".join(where) or "none"
