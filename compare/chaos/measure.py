"""Measures the chaos of a scene in one call: everything that the page and the folder of ``rattle chaos`` show."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import pandas as pd

from rattle.compare.chaos.exponents import Exponents, SqrtLaw, drift_exponents, finite_size, lyapunov, sqrt_law
from rattle.compare.chaos.record import leave_out
from rattle.compare.chaos.section import Bifurcation, Section, bifurcation, sections
from rattle.compare.chaos.spectrum import Spectrum, spectra
from rattle.compare.chaos.sweep import mean_maps, sweep
from rattle.scene.scene import Scene

CLAIMED = (0.2, 1.7)
"""Range of alpha that the paper claims to be chaotic (section 4)."""
WIDTH = 0.01  # default width of the interval of a largest exponent


@dataclass(frozen=True)
class ChaosStudy:
    """Measurements of a scene's chaos."""

    scene: Scene
    orbit: Exponents  # orbit, drift: of the orbit, and of the drift's linearisation along a noisy path
    drift: Exponents
    maps: pd.DataFrame  # as of `rattle.compare.chaos.sweep.mean_maps`
    sections: dict[str, Section]  # as of `rattle.compare.chaos.section.sections`
    spectra: dict[tuple[str, str, str], Spectrum]  # as of `rattle.compare.chaos.spectrum.spectra`
    law: SqrtLaw | None  # the measured square-root law
    finite_size: pd.DataFrame | None  # as of `rattle.compare.chaos.exponents.finite_size`
    field: str  # field of the sweep
    sweep: pd.DataFrame | None  # as of `rattle.compare.chaos.sweep.sweep`
    view: Bifurcation | None  # over the same values
    missing: dict[str, str]  # what was left out, with the reason


def study(
    scene: Scene,
    *,
    field: str = "alpha",
    scenes: Mapping[float, Scene],
    points: int = 1_000_000,
    impacts: int = 200_000,
    events: int = 4000,
    width: float = WIDTH,
    seed: int = 0,
    workers: int = 2,
    progress: Callable[[str], None],
) -> ChaosStudy:
    """Measure the chaos of a scene: exponents, sections, spectra, divergence of two paths, and a sweep over a field.

    What its motion does not have, for instance because a mesh sticks in every period, is left out with the reason.

    `scenes`: Those of the sweep by value of the field, as of `rattle.compare.chaos.sweep.vary`. `width`: Required width
    of the interval of each largest exponent; wider ones are reported as they are.
    """
    missing: dict[str, str] = {}
    law = sizes = swept = view = None
    progress("exponents")
    orbit = lyapunov(scene, width=width)
    drift = drift_exponents(scene, width=width, seed=seed)
    maps = mean_maps(scene, orbit)
    progress("Poincaré sections")
    drawn = sections(scene, points=points, seed=seed, workers=workers, missing=missing)
    progress("spectra")
    power = spectra(scene, impacts=impacts, seed=seed, workers=workers, missing=missing)
    progress("two paths on the same noise")
    if drift.regime.has_record:
        with leave_out(missing, "the square-root law"):
            law = sqrt_law(scene, impacts=events, seed=seed)
        sizes = finite_size(scene, events=events, seed=seed, workers=workers)
    else:  # two paths that stick are one from then on, and a rest has impacts without end
        apart = ("the square-root law", "the finite-size exponents")
        missing |= dict.fromkeys(apart, f"the noisy path {drift.regime.brief}")
    if scenes:
        progress(f"exponents at {len(scenes)} values of {field}")
        swept = sweep(scenes, field, width=width, seed=seed, workers=workers)
        progress(f"bifurcation diagram at {len(scenes)} values of {field}")
        with leave_out(missing, "the bifurcation diagram"):
            view = bifurcation(scenes, field, seed=seed, workers=workers)
    return ChaosStudy(scene, orbit, drift, maps, drawn, power, law, sizes, field, swept, view, missing)
