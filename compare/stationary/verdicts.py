"""What each closure's stationary law says of a long run, with a verdict on every quantity.

A law is a mixture of normal distributions over impacts.
"""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import ndtr

from rattle.closure.stationary import Law, NotPredicted, branching_law, linear_law, orbit_average
from rattle.compare.report.texts import read_texts
from rattle.compare.validation.verdict import judge
from rattle.montecarlo.long_run.estimates import QUANTILES, all_names, groups
from rattle.montecarlo.statistics.intervals import half_width, widest
from rattle.scene import Floats, Scene
from rattle.scene.long_orbit import Attractor, attractor

CLOSURES_JUDGED = {
    "saltation": "linear at a periodic orbit",
    "published": "orbit average",
    "corrected": "orbit average",
    "branching": "mixture",
}
"""The closures, and what each takes for the stationary law."""

STATIONARY_TEXTS = read_texts("stationary")
TOLERANCES: str = STATIONARY_TEXTS["tolerances"]
"""What counts as accurate, as pages state it."""

RATES = ("rate", "energy", "power")
PREDICTED = ["closure", "kind", "quantity", "predicted", "se_predicted", "reason"]
"""Columns of `predictions`, and below of `judge_predictions`."""
VERDICT_COLUMNS = [
    "closure",
    "kind",
    "quantity",
    "predicted",
    "simulated",
    "se",
    "error",
    "low",
    "high",
    "tolerance",
    "verdict",
]
VERDICT_COLUMNS += ["periods_needed", "reason"]
HALVINGS = 80  # of an interval that holds a quantile


def laws(
    scene: Scene, closures: tuple[str, ...], a: Attractor | None = None
) -> dict[str, Law | str]:
    """The stationary law of each closure, or the reason why it has none."""
    linear = partial(linear_law, a=attractor(scene) if a is None else a)
    by: dict[str, Callable[[Scene], Law]] = {"saltation": linear, "branching": branching_law}
    found: dict[str, Law | str] = {}
    for closure in closures:
        try:
            found[closure] = by.get(closure, partial(orbit_average, closure=closure))(scene)
        except NotPredicted as why:
            found[closure] = str(why)
    return found


def tolerance_of(name: str, values: Mapping[Any, float]) -> float:
    """The largest error of a quantity that counts as accurate."""
    if name.startswith(RATES):
        return 0.05 * abs(values[name])
    if "share" in name:
        return 0.01
    if name.startswith("skew_"):
        return 0.1
    what = name.split("_", 1)[1] if name.startswith(("sd_", "q", "rms_")) else name
    return (0.10 if name.startswith(("sd_", "q")) else 0.05) * values.get(
        "sd_" + what, float("nan")
    )


def predictions(found: dict[str, Law | str], scene: Scene, slow: float) -> pd.DataFrame:
    """What each closure says of every quantity.

    Returns: Columns ``closure, kind, quantity, predicted, se_predicted, reason``; NaN and a reason
    where it says nothing.
    """
    parts = []
    for closure, law in found.items():
        values = dict.fromkeys(all_names(scene.stages), np.nan)
        se = 0.0
        reason = str(law)
        if isinstance(law, Law):
            values = values_of(law, scene, slow)
            se = law.se
            reason = ""
        part = pd.DataFrame({"quantity": list(values), "predicted": list(values.values())})
        part = part.assign(closure=closure, kind=CLOSURES_JUDGED[closure], reason=reason)
        parts.append(part.assign(se_predicted=se * part["predicted"].abs()))
    return (
        pd.concat(parts, ignore_index=True)[PREDICTED] if parts else pd.DataFrame(columns=PREDICTED)
    )


def judge_predictions(table: pd.DataFrame, periods: int, predicted: pd.DataFrame) -> pd.DataFrame:
    """Compare the predictions of closures with a simulation.

    Returns: Columns ``closure, kind, quantity, predicted, simulated, se, error, low, high,
    tolerance, verdict, periods_needed, reason``; the interval of the error holds the errors of both
    sides.
    """
    rows = predicted[predicted["quantity"].isin(table.index)].reset_index(drop=True)
    return judge_rows(rows, table, widest(int(rows["predicted"].notna().sum())), periods)[
        VERDICT_COLUMNS
    ]


def judge_rows(
    predicted: pd.DataFrame, table: pd.DataFrame, z: float, periods: int
) -> pd.DataFrame:
    """Intervals of the errors of predictions, and verdicts.

    `z`: Half width of the intervals in standard errors where these rest on all paths; wider where
    on few. Returns: With ``simulated, se, error, low, high, verdict, periods_needed``, and
    ``effective_paths`` and ``widened``: how many paths carry the error, and the half width of the
    interval in standard errors for that.
    """
    rows = predicted.copy()
    values = table["value"].to_dict()
    rows["tolerance"] = [tolerance_of(str(name), values) for name in rows["quantity"]]
    own = table.reindex(rows["quantity"]).set_index(rows.index)
    rows["simulated"] = own["value"]
    rows["se"] = own["se"]
    rows["error"] = rows["predicted"].astype(float) - rows["simulated"]
    rows["effective_paths"] = own["effective_paths"]
    rows["widened"] = _width(rows["effective_paths"], z)
    se = (rows["se"] ** 2 + rows["se_predicted"].astype(float) ** 2) ** 0.5
    rows["noise"] = rows["widened"] * se
    rows["low"], rows["high"] = rows["error"] - rows["noise"], rows["error"] + rows["noise"]
    found = judge(rows.assign(paths=float(periods))).rename(
        columns={"paths_needed": "periods_needed"}
    )
    margin = (rows["error"].abs() - rows["tolerance"]).abs()
    needed = np.ceil(periods * _times_longer(rows["effective_paths"], se, margin, z))
    return found.assign(
        periods_needed=found["periods_needed"].where(found["periods_needed"].isna(), needed)
    )


def _width(effective: pd.Series, z: float) -> Any:
    """Half width of an interval in standard errors; `z` where all paths carry the error, or nothing
    varies."""
    widened = half_width(effective, float(ndtr(-z)))
    return np.where(np.isnan(widened), z, widened)


def _times_longer(effective: pd.Series, se: pd.Series, margin: pd.Series, z: float) -> Any:
    """How many times longer a run decides its rows: its rare bursts are then as many times more, on
    more paths."""
    # log of the factor: the half width falls with it
    low = np.zeros(len(se))
    high = np.full(len(se), 40.0)
    for _ in range(50):
        middle = 0.5 * (low + high)
        wide = _width(effective * np.exp(middle), z) * se * np.exp(-0.5 * middle) > margin
        low = np.where(wide, middle, low)
        high = np.where(wide, high, middle)
    return np.exp(high)


def law_of(a: Attractor) -> Law:
    """The law of a periodic orbit itself: a point mass at each impact of its cycle."""
    n = a.impacts
    zero = np.zeros(a.impacts)
    back = np.empty(a.impacts)
    turn = 2.0 * math.pi * a.periods
    mesh = a.mesh[1:]
    tau = a.tau[1:]
    for struck in (1, 2):
        own = mesh == struck
        back[own] = (tau[own] - np.roll(tau[own], 1)) % turn if own.sum() > 1 else turn
    speed = np.abs(np.where(mesh == 1, a.before[1:, 1], a.before[1:, 3]))
    return Law(n / turn, np.full(n, 1.0 / n), mesh, speed, zero, np.diff(a.tau), zero, back, zero)


def _cdf(x: float, weight: Floats, mean: Floats, sd: Floats) -> float:
    with np.errstate(invalid="ignore", divide="ignore"):
        below = np.where(sd > 0.0, ndtr((x - mean) / sd), mean <= x)
    return float((weight * below).sum())


def _quantile(p: float, weight: Floats, mean: Floats, sd: Floats) -> float:
    """Quantile of a mixture of normal distributions and point masses, by bisection."""
    low = float((mean - 9.0 * sd).min())
    high = float((mean + 9.0 * sd).max())
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if _cdf(middle, weight, mean, sd) < p:
            low = middle
        else:
            high = middle
    return high


def _spread(weight: Floats, mean: Floats, sd: Floats) -> tuple[float, float, float]:
    """Mean, sd and skewness of a mixture; NaN where a part is not predicted."""
    centre = float((weight * mean).sum())
    off = mean - centre
    variance = float((weight * (off**2 + sd**2)).sum())
    third = float((weight * (off**3 + 3.0 * off * sd**2)).sum())
    return centre, math.sqrt(variance), third / variance**1.5 if variance > 0.0 else math.nan


def _by_speed(
    slow: float, rate: float, weight: Floats, mean: Floats, sd: Floats
) -> dict[str, float]:
    """Share of slow impacts; rate of the others, and moments and quantiles of their speed, which is
    a cut mixture."""
    share = _cdf(slow, weight, mean, sd)
    found = {"slow_share": share, "rate_above": rate * (1.0 - share)}
    if not share < 1.0:
        return found
    with np.errstate(invalid="ignore", divide="ignore"):
        z = np.where(sd > 0.0, (slow - mean) / sd, np.where(mean <= slow, np.inf, -np.inf))
    edge = np.where(sd > 0.0, z, 0.0)
    density = np.where(sd > 0.0, np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi), 0.0)
    # of a normal variable above z
    powers = [ndtr(-z), density, ndtr(-z) + edge * density, (edge**2 + 2.0) * density]
    whole = float((weight * powers[0]).sum())
    one = float((weight * (mean * powers[0] + sd * powers[1])).sum()) / whole
    off = mean - one
    two = (
        float(
            (weight * (off**2 * powers[0] + 2.0 * off * sd * powers[1] + sd**2 * powers[2])).sum()
        )
        / whole
    )
    three = (
        off**3 * powers[0]
        + 3.0 * off**2 * sd * powers[1]
        + 3.0 * off * sd**2 * powers[2]
        + sd**3 * powers[3]
    )
    third = float((weight * three).sum()) / whole
    spread = (one, math.sqrt(two), third / two**1.5 if two > 0.0 else math.nan)
    found |= dict(zip(("speed_above", "sd_speed_above", "skew_speed_above"), spread, strict=True))
    found["rms_speed_above"] = math.hypot(one, spread[1])
    cut = (_quantile(share + 0.01 * q * (1.0 - share), weight, mean, sd) for q in QUANTILES)
    return found | {f"q{q:02d}_speed_above": value for q, value in zip(QUANTILES, cut, strict=True)}


def values_of(
    law: Law, scene: Scene, slow: float, contact: tuple[float, float] = (0.0, 0.0)
) -> dict[str, float]:
    """All quantities of `rattle.montecarlo.long_run.estimates.estimates` by a stationary law."""
    out = dict.fromkeys(all_names(scene.stages), math.nan)
    lost = 0.5 * (1.0 - scene.epsilon**2) * np.where(law.mesh == 1, 1.0, scene.mu)
    lost = lost * (law.speed**2 + law.sd_speed**2)
    for g, suffix in groups(scene.stages):
        part = (law.mesh == g) | (g == 0)
        share = float(law.weight[part].sum())
        if share == 0.0:
            continue
        weight = law.weight[part] / share
        rate = law.rate * share
        flight = (law.flight, law.sd_flight) if g == 0 else (law.back, law.sd_back)
        energy = float((weight * lost[part]).sum())
        found = {"rate": rate, "energy": energy, "energy_per_period": 2.0 * math.pi * rate * energy}
        found |= {"power": rate * energy} | _by_speed(
            slow, rate, weight, law.speed[part], law.sd_speed[part]
        )
        for name, (mean, sd) in {"flight": flight, "speed": (law.speed, law.sd_speed)}.items():
            mean = mean[part]
            sd = sd[part]
            if not np.isfinite(mean).all():
                found[name] = 1.0 / rate if name == "flight" else math.nan
                continue
            found |= dict(
                zip((name, f"sd_{name}", f"skew_{name}"), _spread(weight, mean, sd), strict=True)
            )
            found |= {f"q{q:02d}_{name}": _quantile(0.01 * q, weight, mean, sd) for q in QUANTILES}
        found["rms_speed"] = math.hypot(
            found.get("speed", math.nan), found.get("sd_speed", math.nan)
        )
        out |= {name + suffix: value for name, value in found.items()}
    return out | {
        f"contact_share_mesh{mesh}": contact[mesh - 1] for mesh in range(1, scene.stages + 1)
    }
