"""Ensemble studies: grids over any field of a scene, computed once, kept, and put together."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rattle.compare.study.design import Study
    from rattle.compare.study.tables import Tables, load

__all__ = ["Study", "Tables", "load"]

_HOMES = {
    "Study": "rattle.compare.study.design",
    "Tables": "rattle.compare.study.tables",
    "load": "rattle.compare.study.tables",
}


def __getattr__(name: str) -> Any:
    """Load what is asked for: the command needs none of it before its options are known to be well formed."""
    if name not in _HOMES:
        raise AttributeError(f"module 'compare.study' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
