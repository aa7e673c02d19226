"""When can a cheap moment closure of a noisy vibro-impact system be believed?

The public names.  Each is imported on first access, so ``import rattle`` loads neither numpy nor
numba.

Examples
--------
>>> import rattle as rt
>>> scene = rt.Scene.from_gears(rt.DAT21, sigma=0.01)
>>> orbit = rt.mean_map(scene, impacts=2, closure="saltation")
>>> orbit.section["mesh"].tolist()
[1, 2]
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # read by type checkers alone; at run time names are found by `_MODULES`
    from typing import Any

    from rattle.closure import CLOSURES as CLOSURES
    from rattle.closure import Breakdown as Breakdown
    from rattle.closure import Closure as Closure
    from rattle.closure import Edgeworth as Edgeworth
    from rattle.closure import MeanMap as MeanMap
    from rattle.closure import Orbit as Orbit
    from rattle.closure import closures_for as closures_for
    from rattle.closure import follow as follow
    from rattle.closure import mean_map as mean_map
    from rattle.closure import refusals as refusals
    from rattle.compare.animation.animate import Animation as Animation
    from rattle.compare.animation.animate import animate as animate
    from rattle.compare.chaos.chaos import Chaos as Chaos
    from rattle.compare.chaos.chaos import chaos as chaos
    from rattle.compare.parameters.boundary import Boundary as Boundary
    from rattle.compare.parameters.boundary import boundary as boundary
    from rattle.compare.parameters.crossing import Crossing as Crossing
    from rattle.compare.parameters.crossing import crossing as crossing
    from rattle.compare.parameters.map import BoundaryMap as BoundaryMap
    from rattle.compare.parameters.map import boundary_map as boundary_map
    from rattle.compare.parameters.of_closure import ClosureSensitivity as ClosureSensitivity
    from rattle.compare.parameters.of_closure import closure_sensitivity as closure_sensitivity
    from rattle.compare.parameters.sensitivity import Sensitivity as Sensitivity
    from rattle.compare.parameters.sensitivity import sensitivity as sensitivity
    from rattle.compare.stationary.measure import stationary as stationary
    from rattle.compare.stationary.result import Stationary as Stationary
    from rattle.compare.study.design import Study as Study
    from rattle.compare.study.folder import load_study as load_study
    from rattle.compare.study.impacts import Tables as Tables
    from rattle.compare.validation.result import Validation as Validation
    from rattle.compare.validation.validate import validate as validate
    from rattle.compare.validation.verdict import Tolerances as Tolerances
    from rattle.montecarlo import SCHEMES as SCHEMES
    from rattle.montecarlo import AccuracyWarning as AccuracyWarning
    from rattle.montecarlo import Ensemble as Ensemble
    from rattle.montecarlo import Record as Record
    from rattle.montecarlo import Sampling as Sampling
    from rattle.montecarlo import default_step as default_step
    from rattle.montecarlo import largest_step as largest_step
    from rattle.montecarlo import simulate as simulate
    from rattle.montecarlo import simulate_rare as simulate_rare
    from rattle.montecarlo import simulate_to as simulate_to
    from rattle.montecarlo.diagnostics.reach import Reach as Reach
    from rattle.scene import DAT21 as DAT21
    from rattle.scene import FileError as FileError
    from rattle.scene import Gears as Gears
    from rattle.scene import InputError as InputError
    from rattle.scene import Order as Order
    from rattle.scene import OutputError as OutputError
    from rattle.scene import RattleError as RattleError
    from rattle.scene import Scene as Scene
    from rattle.scene import Start as Start
    from rattle.scene import Tolerance as Tolerance
    from rattle.scene.measured_drive import MeasuredDrive as MeasuredDrive
    from rattle.scene.measured_drive import measure_drive as measure_drive
    from rattle.scene.threshold import RattleThreshold as RattleThreshold
    from rattle.scene.threshold import rattle_threshold as rattle_threshold

_MODULES = {
    "scene": (
        "DAT21",
        "FileError",
        "Gears",
        "InputError",
        "Order",
        "OutputError",
        "RattleError",
        "Scene",
        "Start",
        "Tolerance",
    ),
    "scene.measured_drive": ("MeasuredDrive", "measure_drive"),
    "scene.threshold": ("RattleThreshold", "rattle_threshold"),
    "closure": (
        "CLOSURES",
        "Breakdown",
        "Closure",
        "Edgeworth",
        "MeanMap",
        "Orbit",
        "closures_for",
        "follow",
        "mean_map",
        "refusals",
    ),
    "montecarlo": (
        "SCHEMES",
        "AccuracyWarning",
        "Ensemble",
        "Record",
        "Sampling",
        "default_step",
        "largest_step",
        "simulate",
        "simulate_rare",
        "simulate_to",
    ),
    "montecarlo.diagnostics.reach": ("Reach",),
    "compare.animation.animate": ("Animation", "animate"),
    "compare.chaos.chaos": ("Chaos", "chaos"),
    "compare.parameters.boundary": ("Boundary", "boundary"),
    "compare.parameters.crossing": ("Crossing", "crossing"),
    "compare.parameters.map": ("BoundaryMap", "boundary_map"),
    "compare.parameters.of_closure": ("ClosureSensitivity", "closure_sensitivity"),
    "compare.parameters.sensitivity": ("Sensitivity", "sensitivity"),
    "compare.stationary.measure": ("stationary",),
    "compare.stationary.result": ("Stationary",),
    "compare.study.design": ("Study",),
    "compare.validation.result": ("Validation",),
    "compare.validation.validate": ("validate",),
    "compare.validation.verdict": ("Tolerances",),
    "compare.study.folder": ("load_study",),
    "compare.study.impacts": ("Tables",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}
__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> "Any":
    from importlib import import_module, metadata

    if name == "__version__":
        return metadata.version("rattle")
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
