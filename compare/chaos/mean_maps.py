"""What each closure iterates, how long it survives as a map, and whose exponents it has.

`corrected`, `saltation` and `branching` hang moments on the orbit: the orbit feeds the moments and is not fed by them.
Such a map is triangular, so its exponents are the orbit's own, and those of the moments along the orbit beside
them.  Only `published` feeds its shifts back into the next impact.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd

from rattle.closure import closures_for, mean_map
from rattle.closure.long_orbit import LongOrbit
from rattle.compare.chaos.exponents import Exponents, lyapunov
from rattle.scene.scene import Scene

__all__ = ["MAPS", "MapOf", "mean_maps"]

FOLLOWED = 400  # impacts through which moments are followed
SPREAD = 2000  # impacts of the orbit from which its spread is taken
BLIND = 1.0  # of the orbit's own spread: an sd of y1 beyond says nothing any more


class MapOf(NamedTuple):
    """What a closure iterates.

    Attributes
    ----------
    map : str
        The map that is differentiated.
    own : bool
        Whether its means have a dynamics of their own.
    moments : str
        How its second moments grow along the orbit, in exponents.
    """

    map: str
    own: bool
    moments: str


MAPS = {
    "published": MapOf("Eq. 22: means and shifts to means, with its own next impact", True, "not realizable"),
    "corrected": MapOf(
        "the orbit, its means shifted by the windows of Eqs. 20 and 21", False,
        "0: contact laws at one instant leave a displacement as it is, so its variance grows by what noise adds",
    ),
    "saltation": MapOf(
        "the orbit, its means shifted to second order in sigma", False, "twice the orbit's: as exp(2 lambda_1 t)"
    ),
    "branching": MapOf(
        "a mixture of Gaussian parts, each on the orbit of its own mean", False,
        "twice those of each part's orbit, cut by splitting; on densities the map is linear and has no chaos",
    ),
}  # fmt: skip


def mean_maps(scene: Scene, orbit: Exponents | None = None) -> pd.DataFrame:
    """How each closure fares as an iterated map.

    Parameters
    ----------
    scene : Scene
        With its noise.
    orbit : Exponents, optional
        Of the orbit, if they are known.

    Returns
    -------
    DataFrame
        Columns: ``closure, map, exponents`` (whose the exponents of its means are), ``largest, low, high``,
        ``moments, not_realizable`` (the first impact at which its moments belong to no distribution), ``leaves_gap``
        (the first impact whose mean lies beyond a wall), ``blind`` (the first impact at which its sd of y1 exceeds
        that of the orbit's own values), ``ends`` (impacts that could be evaluated) and ``followed`` (asked for).

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> maps = mean_maps(Scene.from_gears(DAT21, sigma=1.5**0.5)).set_index("closure")
    >>> int(maps["not_realizable"]["published"]), maps["exponents"]["corrected"]
    (2, "the orbit's")
    """
    found = orbit or lyapunov(scene)
    spread = float(np.std(LongOrbit(scene).stretch(SPREAD, tangent=False).before[:, 1]))
    value, low, high = found.largest
    rows = []
    for closure in closures_for(scene):
        kind = MAPS[closure]
        row: dict[str, object] = {"closure": closure, "map": kind.map, "moments": kind.moments}
        row |= {"largest": np.nan, "low": np.nan, "high": np.nan}
        row["exponents"] = "none: it ends before it has any" if kind.own else "the orbit's"
        if not kind.own:
            row |= {"largest": value, "low": low, "high": high}
        if closure == "branching":  # its cost grows with every impact, and its means mix parts on different orbits
            rows.append(row | {"exponents": "each part has the orbit's", "followed": 0})
            continue
        m = mean_map(scene, impacts=FOLLOWED, closure=closure, order=4)
        t, ends = m.trace, m.trace.found
        walls = np.array(scene.windows)[: scene.stages] * (1.0 + 1e-9)
        beyond = (np.abs(t.mean[1 : ends + 1, : 2 * scene.stages : 2]) > walls).any(axis=1)
        wide = t.sd[1 : ends + 1, 3] > BLIND * spread
        row |= {
            "not_realizable": m.breakdown.impact if m.breakdown else np.nan,
            "leaves_gap": int(beyond.argmax()) + 1 if beyond.any() else np.nan,
            "blind": int(wide.argmax()) + 1 if wide.any() and not kind.own else np.nan,
            "ends": ends, "followed": FOLLOWED,
        }  # fmt: skip
        rows.append(row)
    columns = [
        "closure", "map", "exponents", "largest", "low", "high", "moments", "not_realizable", "leaves_gap", "blind",
        "ends", "followed",
    ]  # fmt: skip
    return pd.DataFrame(rows).reindex(columns=columns)
