"""Moment closures of the rattling system: cheap predictions by four closures with one interface."""

from rattle.closure.closure import Closure as Closure
from rattle.closure.edgeworth import Edgeworth as Edgeworth
from rattle.closure.mean_map import CLOSURES as CLOSURES
from rattle.closure.mean_map import closures_for as closures_for
from rattle.closure.mean_map import mean_map as mean_map
from rattle.closure.mean_map import refusals as refusals
from rattle.closure.result import Breakdown as Breakdown
from rattle.closure.result import MeanMap as MeanMap
from rattle.scene.orbit import Orbit as Orbit
from rattle.scene.orbit import follow as follow
