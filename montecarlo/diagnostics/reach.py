"""The accuracy that a run reached, compared with the accuracy asked for."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from rattle.scene import duration_text

if (
    TYPE_CHECKING
):  # tables are made when they are asked for: loading pandas takes as long as all the rest
    import pandas as pd


class AccuracyWarning(UserWarning):
    """An answer is less accurate than was asked for."""


class Candidate(NamedTuple):
    """What a scheme is expected to need for an accuracy."""

    scheme: str  # name in `SCHEMES`
    dt: float  # step
    paths: int  # number of paths
    path_steps: float  # their steps, over all step sizes that run side by side
    core_seconds: float  # nominal processor time of these, see `rattle.montecarlo.accuracy.cost`
    branches: int = 0  # rare branches that are sampled on purpose

    @property
    def sentence(self) -> str:
        """The expected cost as text."""
        time = duration_text(self.core_seconds, 2)
        paths = (
            (f"{self.paths:,}" if self.paths < 1e12 else f"{self.paths:.2g}")
            + " path"
            + "s" * (self.paths > 1)
        )
        paths += near_text(self.branches)
        return f"about {time} of processor time: {self.scheme}, dt = {self.dt:.3g}, {paths}"


def near_text(branches: int) -> str:
    """What is said beside a number of paths of which a part is drawn near rare branches."""
    return (
        f", a part of them near {branches} rare branch{'es' if branches > 1 else ''}"
        if branches
        else ""
    )


class Row(NamedTuple):
    """A section mean or sd that is less accurate than was asked for."""

    moment: str  # ``mean`` or ``sd``
    quantity: str
    impact: int
    bound: float  # 95 % bound of its error, in units of the quantity's sd; all rows share the 5 %
    why: str  # what most of the bound is for

    @property
    def sentence(self) -> str:
        """The row with its bound and the reason."""
        return (
            f"{self.moment} of {self.quantity} at impact {self.impact}: {self.bound:.2g} sd"
            f" ({self.why})"
        )


class Reach(NamedTuple):
    """The accuracy that a run reached, compared with the accuracy asked for.

    Errors are the largest over all section means and sds, in units of each quantity's sd (absolute
    where nothing varies).  An accuracy is a statement on all of them at once: with 95 % probability
    none is larger, whatever the number of looks after which the run stopped.

    Attributes
    ----------
    asked : float
        The accuracy asked for.
    sampling : float
        Largest standard error.
    step : float
        Largest step bias; of ``exact-flight`` the largest share of an sd that the noise left out by
        a step has.
    bound : float
        95 % bound of all errors at once: sampling, skewness, branches that the sample cannot have
        seen, and the bias of the step.
    worst : str
        Which error matters most.
    candidates : sequence of Candidate
        What each scheme that was tried was expected to cost.
    more_seconds : float
        Estimated time still missing where the budget was spent first; 0 where the accuracy was
        reached, infinite where no shorter step can be taken.
    enough : bool
        Whether there are enough paths, over the full horizon, for events of probability 1e-4 to be
        sampled.
    remark : str
        The unseen branch that matters most, in words; empty if none does.
    missed : tuple
        Where the accuracy was not reached, the rows that miss it, the worst first: each has
        ``moment, quantity, impact, bound, why`` and a ``sentence``.  All others are as accurate as
        was asked for.

    Examples
    --------
    >>> from rattle import DAT21, Scene, simulate_to
    >>> reach = simulate_to(Scene.from_gears(DAT21, sigma=0.01), 0.05, impacts=2, rng=7).reach
    >>> reach.reached, reach.bound <= reach.asked
    (True, True)
    """

    asked: float
    sampling: float
    step: float
    bound: float
    worst: str
    candidates: Sequence[Candidate]
    more_seconds: float
    enough: bool = True
    remark: str = ""
    missed: tuple[Row, ...] = ()

    def __repr__(self) -> str:
        return f"Reach: {self.sentence}"

    @property
    def schemes(self) -> "pd.DataFrame":
        """The candidates as a table: index ``scheme``, columns ``dt, paths, path_steps,
        core_seconds``."""
        import pandas as pd

        return pd.DataFrame(self.candidates).set_index("scheme")

    @property
    def expected(self) -> Candidate:
        """The candidate of least expected cost, which was run."""
        return min(self.candidates, key=lambda candidate: candidate.core_seconds)

    @property
    def reached(self) -> bool:
        """Whether the bound is within the accuracy asked for, with enough paths."""
        return self.enough and self.bound <= self.asked

    @property
    def sentence(self) -> str:
        """What was reached, as text."""
        errors = (
            f"with 95 % probability no section mean or sd is off by more than {self.bound:.2g} sd"
            f" ({self.worst}; largest standard error {self.sampling:.2g} sd, bias of the step"
            f" {self.step:.2g} sd)"
        )
        if self.reached:
            return f"Accuracy {self.asked:g} sd reached: {errors}."
        if math.isinf(self.more_seconds):
            return (
                f"Accuracy {self.asked:g} sd NOT reached: {errors}; no shorter step can be taken."
            )
        errors += f"; {self.remark}" if self.remark else ""
        few = "" if self.enough else ", from fewer paths or a shorter time than an answer needs"
        more = f"{duration_text(self.more_seconds)} of processor time more"
        return f"Accuracy {self.asked:g} sd NOT reached: {errors}{few}; about {more} would suffice."
