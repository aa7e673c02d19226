"""Measures the chaos of a scene in one call: everything that the page and the folder of ``rattle
chaos`` show.

The moments of `corrected`, `saltation` and `branching` depend on the orbit, but not the orbit on
the moments: the exponents of such a skew product are those of the orbit together with those of the
moments along it.  Only `published` feeds the shifts of its means back into the next impact.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from rattle.closure import closures_for, mean_map
from rattle.compare.chaos.effort import Effort, Sizes
from rattle.compare.chaos.exponents import (
    Exponents,
    SqrtLaw,
    drift_exponents,
    finite_size,
    lyapunov,
    sqrt_law,
)
from rattle.compare.chaos.record import leave_out
from rattle.compare.chaos.section import Section, sections
from rattle.compare.chaos.spectrum import Spectra, spectra
from rattle.compare.chaos.sweep import Bifurcation, FieldSweep
from rattle.compare.report.json_text import Facts
from rattle.compare.report.texts import read_texts
from rattle.montecarlo.kernel.blocks import Budget
from rattle.scene import Scene
from rattle.scene.long_orbit import LongOrbit

CLAIMED = (0.2, 1.7)
"""Range of alpha that the paper claims to be chaotic (section 4)."""
IMPACTS_FOLLOWED = 400  # impacts through which moments are followed
IMPACTS_OF_SPREAD = 2000  # impacts of the orbit from which the sd of its own y1 is taken
# a closure's sd of y1 above this fraction of the orbit's own no longer localises the state
TOO_WIDE = 1.0
MAPS: dict[str, dict[str, str]] = read_texts("chaos")["maps"]
"""Of each closure the map that it iterates, the exponents of its means, and how its second moments
grow along it."""
MAP_COLUMNS = [
    *("closure", "map", "exponents", "largest", "low", "high", "moments"),
    *("not_realizable", "leaves_gap", "too_wide", "ends", "followed"),
]


def mean_maps(scene: Scene, orbit: Exponents) -> pd.DataFrame:
    """Iterate each closure as a map, and report its exponents and where it breaks down.

    Returns: Columns: ``closure, map, exponents`` (which exponents its means have), ``largest, low,
    high`` (largest exponent and its 95 % interval), ``moments, not_realizable`` (first impact whose
    moments are not realizable), ``leaves_gap`` (first impact whose mean lies beyond a wall),
    ``too_wide`` (first impact whose sd of y1 exceeds the sd of y1 along the orbit), ``ends``
    (impacts that could be evaluated) and ``followed`` (impacts requested). Impacts are NaN if there
    is none.
    """
    along = LongOrbit(scene).stretch(IMPACTS_OF_SPREAD, tangent=False).before[:, 1]
    spread = along.std() if along.size else np.inf
    walls = np.array(scene.windows) * (1.0 + 1e-9)
    rows = []
    for closure in closures_for(scene):
        row: Facts = {"closure": closure, **MAPS[closure], "followed": 0}
        # the means of `published` have dynamics of their own, different from the orbit's
        if closure != "published":
            row |= zip(("largest", "low", "high"), orbit.largest, strict=True)
        # the cost of `branching` grows with every impact, and its components follow different
        # orbits
        if closure != "branching":
            m = mean_map(scene, impacts=IMPACTS_FOLLOWED, closure=closure, order=4)
            followed = slice(1, m.trace.found + 1)
            beyond = np.abs(m.trace.mean[followed, ::2]) > walls
            row["not_realizable"] = m.breakdown.impact if m.breakdown else np.nan
            row["leaves_gap"] = _first_impact(beyond.any(axis=1))
            if closure != "published":
                row["too_wide"] = _first_impact(m.trace.sd[followed, 3] > TOO_WIDE * spread)
            row["ends"] = m.trace.found
            row["followed"] = IMPACTS_FOLLOWED
        rows.append(row)
    return pd.DataFrame(rows, columns=MAP_COLUMNS)


def _first_impact(where: ArrayLike) -> float:
    """Number of the first impact at which something holds; NaN if there is none."""
    return int(np.argmax(where)) + 1 if np.any(where) else np.nan


@dataclass(frozen=True, repr=False)
class ChaosStudy:
    """Measurements of a scene's chaos."""

    scene: Scene
    # orbit, drift: of the orbit, and of the drift's linearisation along a noisy path
    orbit: Exponents
    drift: Exponents
    maps: pd.DataFrame  # as of `mean_maps`
    sections: dict[str, Section]  # as of `rattle.compare.chaos.section.sections`
    spectra: Spectra  # as of `rattle.compare.chaos.spectrum.spectra`
    law: SqrtLaw | None  # the measured square-root law
    finite_size: pd.DataFrame | None  # as of `rattle.compare.chaos.exponents.finite_size`
    field: str  # field of the sweep
    sweep: pd.DataFrame | None  # as of `sweep`
    view: Bifurcation | None  # over the same values
    missing: dict[str, str]  # what was left out, with the reason
    reduced: str = ""  # what the budget has made smaller than asked for, as a sentence


def study(
    scene: Scene,
    scenes: Mapping[float, Scene],
    field: str,
    effort: Effort,
    progress: Callable[[str], object],
    folder: Path | None = None,
) -> ChaosStudy:
    """Measure the chaos of a scene: exponents, sections, spectra, divergence of two paths, and a
    sweep over a field.

    What its motion does not have, for instance because a mesh sticks in every period, is left out
    with the reason.  What its budget does not allow is made smaller, by counted work.

    `scenes`: Those of the sweep by value of the field, as of `rattle.compare.chaos.sweep.vary`.
    `folder`: Where results of the sweep are stored: the same study continues there after an
    interruption.
    """
    width = effort.width
    seed = effort.seed
    workers = effort.workers
    limit = None if math.isinf(effort.budget) else Budget(effort.budget)
    sizes = Sizes(effort, bool(scenes))
    missing: dict[str, str] = {}
    law = finite = swept = view = None
    progress("exponents")
    longest = sizes.longest()
    orbit = lyapunov(scene, width=width, longest=longest)
    drift = drift_exponents(scene, width=width, longest=longest, seed=seed)
    sizes.count_exponents(scene, orbit, drift)
    maps = mean_maps(scene, orbit)
    progress("Poincaré sections")
    drawn = sections(scene, points=sizes.points(), seed=seed, workers=workers, missing=missing)
    progress("spectra")
    impacts, segments = sizes.spectra()
    power = spectra(
        scene, impacts=impacts, segments=segments, seed=seed, workers=workers, missing=missing
    )
    progress("two paths on the same noise")
    if drift.regime.has_record:
        events = sizes.events()
        with leave_out(missing, "the square-root law"):
            law = sqrt_law(scene, impacts=events, seed=seed)
        finite = finite_size(scene, events=events, seed=seed, workers=workers)
    else:  # two paths that stick are one from then on, and a rest has impacts without end
        apart = ("the square-root law", "the finite-size exponents")
        missing |= dict.fromkeys(apart, f"the noisy path {drift.regime.brief}")
    if scenes:
        chosen, longest = sizes.sweep(scenes)
        sweep = FieldSweep(chosen, field, seed, workers, folder, limit)
        progress(f"exponents at {len(chosen)} values of {field}")
        swept = sweep.exponents(width, longest)
        measured = swept[field].nunique()
        if measured < len(chosen):  # they took far longer than was counted
            sizes.reduced.append(f"{measured} of these {len(chosen)} values in that time")
        progress(f"bifurcation diagram at {len(chosen)} values of {field}")
        with leave_out(missing, "the bifurcation diagram"):
            view = sweep.bifurcation()
    reduced = sizes.describe()
    return ChaosStudy(
        scene, orbit, drift, maps, drawn, power, law, finite, field, swept, view, missing, reduced
    )
