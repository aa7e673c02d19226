"""When can a cheap moment closure of a noisy vibro-impact system be believed?

The public names.  Each is imported on first access, so ``import rattle`` loads neither numpy nor numba.

Examples
--------
>>> import rattle as rt
>>> scene = rt.Scene.from_gears(rt.DAT21, sigma=0.01)
>>> orbit = rt.mean_map(scene, impacts=2, closure="saltation")
>>> orbit.section["mesh"].tolist()
[1, 2]
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing import Any

    from rattle.closure import (
        CLOSURES,
        Breakdown,
        Closure,
        Edgeworth,
        MeanMap,
        Orbit,
        closures_for,
        follow,
        mean_map,
        refusals,
    )
    from rattle.compare.parameters.boundary import Boundary, boundary
    from rattle.compare.parameters.crossing import Crossing, crossing
    from rattle.compare.parameters.map import BoundaryMap, boundary_map
    from rattle.compare.parameters.of_closure import ClosureSensitivity, closure_sensitivity
    from rattle.compare.parameters.sensitivity import Sensitivity, sensitivity
    from rattle.compare.stationary.measure import stationary
    from rattle.compare.stationary.result import Stationary
    from rattle.compare.study.design import Study
    from rattle.compare.study.folder import load_study
    from rattle.compare.study.impacts import Tables
    from rattle.compare.validation.result import Validation
    from rattle.compare.validation.validate import validate
    from rattle.compare.validation.verdict import Tolerances
    from rattle.montecarlo import (
        SCHEMES,
        AccuracyWarning,
        Ensemble,
        Record,
        Sampling,
        default_step,
        largest_step,
        simulate,
        simulate_rare,
        simulate_to,
    )
    from rattle.montecarlo.diagnostics.reach import Reach
    from rattle.scene import (
        DAT21,
        FileError,
        Gears,
        InputError,
        Order,
        OutputError,
        RattleError,
        Scene,
        Start,
        Tolerance,
    )
    from rattle.scene.measured_drive import MeasuredDrive, measure_drive
    from rattle.scene.threshold import RattleThreshold, rattle_threshold

__all__ = [
    "CLOSURES",
    "DAT21",
    "SCHEMES",
    "AccuracyWarning",
    "Boundary",
    "BoundaryMap",
    "Breakdown",
    "Closure",
    "ClosureSensitivity",
    "Crossing",
    "Edgeworth",
    "Ensemble",
    "FileError",
    "Gears",
    "InputError",
    "MeanMap",
    "MeasuredDrive",
    "Orbit",
    "Order",
    "OutputError",
    "RattleError",
    "RattleThreshold",
    "Reach",
    "Record",
    "Sampling",
    "Scene",
    "Sensitivity",
    "Start",
    "Stationary",
    "Study",
    "Tables",
    "Tolerance",
    "Tolerances",
    "Validation",
    "boundary",
    "boundary_map",
    "closure_sensitivity",
    "closures_for",
    "crossing",
    "default_step",
    "follow",
    "largest_step",
    "load_study",
    "mean_map",
    "measure_drive",
    "rattle_threshold",
    "refusals",
    "sensitivity",
    "simulate",
    "simulate_rare",
    "simulate_to",
    "stationary",
    "validate",
]

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


def __getattr__(name: str) -> "Any":
    from importlib import import_module, metadata

    if name == "__version__":
        return metadata.version("rattle")
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
