"""Moment closures of the rattling system: cheap predictions, three readings of one interface."""

from rattle.closure.edgeworth import Edgeworth
from rattle.closure.mean_map import READINGS, Breakdown, MeanMap, mean_map, readings_for, refusals
from rattle.closure.orbit import Orbit, follow

__all__ = ["READINGS", "Breakdown", "Edgeworth", "MeanMap", "Orbit", "follow", "mean_map", "readings_for", "refusals"]
