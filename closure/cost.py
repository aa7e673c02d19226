"""Nominal processor time of a closure: counted impacts, and flights of mixture components, at stated costs.

No clock is asked, so that what is advised does not depend on the machine or on what else it does.
"""

from rattle.closure.branching.error import COMPONENT_MICROSECONDS
from rattle.closure.branching.trace import LEVELS
from rattle.closure.result import MeanMap

IMPACT_MICROSECONDS = {"published": 200.0, "corrected": 50.0, "saltation": 250.0, "branching": 300.0}
"""Of an impact on one core, components not counted; measured once on DAT21 and the examples."""


def closure_seconds(found: MeanMap) -> float:
    """Nominal seconds of one core that a prediction takes."""
    return 1e-6 * (found.trace.found * IMPACT_MICROSECONDS[found.closure] + found.trace.work * COMPONENT_MICROSECONDS)


def most_seconds(closure: str, impacts: int) -> float:
    """The most that `closure_seconds` can be before a closure is followed: all components that it may have."""
    work = impacts * sum(level.cut for level in LEVELS[-2:]) if closure == "branching" else 0
    return 1e-6 * (impacts * IMPACT_MICROSECONDS[closure] + work * COMPONENT_MICROSECONDS)
