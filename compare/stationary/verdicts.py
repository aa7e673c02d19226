"""What each closure's stationary law says of a long run, with a verdict on every quantity.

A law is a mixture of normal distributions over impacts.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import ndtr

from rattle.closure.mean_map import closures_for
from rattle.closure.moments import check_row
from rattle.closure.stationary import Law, NotPredicted, branching_law, linear_law, orbit_average
from rattle.compare.judge.verdict import judge
from rattle.compare.report.texts import read_texts
from rattle.montecarlo.long_run.estimates import QUANTILES, all_names, groups
from rattle.montecarlo.statistics.intervals import half_width, widest
from rattle.scene import Floats, Scene, choice
from rattle.scene.impact import energy_loss
from rattle.scene.long_orbit import Attractor, attractor

CLOSURES_JUDGED = {
    "saltation": "linear at a periodic orbit",
    "published": "orbit average",
    "corrected": "orbit average",
    "branching": "mixture",
}
"""The closures, and what each takes for the stationary law."""

OF_PAPER = ("published", "corrected")  # closures of its one or two wheels in a row

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
    "periods_needed",
    "reason",
]
HALVINGS = 80  # of an interval that holds a quantile


def default_closures(scene: Scene) -> tuple[str, ...]:
    """The closures that have a stationary law and apply to a scene."""
    applicable = closures_for(scene)
    return tuple(name for name in CLOSURES_JUDGED if name in applicable)


def choose_closures(field: str, names: Iterable[Any], scene: Scene) -> tuple[str, ...]:
    """Check names of closures that have a stationary law, each taken once; those of the paper are
    refused for other wheels than its."""
    chosen = tuple(dict.fromkeys(choice(field, name, CLOSURES_JUDGED) for name in names))
    for name in OF_PAPER:
        if name in chosen:
            check_row(name, scene)
    return chosen


def laws(
    scene: Scene, closures: tuple[str, ...], a: Attractor | None = None
) -> dict[str, Law | str]:
    """The stationary law of each closure, or the reason why it has none."""
    law_by_closure: dict[str, Law | str] = {}
    for closure in closures:
        try:
            if any(wheel.restitution for wheel in scene.tree):
                raise NotPredicted("the restitution is random or depends on the impact speed")
            if closure == "saltation":
                law_by_closure[closure] = linear_law(scene, a or attractor(scene))
            elif closure == "branching":
                law_by_closure[closure] = branching_law(scene)
            else:
                law_by_closure[closure] = orbit_average(scene, closure=closure)
        except NotPredicted as why:
            law_by_closure[closure] = str(why)
    return law_by_closure


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


def predictions(law_by_closure: dict[str, Law | str], scene: Scene, slow: float) -> pd.DataFrame:
    """What each closure says of every quantity.

    Returns: Columns ``closure, kind, quantity, predicted, se_predicted, reason``; NaN and a reason
    where it says nothing.
    """
    parts = []
    for closure, law in law_by_closure.items():
        values = pd.Series(np.nan, all_names(scene.stages))
        se = 0.0
        reason = str(law)
        if isinstance(law, Law):
            values = pd.Series(values_of(law, scene, slow))
            se = law.se
            reason = ""
        columns = {
            "closure": closure,
            "kind": CLOSURES_JUDGED[closure],
            "quantity": values.index,
            "predicted": values.to_numpy(),
            "se_predicted": se * np.abs(values.to_numpy()),
            "reason": reason,
        }
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=PREDICTED)


def judge_predictions(table: pd.DataFrame, periods: int, predicted: pd.DataFrame) -> pd.DataFrame:
    """Compare the predictions of closures with a simulation.

    Returns: Columns ``closure, kind, quantity, predicted, simulated, se, error, low, high,
    tolerance, verdict, periods_needed, reason``; the interval of the error holds the errors of both
    sides.
    """
    rows = predicted[predicted["quantity"].isin(table.index)].reset_index(drop=True)
    z = widest(int(rows["predicted"].notna().sum()))
    return judge_rows(rows, table, z, periods)[VERDICT_COLUMNS]


def judge_rows(
    predicted: pd.DataFrame, table: pd.DataFrame, z: float, periods: int
) -> pd.DataFrame:
    """Intervals of the errors of predictions, and verdicts.

    `z`: Half width of the intervals in standard errors where these rest on all paths; wider where
    on few. Returns: With ``simulated, se, error, low, high, verdict, periods_needed``, and
    ``effective_paths`` and ``widened``: how many paths carry the error, and the half width of the
    interval in standard errors for that.
    """
    values = table["value"].to_dict()
    estimates = table.reindex(predicted["quantity"]).set_index(predicted.index)
    effective = estimates["effective_paths"]
    widened = _width(effective, z)
    error = predicted["predicted"].astype(float) - estimates["value"]
    se = (estimates["se"] ** 2 + predicted["se_predicted"].astype(float) ** 2) ** 0.5
    noise = widened * se
    tolerance = [tolerance_of(str(name), values) for name in predicted["quantity"]]
    judged = judge(
        predicted.assign(
            tolerance=tolerance,
            simulated=estimates["value"],
            se=estimates["se"],
            error=error,
            effective_paths=effective,
            widened=widened,
            noise=noise,
            low=error - noise,
            high=error + noise,
            paths=float(periods),
        )
    )
    margin = (error.abs() - tolerance).abs()
    needed = np.ceil(periods * _times_longer(effective, se, margin, z))
    undecidable = judged.pop("paths_needed").isna()
    return judged.assign(periods_needed=np.where(undecidable, np.nan, needed))


def _width(effective: pd.Series, z: float) -> Any:
    """Half width of an interval in standard errors; `z` where all paths carry the error, or nothing
    varies."""
    widened = half_width(effective, float(ndtr(-z)))
    return np.where(np.isnan(widened), z, widened)


def _times_longer(effective: pd.Series, se: pd.Series, margin: pd.Series, z: float) -> Any:
    """How many times longer a run decides its rows: its rare bursts are then as many times more, on
    more paths."""

    def is_wide(log: Floats) -> Any:
        """Whether the half width, which falls with the logarithm of the factor, is too large."""
        return _width(effective * np.exp(log), z) * se * np.exp(-0.5 * log) > margin

    return np.exp(_bisect(np.zeros(len(se)), np.full(len(se), 40.0), is_wide, 50))


def _bisect(low: Floats, high: Floats, is_below: Callable[[Floats], Any], halvings: int) -> Floats:
    """The ends of intervals up to which something holds, after so many halvings."""
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        below = is_below(middle)
        low = np.where(below, middle, low)
        high = np.where(below, high, middle)
    return high


def law_of(a: Attractor) -> Law:
    """The law of a periodic orbit itself: a point mass at each impact of its cycle."""
    n = a.impacts
    zero = np.zeros(n)
    back = np.empty(n)
    turn = 2.0 * math.pi * a.periods
    mesh = a.mesh[1:]
    for struck in np.unique(mesh):
        tau = a.tau[1:][mesh == struck]
        back[mesh == struck] = (tau - np.roll(tau, 1)) % turn if tau.size > 1 else turn
    speed = np.abs(a.before[1 + np.arange(n), 2 * mesh - 1])
    return Law(n / turn, np.full(n, 1.0 / n), mesh, speed, zero, np.diff(a.tau), zero, back, zero)


def _cdf(x: Floats, weight: Floats, mean: Floats, sd: Floats) -> Floats:
    """Distribution function of a mixture of normal distributions and point masses.

    Shapes: `x` and result (...,); the others (parts,).
    """
    x = x[..., None]
    with np.errstate(invalid="ignore", divide="ignore"):
        below = np.where(sd > 0.0, ndtr((x - mean) / sd), mean <= x)
    return np.asarray((weight * below).sum(axis=-1))


def _quantiles(p: Floats, weight: Floats, mean: Floats, sd: Floats) -> Floats:
    """Quantiles of a mixture of normal distributions and point masses, by bisection."""
    low = np.full(p.shape, (mean - 9.0 * sd).min())
    high = np.full(p.shape, (mean + 9.0 * sd).max())
    return _bisect(low, high, lambda x: _cdf(x, weight, mean, sd) < p, HALVINGS)


def _describe(
    name: str, weight: Floats, mean: Floats, sd: Floats, above: float = -math.inf
) -> dict[str, float]:
    """Mean, sd, skewness, root mean square and quantiles of the part of a mixture above a value, by
    name.

    Nothing where no part is above; NaN where an sd is not predicted.
    """
    share = float(_cdf(np.array(above), weight, mean, sd))
    if not (share < 1.0 and np.isfinite(mean).all()):
        return {}
    # the standardised value, above which a part counts; the density there, zero at infinity
    with np.errstate(invalid="ignore", divide="ignore"):
        z = np.where(sd > 0.0, (above - mean) / sd, np.where(mean <= above, np.inf, -np.inf))
    edge = np.where(np.isfinite(z), z, 0.0)
    density = np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    # integrals over a standard normal variable above z: of 1 and of its square and cube; that of
    # the variable itself is the density, here in units of the mixture
    zeroth = ndtr(-z)
    first = np.where(density > 0.0, sd * density, 0.0)
    second = sd**2 * (zeroth + edge * density)
    third = sd**3 * (edge**2 + 2.0) * density
    weight_above = float((weight * zeroth).sum())
    centre = float((weight * (mean * zeroth + first)).sum()) / weight_above
    off = mean - centre
    square = off**2 * zeroth + 2.0 * off * first + second
    cube = off**3 * zeroth + 3.0 * off**2 * first + 3.0 * off * second + third
    variance = float((weight * square).sum()) / weight_above
    spread = math.sqrt(variance)
    skewness = (
        float((weight * cube).sum()) / weight_above / variance**1.5 if variance > 0.0 else math.nan
    )
    p = share + 0.01 * np.array(QUANTILES) * (1.0 - share)
    quantiles = _quantiles(p, weight, mean, sd).tolist()
    return {
        name: centre,
        f"sd_{name}": spread,
        f"skew_{name}": skewness,
        f"rms_{name}": math.hypot(centre, spread),
        **{f"q{q:02d}_{name}": value for q, value in zip(QUANTILES, quantiles, strict=True)},
    }


def values_of(
    law: Law, scene: Scene, slow: float, contact: Sequence[float] = ()
) -> dict[str, float]:
    """All quantities of `rattle.montecarlo.long_run.estimates.estimates` by a stationary law."""
    out = dict.fromkeys(all_names(scene.stages), math.nan)
    meshes = range(1, scene.stages + 1)
    at_speed_1 = np.array([energy_loss(scene.constants, mesh, 1.0) for mesh in meshes])
    lost = at_speed_1[law.mesh - 1] * (law.speed**2 + law.sd_speed**2)
    shares = contact if len(contact) else np.zeros(scene.stages)
    for g, suffix in groups(scene.stages):
        part = (law.mesh == g) | (g == 0)
        share = float(law.weight[part].sum())
        if share == 0.0:
            continue
        weight = law.weight[part] / share
        speed = (weight, law.speed[part], law.sd_speed[part])
        flight, sd_flight = (law.flight, law.sd_flight) if g == 0 else (law.back, law.sd_back)
        rate = law.rate * share
        energy = float((weight * lost[part]).sum())
        slow_share = float(_cdf(np.array(slow), *speed))
        values = {
            "rate": rate,
            "rate_above": rate * (1.0 - slow_share),
            "slow_share": slow_share,
            "energy": energy,
            "energy_per_period": 2.0 * math.pi * rate * energy,
            "power": rate * energy,
            "flight": 1.0 / rate,  # where no distribution of it is predicted
        }
        values |= _describe("flight", weight, flight[part], sd_flight[part])
        values |= _describe("speed", *speed) | _describe("speed_above", *speed, above=slow)
        out |= {name + suffix: value for name, value in values.items() if name + suffix in out}
    return out | {f"contact_share_mesh{mesh}": shares[mesh - 1] for mesh in meshes}
