"""How accurate an answer is: a 95 % bound of the error of all section means and sds
(docs/theory/statistics.md).

The bound of `error_bound` is where the probabilities that the rows' errors exceed it add up to 5 %.
Errors are larger where the sampling distribution of a row is skewed (`skewness_gains`), and by what
branches that the sample cannot have seen could change (`rattle.montecarlo.diagnostics.unseen`).
They are in units of each quantity's sd, and absolute where the sd is no scale: where nothing
varies, and for the displacement at the mesh that most paths strike.
"""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.special import ndtr

from rattle.montecarlo.diagnostics.unseen import Unseen, unseen
from rattle.montecarlo.diagnostics.unseen_text import unseen_text
from rattle.montecarlo.kernel.block import BLOCK
from rattle.montecarlo.statistics.intervals import CONFIDENCE, ROUNDED_SD
from rattle.montecarlo.statistics.section_statistics import (
    SectionColumns,
    quantities_in,
    quantity_at,
    stack_section,
    undefined,
)
from rattle.scene import Floats, Scene

if TYPE_CHECKING:
    import pandas as pd

FEWEST_PATHS = (
    32 * BLOCK
    # fewest paths of an answer: events of probability 1e-4 can dominate an sd, so they must be
    # sampled
)
# sigma / alpha up to which the control variate is tried; on DAT21 it pays up to 0.07
SMALL_NOISE = 0.2
Z_OF_GAIN = 3.0  # half width, in standard errors, at which the skewness of rows is accounted for
BOUND_MOMENTS = ("mean", "sd")
Place = tuple[np.intp, ...]
"""Indices of a moment in `BOUND_MOMENTS`, of a section quantity, and of an impact."""


def smallest_sd(columns: SectionColumns) -> dict[str, Floats]:
    """Smallest sd of each quantity, shape (impacts,), that doubles resolve: below it the quantity
    counts as constant.

    It is `ROUNDED_SD` times a size: of times their own, of displacements and velocities the largest
    over the impacts.
    """
    tau = ROUNDED_SD * np.abs(np.asarray(columns["tau"], float))
    tau_name, flight_name, *states = quantities_in(columns)
    smallest = {tau_name: tau, flight_name: tau}
    for q in states:
        size = np.nan_to_num(np.hypot(columns[q], columns["sd_" + q]))
        smallest[q] = np.full_like(tau, ROUNDED_SD * size.max(initial=0.0))
    return smallest


def unit_rows(run: Any) -> Floats:
    """As `units`, without a table.

    `run`: An ensemble, or a stored result with the same columns. Shapes: result (quantities,
    impacts).
    """
    sd = stack_section(run.columns, "sd_")
    unit = np.where(sd > list(smallest_sd(run.columns).values()), sd, 1.0)
    for mesh in range(1, len(unit) // 2):
        unit[2 * mesh, run.columns["mesh"] == mesh] = 1.0
    return unit


def units(run: Any) -> "pd.DataFrame":
    """Unit of each quantity's errors: its sd, or 1 where the sd is no scale."""
    import pandas as pd

    return pd.DataFrame(
        unit_rows(run).T, index=run.section.index, columns=list(quantities_in(run.columns))
    )


def sampling_error(run: Any) -> tuple[float, str]:
    """Largest standard error of the section means and sds, in units of each quantity's sd."""
    errors = np.nan_to_num(_stack_errors(run.columns) / unit_rows(run))
    if not errors.any():
        seen = np.isfinite(run.columns["tau"]).any()
        return 0.0, "nothing varies" if seen else "no impact was seen"
    return float(errors.max()), name_row(np.unravel_index(errors.argmax(), errors.shape))


def _stack_errors(columns: SectionColumns) -> Floats:
    """Standard errors of section means and sds, shape (2, quantities, impacts)."""
    return np.stack([stack_section(columns, prefix) for prefix in ("se_", "se_sd_")])


class Bound(NamedTuple):
    """A simultaneous bound of all errors of section means and sds, in units of each quantity's
    sd."""

    error: float  # the bound, with what the sample cannot have seen
    # the bound without it: this part falls with the square root of the number of paths
    sampled: float
    where: str  # moment, quantity and impact that matter most
    remark: str  # the unseen branch that matters most, in words; empty if none does
    rare: str  # moment, quantity and impact that it could change most


def skewness_gains(columns: SectionColumns, z: float) -> Floats:
    """By how much intervals of means and sds are longer on one side, in units of their half width.

    Hall's (1992) correction of a studentised mean, ``gamma (2 z^2 + 1) / (6 z sqrt(n))``, with the
    skewness gamma of what is averaged: the quantity for its mean, its squared deviation for its sd.
    Ten paths that carry most of a variance are nearly a Poisson count, whose upper limit this is.

    Returns: Positive where the true value may lie further above than below; 0 where it is not
    known. Shapes: result (2, quantities, impacts).
    """
    factor = 2.0 * z**2 + 1.0
    if "lean_tau" in columns:  # weighted paths: measured
        lean = np.stack([stack_section(columns, prefix) for prefix in ("lean_", "lean_sd_")])
        return np.asarray(np.nan_to_num(lean) * factor / (6.0 * z))
    n = np.maximum(np.asarray(columns["paths"], float), 1.0)
    fourth = 3.0 + stack_section(columns, "kurt_")
    with np.errstate(invalid="ignore", over="ignore"):
        # the variance of the skewness is that of z^3 - 3 z, and E z^6 >= (E z^4)^2 as E z^2 = 1
        se = stack_section(columns, "se_skew_")
        sixth = np.maximum(n * se**2 - 9.0 + 6.0 * fourth, fourth**2)
        of_sd = (sixth - 3.0 * fourth + 2.0) / np.maximum(fourth - 1.0, 1e-12) ** 1.5
    gamma = np.stack([stack_section(columns, "skew_"), of_sd])
    return np.asarray(np.nan_to_num(gamma * factor / (6.0 * z * np.sqrt(n))))


def absolute_errors(columns: SectionColumns) -> Floats:
    """Standard errors of section means and sds, longer where their sampling distribution is skewed.

    Returns: Of the mean and of the sd of each section quantity, in its own unit; 0 where not known.
    Shapes: result (2, quantities, impacts).
    """
    gains = skewness_gains(columns, Z_OF_GAIN)
    return np.asarray(np.nan_to_num(_stack_errors(columns)) * (1.0 + np.abs(gains)))


def unseen_shifts(hidden: Unseen) -> Floats:
    """How far unseen branches could move a mean or an sd, whichever way is further.

    Shapes: result (2, quantities, impacts).
    """
    return np.asarray(np.nan_to_num([either.T for either in hidden.either_way()]))


def find_exceedance(error: Floats, shift: Floats, share: float) -> float:
    """Where the probabilities that normal errors exceed it, less a shift each, add up to
    `share`."""
    low = float(shift.max())
    high = float((shift + 40.0 * error).max())
    for _ in range(60):
        middle = 0.5 * (low + high)
        with undefined():
            beyond = np.where(error > 0.0, 2.0 * ndtr(-(middle - shift) / error), 0.0).sum()
        low, high = (middle, high) if beyond > share else (low, middle)
    return high


def count_paths(columns: SectionColumns) -> int:
    """Paths that reached the first impact."""
    return int(np.nanmax(np.nan_to_num(columns["paths"]), initial=0.0))


def errors_by_row(run: Any) -> tuple[Floats, Floats, Unseen]:
    """Standard errors and shifts by unseen branches of all rows, in their units, shape (2,
    quantities, impacts)."""
    unit = unit_rows(run)
    hidden = unseen(run.scene, run.columns, count_paths(run.columns))
    return absolute_errors(run.columns) / unit, unseen_shifts(hidden) / unit, hidden


def explain_shift(hidden: Unseen, shift: Floats, row: Place) -> str:
    """The unseen branch that could move a row, in words."""
    moment, i, k = row
    return unseen_text(
        BOUND_MOMENTS[moment], hidden.probability[k, i], shift[row], hidden.needed[k, i]
    )


def error_bound(run: Any, share: float = 1.0 - CONFIDENCE) -> Bound:
    """Bound all errors of section means and sds at once, except for the bias of the step."""
    error, shift, hidden = errors_by_row(run)
    sampled = find_exceedance(error, 0.0 * shift, share)
    bound = find_exceedance(error, shift, share)
    if bound == 0.0:
        return Bound(0.0, 0.0, sampling_error(run)[1], "", "")
    weight = shift + error * (sampled / max(error.max(), 1e-300))
    where = name_row(np.unravel_index(np.argmax(weight), error.shape))
    remark = ""
    rare = ""
    if bound > 1.05 * sampled:
        furthest = np.unravel_index(np.argmax(shift), error.shape)
        rare = name_row(furthest)
        remark = explain_shift(hidden, shift, furthest)
    return Bound(bound, sampled, where, remark, rare)


def name_row(row: Place) -> str:
    """A row in words."""
    moment, i, k = row
    return f"{BOUND_MOMENTS[moment]} of {quantity_at(int(i))} at impact {k + 1}"


def small_noise(scene: Scene) -> bool:
    """Whether the noise is white, and weak enough for the linearised path to be worth its time as a
    control variate."""
    return not scene.correlation_time and scene.sigma <= SMALL_NOISE * scene.alpha
