"""Measures the chaos of a scene in one call: everything that the page and the folder of ``rattle chaos`` show."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import pandas as pd

from rattle.compare.chaos.bifurcation import Bifurcation, bifurcation
from rattle.compare.chaos.exponents import Exponents, drift_exponents, lyapunov
from rattle.compare.chaos.mean_maps import mean_maps
from rattle.compare.chaos.record import NoRecord
from rattle.compare.chaos.section import Section, sections
from rattle.compare.chaos.spectrum import Spectrum, spectra
from rattle.compare.chaos.sweep import sweep
from rattle.compare.chaos.two_paths import SqrtLaw, finite_size, sqrt_law
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene

CLAIMED = (0.2, 1.7)
"""Range of alpha that the paper claims to be chaotic (section 4)."""
T = TypeVar("T")

WIDTH = 0.01  # default width of the interval of a largest exponent


@dataclass(frozen=True)
class ChaosStudy:
    """Measurements of a scene's chaos."""

    scene: Scene
    orbit: Exponents  # orbit, drift: of the orbit, and of the drift's linearisation along a noisy path
    drift: Exponents
    maps: pd.DataFrame  # as of `rattle.compare.chaos.mean_maps.mean_maps`
    sections: dict[str, Section]  # as of `rattle.compare.chaos.section.sections`
    spectra: dict[tuple[str, str, str], Spectrum]  # as of `rattle.compare.chaos.spectrum.spectra`
    law: SqrtLaw | None  # the measured square-root law
    finite_size: pd.DataFrame | None  # as of `rattle.compare.chaos.finite_size.finite_size`
    field: str  # field of the sweep
    sweep: pd.DataFrame | None  # as of `rattle.compare.chaos.sweep.sweep`
    view: Bifurcation | None  # over the same values
    missing: dict[str, str]  # what was left out, with the reason


def study(
    scene: Scene,
    *,
    at: Sequence[float] = (),
    field: str = "alpha",
    noise: Callable[[Scene], Scene] | None = None,
    points: int = 1_000_000,
    impacts: int = 200_000,
    events: int = 4000,
    width: float = WIDTH,
    seed: int = 0,
    workers: int = 2,
    progress: Callable[[str], None] = lambda part: None,
) -> ChaosStudy:
    """Measure the chaos of a scene: exponents, sections, spectra, divergence of two paths, and a sweep over a field.

    What its motion does not have, for instance because a mesh sticks in every period, is left out with the reason.

    `noise`: Maps each scene of the sweep to the same with its noise set; without it, the noise of `scene` is
    used. `width`: Required width of the interval of each largest exponent; wider ones are reported as they are.
    """
    missing: dict[str, str] = {}

    def attempt(what: str, measure: Callable[[], T]) -> T | None:
        try:
            return measure()
        except (InputError, NoRecord) as reason:
            missing[what] = str(reason)
            return None

    def finite_sizes() -> pd.DataFrame:
        if not drift.regime.has_record:  # two paths that stick are one from then on
            raise NoRecord(f"the noisy path {drift.regime.brief}")
        return finite_size(scene, events=events, seed=seed, workers=workers)

    common: dict[str, Any] = {"field": field, "noise": noise, "seed": seed, "workers": workers}
    progress("exponents")
    orbit = lyapunov(scene, width=width)
    drift = drift_exponents(scene, width=width, seed=seed)
    maps = mean_maps(scene, orbit)
    progress("Poincaré sections")
    drawn = sections(scene, points=points, seed=seed, workers=workers, missing=missing)
    progress("spectra")
    power = spectra(scene, impacts=impacts, seed=seed, workers=workers, missing=missing)
    progress("two paths on the same noise")
    law = attempt("the square-root law", lambda: sqrt_law(scene, impacts=events, seed=seed))
    sizes = attempt("the finite-size exponents", finite_sizes)
    swept, view = None, None
    if at:
        progress(f"exponents at {len(at)} values of {field}")
        swept = sweep(scene, at, width=width, **common)
        progress(f"bifurcation diagram at {len(at)} values of {field}")
        view = attempt("the bifurcation diagram", lambda: bifurcation(scene, at, **common))
    return ChaosStudy(scene, orbit, drift, maps, drawn, power, law, sizes, field, swept, view, missing)
