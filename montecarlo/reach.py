"""How far an answer got towards the accuracy that was asked for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from rattle.montecarlo.budget import in_words

if TYPE_CHECKING:  # tables are made when they are asked for: loading pandas takes as long as all the rest
    import pandas as pd

__all__ = ["AccuracyWarning", "Candidate", "Reach"]


class AccuracyWarning(UserWarning):
    """An answer is less accurate than was asked for; those who say so themselves silence this."""


class Candidate(NamedTuple):
    """Step, paths and processor time that a scheme is expected to need."""

    scheme: str
    dt: float
    paths: int
    core_seconds: float

    @property
    def sentence(self) -> str:
        """What is expected, in words."""
        paths = f"{self.paths:,}" if self.paths < 1e12 else f"{self.paths:.2g}"
        return (
            f"about {self.core_seconds:.2g} core-seconds: {self.scheme}, dt = {self.dt:.3g}, {paths} "
            f"path{'s' if self.paths > 1 else ''}"
        )


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
        Estimated time to what was asked, where the budget ended before it; 0 where it was reached, infinite where no
        time would do.
    enough : bool
        Whether the paths are as many as an answer needs, so that what few of them do is seen, and followed as long.
    """

    asked: float
    sampling: float
    step: float
    worst: str
    candidates: Sequence[Candidate]
    more_seconds: float
    enough: bool = True

    @property
    def schemes(self) -> pd.DataFrame:
        """The candidates as a table: index ``scheme``, columns ``dt, paths, core_seconds``."""
        import pandas as pd

        return pd.DataFrame(self.candidates).set_index("scheme")

    @property
    def expected(self) -> Candidate:
        """The candidate that was taken: the one of least cost."""
        return min(self.candidates, key=lambda candidate: candidate.core_seconds)

    @property
    def reached(self) -> bool:
        """Whether both errors are within what was asked, and stand on enough paths."""
        return self.enough and max(self.sampling, self.step) <= self.asked

    @property
    def sentence(self) -> str:
        """What was reached, in words."""
        errors = (
            f"largest standard error {self.sampling:.2g} sd ({self.worst}), largest bias of the step {self.step:.2g} sd"
        )
        if self.reached:
            return f"Accuracy {self.asked:g} sd reached: {errors}."
        if math.isinf(self.more_seconds):
            return f"Accuracy {self.asked:g} sd NOT reached: {errors}; no shorter step can be taken."
        few = "" if self.enough else ", from fewer paths or a shorter time than an answer needs"
        more = in_words(self.more_seconds)
        return f"Accuracy {self.asked:g} sd NOT reached within the budget: {errors}{few}; about {more} more would do."
