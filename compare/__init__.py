"""One side held against the other: moment errors with intervals, validity of the correlation, reports."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rattle.compare.validation.validate import Validation, validate
    from rattle.compare.validation.verdict import Tolerances

__all__ = ["Tolerances", "Validation", "validate"]

_HOMES = {
    "Tolerances": "rattle.compare.validation.verdict",
    "Validation": "rattle.compare.validation.validate",
    "validate": "rattle.compare.validation.validate",
}


def __getattr__(name: str) -> Any:
    """Load what is asked for: most commands, and an idle plugin of pytest, need neither closures nor tables."""
    if name not in _HOMES:
        raise AttributeError(f"module 'compare' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
