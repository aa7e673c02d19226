"""One sentence of advice: which closure to take up to which noise intensity, and what a simulation costs beyond it."""

import math
from typing import NamedTuple

import pandas as pd

from rattle.compare.validation.validity_range import listed, unbroken

__all__ = ["advice", "duration"]

ASKED = "1% of an sd"
"""The accuracy for which a simulation's cost is stated; see `rattle.compare.validation.speed.WANTED`."""


class _Range(NamedTuple):
    """A closure, the largest noise intensity up to which it is accurate and worth its time, and its median speed-up."""

    closure: str
    limit: float
    speed_up: float


def duration(seconds: float) -> str:
    """A time in a suitable unit, with one digit.

    Parameters
    ----------
    seconds : float
        The time.

    Returns
    -------
    str

    Examples
    --------
    >>> duration(0.0213), duration(1.8), duration(400.0), duration(9000.0)
    ('20 ms', '2 s', '7 min', '2 h')
    """
    for factor, unit, below in ((1e-3, "ms", 0.95), (1.0, "s", 95.0), (60.0, "min", 5700.0)):
        if seconds < below:
            return f"{float(f'{seconds / factor:.1g}'):g} {unit}"
    return f"{float(f'{seconds / 3600.0:.1g}'):g} h"


def advice(
    validity: pd.DataFrame,
    impacts: int,
    *,
    simulation: pd.DataFrame | None = None,
    speed: pd.DataFrame | None = None,
    lasting: str = "",
) -> str:
    """What to take for a gear pair, in one sentence.

    A closure is recommended up to the largest noise intensity up to which it is accurate at all impacts without a gap,
    and, where its time was measured, not slower than a simulation of equal accuracy.

    Parameters
    ----------
    validity : DataFrame
        Rows of `rattle.compare.validation.validity.Validity`, one for each closure and noise intensity.
    impacts : int
        Number of impacts that were compared.
    simulation : DataFrame, optional
        Rows of `rattle.compare.validation.speed.Cost`; ``seconds`` is NaN where no time was measured.
    speed : DataFrame, optional
        Rows of `rattle.compare.validation.speed.Speed`.
    lasting : str
        How long the motion is in physical units, as "24 ms of rattling", if that is known.

    Returns
    -------
    str

    Examples
    --------
    >>> rows = [("saltation", 0.01, 12, 12), ("saltation", 0.1, 3, 3)]
    >>> table = pd.DataFrame(rows, columns=["closure", "sigma", "accurate", "not_inaccurate"])
    >>> cost = pd.DataFrame({"sigma": [0.1], "paths": [9_000], "seconds": [1.8]})
    >>> advice(table, 12, simulation=cost)
    'For this gear pair take `saltation` up to σ = 0.01; beyond it simulate: 12 impacts to 1% of an sd take about 2 s.'
    """
    sigmas = sorted(validity["sigma"].unique())
    accurate = _ranges(validity, impacts, None)
    chosen = _steps(_ranges(validity, impacts, speed))
    what = f"{impacts} impact{'s' if impacts > 1 else ''}{f' ({lasting})' if lasting else ''} to {ASKED}"
    if not chosen:
        return _none(validity, impacts, accurate, _cost(simulation, what, -math.inf))
    limit = chosen[-1].limit
    taken = f"For this gear pair take {listed([_up_to(c, sigmas) for c in chosen])}"
    if limit == sigmas[-1]:
        tried = "the only noise intensity" if len(sigmas) == 1 else "the largest noise intensity"
        return f"{taken}, {tried} compared: all {_moments(impacts)} are accurate there."
    return f"{taken}; beyond it simulate{_open(validity, impacts, limit)}: {_cost(simulation, what, limit)}."


def _ranges(validity: pd.DataFrame, impacts: int, speed: pd.DataFrame | None) -> list[_Range]:
    """The closures that may be recommended, each with its range."""
    gains = {} if speed is None else speed.set_index(["closure", "sigma"])["speed_up"].to_dict()
    found = []
    for closure, rows in validity.groupby("closure", sort=False):
        rows = rows.sort_values("sigma")
        own = [gains.get((closure, sigma), math.nan) for sigma in rows["sigma"]]
        holds = [a == impacts and not g < 1.0 for a, g in zip(rows["accurate"], own, strict=True)]
        limit = unbroken(rows["sigma"], holds)
        if limit is not None:
            within = [g for g, sigma in zip(own, rows["sigma"], strict=True) if sigma <= limit]
            found.append(_Range(str(closure), float(limit), float(pd.Series(within).median())))
    return found


def _steps(ranges: list[_Range]) -> list[_Range]:
    """The fastest closure first, then the one that is accurate furthest, if that is another."""
    if not ranges:
        return []
    ranked = sorted(ranges, key=lambda r: -r.speed_up if r.speed_up == r.speed_up else 0.0)  # stable where not measured
    furthest = max(ranked, key=lambda r: r.limit)  # the fastest of those
    return [ranked[0]] if ranked[0].limit == furthest.limit else [ranked[0], furthest]


def _up_to(one: _Range, sigmas: list[float]) -> str:
    return f"`{one.closure}` {'at' if len(sigmas) == 1 else 'up to'} σ = {one.limit:.4g}"


def _moments(impacts: int) -> str:
    return f"means and sds at {impacts} impacts" if impacts > 1 else "means and sds at the first impact"


def _cost(simulation: pd.DataFrame | None, what: str, beyond: float) -> str:
    """What a simulation takes at the noise intensities beyond one, the cheapest and the dearest of them."""
    rows = None if simulation is None else simulation[simulation["sigma"] > beyond].dropna(subset=["paths"])
    if rows is None or rows.empty:
        return f"`rattle simulate` states what {what} take"
    timed = rows["seconds"].notna().all()
    column = rows["seconds" if timed else "paths"]
    least, most = (duration(n) if timed else f"{float(f'{n:.1g}'):,.0f} paths" for n in (column.min(), column.max()))
    return f"{what} take about {most}" if least == most else f"{what} take about {least} to {most}, by the noise"


def _open(validity: pd.DataFrame, impacts: int, limit: float) -> str:
    """The closures that are undecided at the next noise intensity: the advice must not call them wrong."""
    beyond = validity[validity["sigma"] > limit]
    at_next = beyond[beyond["sigma"] == beyond["sigma"].min()]
    undecided = (at_next["not_inaccurate"] == impacts) & (at_next["accurate"] < impacts)
    names = [f"`{c}`" for c in at_next[undecided]["closure"]]
    if not names:
        return ""
    verb = "is" if len(names) == 1 else "are"
    return f" ({listed(names)} {verb} not shown wrong at {at_next['sigma'].iloc[0]:.4g}: more paths would decide)"


def _none(validity: pd.DataFrame, impacts: int, accurate: list[_Range], cost: str) -> str:
    """The advice where no closure is to be taken."""
    if accurate:
        best = max(accurate, key=lambda r: r.limit)
        return (
            f"For this gear pair simulate: {cost}; `{best.closure}` is accurate up to σ = {best.limit:.4g}, but a "
            "simulation of equal accuracy is faster."
        )
    sigmas = sorted(validity["sigma"].unique())
    smallest = validity[validity["sigma"] == sigmas[0]]
    where = f"at σ = {sigmas[0]:.4g}" + (", the smallest compared" if len(sigmas) > 1 else "")
    undecided = [f"`{c}`" for c in smallest[smallest["not_inaccurate"] == impacts]["closure"]]
    if undecided:
        return (
            f"For this gear pair no closure is shown to be right {where}, and {listed(undecided)} "
            f"{'is' if len(undecided) == 1 else 'are'} not shown wrong: take more paths to decide, or simulate: {cost}."
        )
    best_row = smallest.sort_values("accurate", ascending=False, kind="stable").iloc[0]
    part = (
        f" (`{best_row['closure']}` is for the first {best_row['accurate']})"
        if best_row["accurate"] > 1
        else f" (`{best_row['closure']}` is for the first)"
        if best_row["accurate"] == 1
        else ""
    )
    return f"For this gear pair no closure is right for {_moments(impacts)}{part} {where}: simulate; {cost}."
