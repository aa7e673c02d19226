"""Moment closures of the rattling system: cheap predictions by four closures with one interface."""

from rattle.closure.closure import Closure
from rattle.closure.edgeworth import Edgeworth
from rattle.closure.mean_map import CLOSURES, closures_for, mean_map, refusals
from rattle.closure.orbit import Orbit, follow
from rattle.closure.result import Breakdown, MeanMap

__all__ = [
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
]
