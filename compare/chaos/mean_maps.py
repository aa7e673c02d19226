"""The closures as iterated maps: how long each can be iterated, and which exponents it has.

In `corrected`, `saltation` and `branching` the moments depend on the orbit but not the orbit on the moments.  Such a
skew product has a block-triangular Jacobian, so its exponents are those of the orbit together with those of the moments
along the orbit.  Only `published` feeds the shifts of its means back into the next impact.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd

from rattle.closure import closures_for, mean_map
from rattle.closure.long_orbit import LongOrbit
from rattle.compare.chaos.exponents import Exponents, lyapunov
from rattle.scene.scene import Scene

FOLLOWED = 400  # impacts through which moments are followed
SPREAD = 2000  # impacts of the orbit from which the sd of its own y1 is taken
COLUMNS: tuple[str, ...] = ("closure", "map", "exponents", "largest", "low", "high", "moments")
COLUMNS += ("not_realizable", "leaves_gap", "too_wide", "ends", "followed")
TOO_WIDE = 1.0  # a closure's sd of y1 above this fraction of the orbit's own no longer localises the state


class MapOf(NamedTuple):
    """The map that a closure iterates."""

    map: str  # description of the map
    own: bool  # whether its means have dynamics of their own, different from the orbit's
    moments: str  # growth of its second moments along the orbit, in terms of exponents


MAPS = {
    "published": MapOf("Eq. 22: means and shifts to means, with its own next impact", True, "not realizable"),
    "corrected": MapOf(
        "the orbit, its means shifted by the windows of Eqs. 20 and 21",
        False,
        "0: a restitution map at a fixed time leaves displacements unchanged, so their variance grows by noise alone",
    ),
    "saltation": MapOf(
        "the orbit, its means shifted to second order in sigma", False, "twice the orbit's: as exp(2 lambda_1 t)"
    ),
    "branching": MapOf(
        "a mixture of Gaussian components, each on the orbit of its own mean",
        False,
        "twice those of each component's orbit, limited by splitting; on densities the map is linear: no chaos",
    ),
}


def mean_maps(scene: Scene, orbit: Exponents | None = None) -> pd.DataFrame:
    """Iterate each closure as a map, and report its exponents and where it breaks down.

    Returns: Columns: ``closure, map, exponents`` (which exponents its means have), ``largest, low, high``
    (largest exponent and its 95 % interval), ``moments, not_realizable`` (first impact whose moments are not
    realizable), ``leaves_gap`` (first impact whose mean lies beyond a wall), ``too_wide`` (first impact whose sd
    of y1 exceeds the sd of y1 along the orbit), ``ends`` (impacts that could be evaluated) and ``followed``
    (impacts requested). Impacts are NaN if there is none.
    """
    found = orbit or lyapunov(scene)
    along = LongOrbit(scene).stretch(SPREAD, tangent=False).before[:, 1]
    spread = float(along.std()) if along.size else np.inf
    value, low, high = found.largest
    rows = []
    for closure in closures_for(scene):
        kind = MAPS[closure]
        row: dict[str, object] = dict.fromkeys(COLUMNS, np.nan)
        row |= {"closure": closure, "map": kind.map, "moments": kind.moments}
        if kind.own:
            row["exponents"] = "none: the map ends before they could converge"
        else:
            row |= {"exponents": "the orbit's", "largest": value, "low": low, "high": high}
        if closure == "branching":  # its cost grows with every impact, and its components follow different orbits
            rows.append(row | {"exponents": "each component has the orbit's", "followed": 0})
            continue
        m = mean_map(scene, impacts=FOLLOWED, closure=closure, order=4)
        t, ends = m.trace, m.trace.found
        walls = np.array(scene.windows)[: scene.stages] * (1.0 + 1e-9)
        beyond = (np.abs(t.mean[1 : ends + 1, : 2 * scene.stages : 2]) > walls).any(axis=1)
        wide = t.sd[1 : ends + 1, 3] > TOO_WIDE * spread
        row |= {
            "not_realizable": m.breakdown.impact if m.breakdown else np.nan,
            "leaves_gap": int(beyond.argmax()) + 1 if beyond.any() else np.nan,
            "too_wide": int(wide.argmax()) + 1 if wide.any() and not kind.own else np.nan,
            "ends": ends,
            "followed": FOLLOWED,
        }
        rows.append(row)
    return pd.DataFrame(rows)
