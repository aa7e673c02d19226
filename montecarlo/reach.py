"""How far an answer got towards the accuracy that was asked for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:  # tables are made when they are asked for: loading pandas takes as long as all the rest
    import pandas as pd

__all__ = ["Candidate", "Reach"]


class Candidate(NamedTuple):
    """Step, paths and processor time that a scheme is expected to need."""

    scheme: str
    dt: float
    paths: int
    core_seconds: float


class Reach(NamedTuple):
    """How far an answer got towards the accuracy that was asked for.

    Errors are the worst over all section means and sds, in units of each quantity's sd (absolute where none varies).

    Attributes
    ----------
    asked : float
        The accuracy.
    sampling : float
        Largest standard error.
    step : float
        Largest bias of the step; 0 for a scheme that has none.
    worst : str
        Where the standard error is largest.
    candidates : sequence of Candidate
        What each scheme that was tried was expected to cost.
    more_seconds : float
        Estimated time to what was asked, where the budget ended before it; 0 where it was reached.
    """

    asked: float
    sampling: float
    step: float
    worst: str
    candidates: Sequence[Candidate]
    more_seconds: float

    @property
    def schemes(self) -> pd.DataFrame:
        """The candidates as a table: index ``scheme``, columns ``dt, paths, core_seconds``."""
        import pandas as pd

        return pd.DataFrame(self.candidates).set_index("scheme")

    @property
    def reached(self) -> bool:
        """Whether both errors are within what was asked."""
        return max(self.sampling, self.step) <= self.asked

    @property
    def sentence(self) -> str:
        """What was reached, in words."""
        errors = (
            f"largest standard error {self.sampling:.2g} sd ({self.worst}), largest bias of the step {self.step:.2g} sd"
        )
        if self.reached:
            return f"Accuracy {self.asked:g} sd reached: {errors}."
        return (
            f"Accuracy {self.asked:g} sd NOT reached within the budget: {errors}; about {self.more_seconds:.0f} s more "
            "would do."
        )
