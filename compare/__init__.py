"""Comparison of the closures with the Monte Carlo: errors of moments with intervals, verdicts, studies, reports."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rattle.compare.validation.result import Validation
    from rattle.compare.validation.validate import validate
    from rattle.compare.validation.verdict import Tolerances

__all__ = ["Tolerances", "Validation", "validate"]

_MODULE_OF = {
    "Tolerances": "rattle.compare.validation.verdict",
    "Validation": "rattle.compare.validation.result",
    "validate": "rattle.compare.validation.validate",
}


def __getattr__(name: str) -> Any:
    """Import a name on first access: most commands, and an idle pytest plugin, need neither closures nor tables."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'compare' has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)
