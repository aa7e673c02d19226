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

    from rattle.closure import CLOSURES, Breakdown, Edgeworth, MeanMap, Orbit, closures_for, follow, mean_map, refusals
    from rattle.compare import Tolerances, Validation, validate
    from rattle.compare.stationary.measure import Stationary, stationary
    from rattle.compare.study import Study, Tables, load_study
    from rattle.montecarlo import (
        SCHEMES,
        AccuracyWarning,
        Ensemble,
        RareEnsemble,
        Record,
        Sampling,
        default_step,
        largest_step,
        simulate,
        simulate_rare,
        simulate_to,
    )
    from rattle.montecarlo.diagnostics.reach import Reach
    from rattle.scene import DAT21, FileError, Gears, InputError, OutputError, RattleError, Scene, Start, Tolerance

__all__ = [
    "CLOSURES",
    "DAT21",
    "SCHEMES",
    "AccuracyWarning",
    "Breakdown",
    "Edgeworth",
    "Ensemble",
    "FileError",
    "Gears",
    "InputError",
    "MeanMap",
    "Orbit",
    "OutputError",
    "RareEnsemble",
    "RattleError",
    "Reach",
    "Record",
    "Sampling",
    "Scene",
    "Start",
    "Stationary",
    "Study",
    "Tables",
    "Tolerance",
    "Tolerances",
    "Validation",
    "closures_for",
    "default_step",
    "follow",
    "largest_step",
    "load_study",
    "mean_map",
    "refusals",
    "simulate",
    "simulate_rare",
    "simulate_to",
    "stationary",
    "validate",
]

_MODULES = {
    "scene": ("DAT21", "FileError", "Gears", "InputError", "OutputError", "RattleError", "Scene", "Start", "Tolerance"),
    "closure": (
        "CLOSURES",
        "Breakdown",
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
        "RareEnsemble",
        "Record",
        "Sampling",
        "default_step",
        "largest_step",
        "simulate",
        "simulate_rare",
        "simulate_to",
    ),
    "montecarlo.diagnostics.reach": ("Reach",),
    "compare": ("Tolerances", "Validation", "validate"),
    "compare.stationary.measure": ("Stationary", "stationary"),
    "compare.study": ("Study", "Tables", "load_study"),
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
