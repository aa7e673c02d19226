"""The table of schemes: order, cost and default step of each."""

import math
from dataclasses import dataclass

__all__ = ["SCHEMES", "Scheme"]


@dataclass(frozen=True)
class Scheme:
    """A way to advance paths and to detect impacts."""

    code: int  # its number in compiled code
    file: str  # module of this package that implements it
    weak_order: int | None  # weak order of convergence in the step; None for a scheme without step bias
    normals: int  # standard normals of a path per step without an impact
    step: float  # default step
    # step_ns, impact_ns: cost model for the choice of a scheme: time of a path-step and of an impact on one core in
    # ns, with statistics. Measured once, on an Intel Xeon with AVX-512 (12 impacts on DAT21 with two steps each, the
    # least of interleaved slices), and constant, so that the choice does not depend on the machine
    step_ns: float
    impact_ns: float

    @property
    def has_step_bias(self) -> bool:
        """Whether its results are biased by the length of the step; ``exact-flight`` has no such bias."""
        return self.weak_order is not None


SCHEMES = {
    "euler-maruyama": Scheme(0, "euler", 1, 1, 2e-3, 3.9, 130.0),
    "euler-maruyama-located": Scheme(1, "euler_located", 1, 1, 2e-3, 5.1, 250.0),
    "exact-flight": Scheme(2, "exact_flight", None, 2, math.pi / 96.0, 5.1, 740.0),
}
"""All schemes by name, in the order of increasing accuracy."""
