"""How paths are sampled, beyond what every simulation is asked for."""

from __future__ import annotations

from dataclasses import dataclass

from rattle.montecarlo.kernel.blocks import Blocks

__all__ = ["Sampling"]


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
