"""When can a cheap moment closure of a noisy vibro-impact system be believed?

The public names.  Each is imported on first access, so ``import rattle`` loads neither numpy nor numba.

Examples
--------
>>> import rattle as rt
>>> scene = rt.Scene.from_gears(rt.DAT21, sigma=0.01)
>>> orbit = rt.mean_map(scene, impacts=2, closure="saltation")
>>> orbit.section["mesh"].tolist()
[1, 1]
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing import Any

    from rattle.closure import CLOSURES, MeanMap, Orbit, follow, mean_map
    from rattle.compare import Tolerances, Validation, validate
    from rattle.compare.stationary.measure import Stationary, stationary
    from rattle.compare.study import Study
    from rattle.montecarlo import SCHEMES, Ensemble, simulate
    from rattle.scene import DAT21, Gears, InputError, RattleError, Scene, Start, Tolerance

__all__ = [
    "CLOSURES",
    "DAT21",
    "SCHEMES",
    "Ensemble",
    "Gears",
    "InputError",
    "MeanMap",
    "Orbit",
    "RattleError",
    "Scene",
    "Start",
    "Stationary",
    "Study",
    "Tolerance",
    "Tolerances",
    "Validation",
    "follow",
    "mean_map",
    "simulate",
    "stationary",
    "validate",
]

_MODULES = {
    "scene": ("DAT21", "Gears", "InputError", "RattleError", "Scene", "Start", "Tolerance"),
    "closure": ("CLOSURES", "MeanMap", "Orbit", "follow", "mean_map"),
    "montecarlo": ("SCHEMES", "Ensemble", "simulate"),
    "compare": ("Tolerances", "Validation", "validate"),
    "compare.stationary.measure": ("Stationary", "stationary"),
    "compare.study": ("Study",),
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
