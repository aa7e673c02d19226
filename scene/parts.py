"""Parts of a scene that are given as a whole: the tolerance of its gaps and the start of its paths."""

import math
from dataclasses import dataclass

from rattle.scene.constants import CUT
from rattle.scene.keywords import suggesting
from rattle.scene.validate import check_range, choice, count, finite, non_negative

__all__ = ["DRAWS", "GAPS", "SPEED", "TIME", "TINY", "UNIT_VARIANCE", "Start", "Tolerance"]

_edge = math.exp(-0.5 * CUT**2) / math.sqrt(2.0 * math.pi)
UNIT_VARIANCE = {
    "fixed": 0.0,
    "uniform": 1.0 / 3.0,
    "normal": (1.0 - 2.0 * CUT * _edge / math.erf(CUT / math.sqrt(2.0))) / CUT**2,
}
"""Variance of c for ``c_max = 1``, by distribution."""
DRAWS = ("path", "contact")

TINY = 1e-30
"""Smallest size of a parameter that is not 0: its sixth moments do not underflow."""
GAPS = (1e-9, 1e6)
SPEED, TIME = 1e6, 1e12  # largest speed and time of a start; a float resolves 1e-4 at a time of 1e12


@suggesting
@dataclass(frozen=True)
class Tolerance:
    """Random part ``c_i`` of the half gaps ``g_i + c_i`` (docs/model.md section 4, dimensionless).

    Parameters
    ----------
    c1_max, c2_max : float
        Largest deviation at each mesh; below the half gap, and 0 or at least 1e-30.
    distribution : {"uniform", "fixed", "normal"}
        ``fixed`` puts every gap at ``+c_max``; ``uniform`` on ``[-c_max, c_max]``; ``normal`` with
        standard deviation ``c_max / 2``, truncated at ``c_max``.
    draw : {"path", "contact"}
        One draw per gear set (path), or a fresh one per contact: a flank's ``c`` is drawn anew when
        the opposite flank is struck, so that no state is ever outside its wall.

    Raises
    ------
    InputError
        If a deviation is negative or out of range, or a name is unknown.

    Examples
    --------
    >>> Tolerance(0.01, 0.02, distribution="normal").draw
    'path'
    """

    c1_max: float = 0.0
    c2_max: float = 0.0
    distribution: str = "uniform"
    draw: str = "path"

    def __post_init__(self) -> None:
        for name in ("c1_max", "c2_max"):
            object.__setattr__(self, name, finite(f"tolerance.{name}", getattr(self, name)))
            check_range(f"tolerance.{name}", non_negative(f"tolerance.{name}", getattr(self, name)), TINY, GAPS[1])
        choice("tolerance.distribution", self.distribution, UNIT_VARIANCE)
        choice("tolerance.draw", self.draw, DRAWS)

    @property
    def variances(self) -> tuple[float, float]:
        """Variances of ``c_1`` and ``c_2``, a pair of floats."""
        return self.c1_max**2 * UNIT_VARIANCE[self.distribution], self.c2_max**2 * UNIT_VARIANCE[self.distribution]


@suggesting
@dataclass(frozen=True)
class Start:
    """The state from which every path starts (dimensionless).

    Parameters
    ----------
    tau : float
        Time of the start, up to 1e12 in size; the excitation is ``alpha sin tau``.
    x1, y1, x2, y2 : float
        Relative displacement and velocity of both stages; velocities up to 1e6 in size.
    mesh : {1, 2, 0}
        The mesh that is struck at once (the state is the one just before that impact), or 0 for a
        start in flight.  The impact of the start is number 0; tables count from the next one.

    Raises
    ------
    InputError
        If a value is not a finite number in its range.

    Examples
    --------
    >>> Start(0.0, 0.5, 2.0, 0.5, 2.0, mesh=1)      # the paper's start
    Start(tau=0.0, x1=0.5, y1=2.0, x2=0.5, y2=2.0, mesh=1)
    """

    tau: float = 0.0
    x1: float = 0.0
    y1: float = 0.0
    x2: float = 0.0
    y2: float = 0.0
    mesh: int = 0

    def __post_init__(self) -> None:
        for name in ("tau", "x1", "y1", "x2", "y2"):
            object.__setattr__(self, name, finite(f"start.{name}", getattr(self, name)))
        check_range("start.tau", self.tau, 0.0, TIME)
        for name, most in (("x1", GAPS[1]), ("x2", GAPS[1]), ("y1", SPEED), ("y2", SPEED)):
            check_range(f"start.{name}", getattr(self, name), 0.0, most)
        object.__setattr__(self, "mesh", count("start.mesh", self.mesh, least=0, most=2))
