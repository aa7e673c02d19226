"""How paths are sampled, and what is recorded of them, beyond what every simulation is asked for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rattle.montecarlo.kernel.blocks import Blocks
from rattle.scene.types import Floats

__all__ = ["Record", "Sampling"]


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


@dataclass(frozen=True)
class Sampling:
    """How `simulate` samples its paths: what few runs need, with defaults for all others.

    Parameters
    ----------
    control : bool
        Use the linearised path as a control variate for section means and sds (``exact-flight`` only).
    increments : {"gaussian", "two-point"}
        Distribution of the Brownian increments of an Euler-Maruyama step; two-point ones (plus or minus the root of the
        step) have the same weak order 1 and cost one random bit.
    horizon : float, optional
        Time after the start at which unfinished paths are given up; by default 50 per impact, or 10 million steps.
    device : {"cpu", "cuda"}
        Where paths are followed and summed; "cuda" needs an NVIDIA GPU and the extra ``gpu`` (numba-cuda).  The paths
        are the same to rounding.
    blocks : callable, optional
        Who runs the blocks of paths; by default threads of this process.  The result does not depend on it.

    Examples
    --------
    >>> from rattle import DAT21, Sampling, Scene, simulate
    >>> scene = Scene.from_gears(DAT21, sigma=0.05)
    >>> run = simulate(scene, paths=1000, impacts=2, rng=7, sampling=Sampling(control=True))
    >>> plain = simulate(scene, paths=1000, impacts=2, rng=7)
    >>> bool((run.section["se_tau"] < plain.section["se_tau"]).all())
    True
    """

    control: bool = False
    increments: str = "gaussian"
    horizon: float | None = None
    device: str = "cpu"
    blocks: Blocks | None = None
