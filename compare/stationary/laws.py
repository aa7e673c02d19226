"""The quantities of a long run from a stationary law: a mixture of normal distributions over impacts."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from rattle.closure.attractor import Attractor
from rattle.closure.stationary import Law
from rattle.montecarlo.long_run.names import QUANTILES, all_names, groups
from rattle.scene.scene import Scene

Floats = NDArray[np.float64]

HALVINGS = 80  # of an interval that holds a quantile


def law_of(a: Attractor) -> Law:
    """The law of a periodic orbit itself: a point mass at each impact of its cycle."""
    n, zero = a.impacts, np.zeros(a.impacts)
    turn = 2.0 * math.pi * a.periods
    mesh, tau = a.mesh[1:], a.tau[1:]
    back = np.empty(n)
    for k in range(n):
        own = np.flatnonzero(mesh == mesh[k])
        place = int(np.flatnonzero(own == k)[0])
        back[k] = (tau[k] - tau[own[place - 1]]) % turn if own.size > 1 else turn
    speed = np.abs(np.where(mesh == 1, a.before[1:, 1], a.before[1:, 3]))
    return Law(n / turn, np.full(n, 1.0 / n), mesh, speed, zero, np.diff(a.tau), zero, back, zero)


def _cdf(x: float, weight: Floats, mean: Floats, sd: Floats) -> float:
    with np.errstate(invalid="ignore", divide="ignore"):
        below = np.where(sd > 0.0, ndtr((x - mean) / sd), mean <= x)
    return float((weight * below).sum())


def _quantile(p: float, weight: Floats, mean: Floats, sd: Floats) -> float:
    """Quantile of a mixture of normal distributions and point masses, by bisection."""
    low, high = float((mean - 9.0 * sd).min()), float((mean + 9.0 * sd).max())
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


def _by_speed(slow: float, rate: float, weight: Floats, mean: Floats, sd: Floats) -> dict[str, float]:
    """Share of slow impacts; rate of the others, and moments and quantiles of their speed, which is a cut mixture."""
    share = _cdf(slow, weight, mean, sd)
    found = {"slow_share": share, "rate_above": rate * (1.0 - share)}
    if not share < 1.0:
        return found
    with np.errstate(invalid="ignore", divide="ignore"):
        z = np.where(sd > 0.0, (slow - mean) / sd, np.where(mean <= slow, np.inf, -np.inf))
    edge, density = np.where(sd > 0.0, z, 0.0), np.where(sd > 0.0, np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi), 0.0)
    powers = [ndtr(-z), density, ndtr(-z) + edge * density, (edge**2 + 2.0) * density]  # of a normal variable above z
    whole = float((weight * powers[0]).sum())
    one = float((weight * (mean * powers[0] + sd * powers[1])).sum()) / whole
    off = mean - one
    two = float((weight * (off**2 * powers[0] + 2.0 * off * sd * powers[1] + sd**2 * powers[2])).sum()) / whole
    three = off**3 * powers[0] + 3.0 * off**2 * sd * powers[1] + 3.0 * off * sd**2 * powers[2] + sd**3 * powers[3]
    third = float((weight * three).sum()) / whole
    spread = (one, math.sqrt(two), third / two**1.5 if two > 0.0 else math.nan)
    found |= dict(zip(("speed_above", "sd_speed_above", "skew_speed_above"), spread, strict=True))
    cut = (_quantile(share + 0.01 * q * (1.0 - share), weight, mean, sd) for q in QUANTILES)
    return found | {f"q{q:02d}_speed_above": value for q, value in zip(QUANTILES, cut, strict=True)}


def values_of(law: Law, scene: Scene, slow: float, contact: tuple[float, float] = (0.0, 0.0)) -> dict[str, float]:
    """All quantities of `rattle.montecarlo.long_run.estimates.estimates` by a stationary law.

    Examples
    --------
    >>> one, zero = np.ones(1), np.zeros(1)
    >>> law = Law(2.0, one, np.array([1]), one, zero, 0.5 * one, zero, 0.5 * one, zero)
    >>> scene = Scene(alpha=1.0, epsilon=0.5, beta1=0.0, gamma1=0.0, stages=1)
    >>> found = values_of(law, scene, 0.1)
    >>> found["rate"], found["power"], found["slow_share"], found["q50_speed"]
    (2.0, 0.75, 0.0, 1.0)
    """
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
        found |= {"power": rate * energy} | _by_speed(slow, rate, weight, law.speed[part], law.sd_speed[part])
        for name, (mean, sd) in {"flight": flight, "speed": (law.speed, law.sd_speed)}.items():
            mean, sd = mean[part], sd[part]
            if not np.isfinite(mean).all():
                found[name] = 1.0 / rate if name == "flight" else math.nan
                continue
            found |= dict(zip((name, f"sd_{name}", f"skew_{name}"), _spread(weight, mean, sd), strict=True))
            found |= {f"q{q:02d}_{name}": _quantile(0.01 * q, weight, mean, sd) for q in QUANTILES}
        out |= {name + suffix: value for name, value in found.items()}
    for mesh in range(1, scene.stages + 1):
        out[f"contact_share_mesh{mesh}"] = contact[mesh - 1]
    return out
