"""What a scheme is: its step, its way to the next impact, its longest step, its bias and its cost.

The functions are compiled; `rattle.montecarlo.kernel.kernel.block_kernel` makes one kernel of each
scheme, into which they are compiled.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rattle.montecarlo.schemes.lanes import Lanes
from rattle.montecarlo.schemes.short_flight import Moved, Phase
from rattle.montecarlo.schemes.step_state import Inside, Progress, Quiet, Scratch
from rattle.montecarlo.schemes.time_scales import Limit
from rattle.scene import Bools, Constants, Floats, Scene


@dataclass(frozen=True, eq=False)
class Scheme:
    """A way to advance paths and to detect impacts."""

    # weak order of convergence in the step; None for a scheme without step bias
    weak_order: int | None
    normals: int  # standard normals of a path per step without an impact: 2 where it has an area
    step: float  # default step
    # step_ns, impact_ns: cost model for the choice of a scheme: time of a path-step and of an
    # impact on one core in ns, with statistics. Measured once, on an Intel Xeon with AVX-512 (12
    # impacts on DAT21 with two steps each, the least of interleaved slices), and constant, so that
    # the choice does not depend on the machine
    step_ns: float
    impact_ns: float
    # whether impacts are those of the state at the end of a step, instead of where they are within
    detects_at_end: bool
    longest_step: Callable[[Scene], Limit]  # beyond which it is unstable or misses impacts
    trusted_step: Callable[[Scene], Limit]  # up to which noise within a step biases no mean by 5 %
    # one step of all lanes from a time on, of a length; marks those that may have an impact in it.
    # Flanks are read of each lane only where they differ
    step_lanes: Callable[[Constants, float, float, bool, Lanes, Scratch, Bools, int], None]
    # noise of a coarse step from that of its halves
    join_noise: Callable[[Floats, Floats, Floats, Floats, bool, int], None]
    phase_at: Callable[[Any, float], Phase]  # what a step knows of the drive at its start
    # to the next impact within a step, or to its end, from where a path is after so many impacts
    # and beside the meshes that are closed
    advance: Callable[[Inside, int, Progress, Phase], Moved]
    # writes the meshes that are closed, see `Scratch`; the bound on the rate of impacts that are
    # not followed, or -1 where none is closed
    find_sticking: Callable[[Constants, Progress, Scratch, Quiet], float]
    stick_to_end: Callable[[Constants, Progress, Scratch], Progress]  # the path at that end

    @property
    def has_step_bias(self) -> bool:
        """Whether its results are biased by the length of the step; ``exact-flight`` has no such
        bias."""
        return self.weak_order is not None
