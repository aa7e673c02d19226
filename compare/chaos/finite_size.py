"""The finite-size Lyapunov exponent: the growth rate of a given distance between two paths on the same noise."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.compare.chaos.exponents import ratio_mean
from rattle.montecarlo.coupling.pairs import growths
from rattle.scene.scene import Scene
from rattle.scene.validate import count

Floats = NDArray[np.float64]

DELTAS = tuple(float(d) for d in np.geomspace(1e-7, 1e-1, 13))


def finite_size(
    scene: Scene,
    *,
    deltas: tuple[float, ...] = DELTAS,
    events: int = 4000,
    ratio: float = 2.0,
    seed: int = 0,
    workers: int = 2,
) -> pd.DataFrame:
    """Measure the finite-size exponent ``lambda(delta) = E[ln(end / delta)] / E[time]`` of two paths on the same noise.

    ``time`` is the time in which the distance grows from `delta` to at least `ratio` times `delta`, and ``end`` is the
    distance reached, since an impact overshoots (Aurell et al. 1997; Cencini and Vulpiani 2013).  Without noise the
    exponent tends to the largest Lyapunov exponent as delta decreases; with noise it grows without bound, because of
    the square-root law.

    Returns: Columns: ``delta, exponent, low, high`` (95 % interval), ``time`` and ``growth`` (means of the time
    and of ``ln(end / delta)``), ``events``.

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
            "delta": delta,
            "exponent": m.value,
            "low": m.value - m.half,
            "high": m.value + m.half,
            "time": float(duration.mean()),
            "growth": float(growth.mean()),
            "events": growth.size,
        }

    with ThreadPoolExecutor(workers) as pool:
        return pd.DataFrame(list(pool.map(at, deltas)))
