"""When can a cheap moment closure of a noisy vibro-impact system be believed?

The names that most users need; the rest is in `rattle.scene`, `rattle.closure`,
`rattle.montecarlo` and `rattle.compare`.  ``__init__.pyi`` lists them.  Each is imported on first
access, so ``import rattle`` loads neither numpy nor numba.

Examples
--------
>>> import rattle as rt
>>> scene = rt.Scene.from_gears(rt.DAT21, sigma=0.01)
>>> orbit = rt.mean_map(scene, impacts=2, closure="saltation")
>>> orbit.section["mesh"].tolist()
[1, 2]
"""

from importlib import metadata

import lazy_loader

_import, _, __all__ = lazy_loader.attach_stub(__name__, __file__)
ELSEWHERE = "what is not here is in rattle.scene, rattle.closure, rattle.montecarlo, rattle.compare"


def __getattr__(name: str) -> object:
    if name == "__version__":
        return metadata.version("rattle")
    if name not in __all__:
        raise AttributeError(f"module 'rattle' has no attribute {name!r}; {ELSEWHERE}")
    return _import(name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
