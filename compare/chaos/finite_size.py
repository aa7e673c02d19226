"""The finite-size exponent: how fast two paths on one noise part when they are a given distance apart."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.compare.chaos.exponents import ratio_mean
from rattle.montecarlo.coupling.pairs import growths
from rattle.scene.scene import Scene
from rattle.scene.validate import count

__all__ = ["finite_size"]

Floats = NDArray[np.float64]

DELTAS = tuple(float(d) for d in np.geomspace(1e-7, 1e-1, 13))


def finite_size(
    scene: Scene, *, deltas: tuple[float, ...] = DELTAS, events: int = 4000, ratio: float = 2.0, seed: int = 0,
    workers: int = 2,
) -> pd.DataFrame:  # fmt: skip
    """Finite-size exponent ``lambda(delta) = E[ln(end / delta)] / E[time]`` over scales, on common noise.

    For growth from `delta` to `ratio` times as much; the distance at the end counts as it is, for an impact overshoots
    (Aurell and others 1997; Cencini and Vulpiani 2013).  Without noise it levels off at the largest Lyapunov exponent;
    under noise it rises without bound as delta falls, by the square-root law.

    Parameters
    ----------
    scene : Scene
    deltas : tuple of float
    events : int
        Growths at each scale.
    ratio : float
    seed : int
    workers : int
        Threads; the result does not depend on it.

    Returns
    -------
    DataFrame
        Columns: ``delta, exponent, low, high``, ``time`` and ``growth`` (means of a growth's time and logarithm),
        ``events``.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> t = finite_size(Scene.from_gears(DAT21, sigma=1.0), deltas=(1e-6, 1e-3), events=200)
    >>> bool(t["exponent"][0] > t["exponent"][1])
    True
    """
    count("events", events, least=128)
    count("workers", workers)

    def at(delta: float) -> dict[str, float]:
        duration, growth = growths(scene, delta, events, seed, ratio=ratio)
        m = ratio_mean(growth, duration)
        return {
            "delta": delta, "exponent": m.value, "low": m.value - m.half, "high": m.value + m.half,
            "time": float(duration.mean()), "growth": float(growth.mean()), "events": growth.size,
        }  # fmt: skip

    with ThreadPoolExecutor(workers) as pool:
        return pd.DataFrame(list(pool.map(at, deltas)))
