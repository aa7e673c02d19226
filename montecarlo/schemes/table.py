"""The ladder of schemes: what each is called, costs and promises."""

import math
from dataclasses import dataclass

__all__ = ["SCHEMES", "Scheme"]


@dataclass(frozen=True)
class Scheme:
    """A way to advance paths and to meet walls.

    Attributes
    ----------
    code : int
        Its number in compiled code.
    file : str
        Module of this package that holds it.
    weak_order : int or None
        Order of its bias in the step; None where there is no bias in the step.
    normals : int
        Standard normals that a path uses in a step without an impact.
    step : float
        The step that is taken where none is given.
    step_ns, impact_ns : float
        Time of a path's step and of its impact on one core, statistics included: what schemes are chosen by.  Measured
        once by ``rattle bench``, and constant, so that the choice does not depend on the machine.
    """

    code: int
    file: str
    weak_order: int | None
    normals: int
    step: float
    step_ns: float
    impact_ns: float


SCHEMES = {
    "euler-maruyama": Scheme(0, "euler", 1, 1, 2e-3, 2.8, 75.0),
    "euler-maruyama-located": Scheme(1, "euler_located", 1, 1, 2e-3, 4.1, 150.0),
    "exact-flight": Scheme(2, "exact_flight", None, 2, math.pi / 256.0, 4.7, 1200.0),
}
"""From the plainest to the most exact."""
