"""Parameter studies: grids over any field of a scene; every cell is computed once, stored, and combined into tables."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rattle.compare.study.design import Study
    from rattle.compare.study.tables import Tables, load_study

__all__ = ["Study", "Tables", "load_study"]

_HOMES = {
    "Study": "rattle.compare.study.design",
    "Tables": "rattle.compare.study.tables",
    "load_study": "rattle.compare.study.tables",
}


def __getattr__(name: str) -> Any:
    """Import a name of `__all__` on first use: the command line checks its options before heavy imports."""
    if name not in _HOMES:
        raise AttributeError(f"module 'compare.study' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
