"""What a simulation records of its paths beside the moments of their sections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rattle.scene.types import Floats

__all__ = ["Record"]


@dataclass(frozen=True)
class Record:
    """What a simulation records beside the section moments; nothing else is computed or kept.

    Parameters
    ----------
    times : sequence of float
        Times at which the moments of all paths are taken, see `Ensemble.at_times`; on the grid of the coarsest step.
    step_bias : bool, optional
        Run 2 dt and 4 dt on the same Brownian paths beside dt, and estimate the bias of the step from the differences
        (Richardson extrapolation; about two thirds more work).  By default where the scheme has such a bias, and 4 dt
        is admissible.
    itineraries : mapping of str to sequence of int
        Named itineraries ``mesh * side``, one entry for each impact, whose agreement with the paths is counted beside
        that of the noise-free path.
    on_itinerary : bool
        The moments of the paths that have followed an itinerary so far, `Ensemble.on_itinerary`, and how the others
        leave it, `Ensemble.leaving`.
    histogram : bool
        Histograms of each section quantity at each impact, `Ensemble.histograms`.
    raw : bool
        Every impact of every path, `Ensemble.raw`; memory then grows with the paths (56 bytes an impact).
    energy : bool
        The mean energy lost at each impact.
    batches : bool
        Means and sds of batches of paths, `Ensemble.batches`, for intervals of what is computed from them.

    Examples
    --------
    >>> from rattle.montecarlo import simulate
    >>> from rattle.scene import DAT21, Scene
    >>> run = simulate(Scene.from_gears(DAT21, sigma=0.1), paths=64, impacts=3, record=Record(energy=True, raw=True))
    >>> run.raw.shape, "energy" in run.section
    ((64, 3, 7), True)
    """

    times: Sequence[float] | Floats = ()
    step_bias: bool | None = None
    itineraries: Mapping[str, Sequence[int]] = field(default_factory=dict)
    on_itinerary: bool = False
    histogram: bool = False
    raw: bool = False
    energy: bool = False
    batches: bool = False
