"""Two paths on the same noise: the square-root law, and the growth rate of a given distance between them.

Two paths that reach a wall delta apart leave it about sqrt(delta) apart.

One path rebounds while the other still approaches the wall for a time ``delta / |y|``, y being the impact speed.  Noise
during that time enters their velocities after the impact with different factors (1 and -epsilon).  They differ by
``(1 + epsilon) sigma |m| sqrt(delta / |y|) |N(0, 1)|``, where m is the modulation of the noise (docs/model.md section
8).
"""

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import stdtrit

from rattle.compare.chaos.exponents import CONFIDENCE, ratio_mean
from rattle.compare.chaos.record import NoRecord
from rattle.montecarlo.coupling.pairs import after_impact, growths
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene
from rattle.scene.validate import count

Floats = NDArray[np.float64]

SMALLEST, LARGEST = 1e-7, 1e-3  # default range of delta
POINTS = 7
DELTAS = tuple(float(d) for d in np.geomspace(1e-7, 1e-1, 13))  # of the finite-size exponent
MODULATED = 0.2  # impacts with a smaller |modulation| of the noise are left out: the drift outweighs the noise there


class SqrtLaw(NamedTuple):
    """The measured square-root law."""

    # for each ``delta``: ``apart`` (root mean square of the difference of y1 after the impact), ``ratio`` (its mean
    # square over that of the law; 1 if the law holds), ``low, high`` (95 % interval of the ratio), ``impacts`` and
    # ``law`` (root mean square by the law)
    table: pd.DataFrame
    # exponent, low, high: power of delta to which the difference is proportional, and its 95 % interval
    exponent: float
    low: float
    high: float
    missed: int  # impacts left out because the second path did not have the same impact


def fit(deltas: Floats, apart: Floats) -> tuple[float, float, float]:
    """Fit the exponent of a power law ``|apart| ~ delta^p`` as the mean of the log-log slopes of all events.

    Shapes: `deltas` (deltas,); `apart` (events, deltas).
    """
    x = np.log(deltas) - np.log(deltas).mean()
    slopes = np.log(np.abs(apart)) @ x / (x @ x)
    half = float(stdtrit(slopes.size - 1, 0.5 + 0.5 * CONFIDENCE)) * float(slopes.std(ddof=1)) / slopes.size**0.5
    value = float(slopes.mean())
    return value, value - half, value + half


def sqrt_law(scene: Scene, *, impacts: int = 4000, seed: int = 0, deltas: Floats | None = None) -> SqrtLaw:
    """Measure exponent and prefactor of the square-root law, at impacts at mesh 1 of a long path.

    `scene`: With a noise intensity of at least 0.03.  The drift alone separates the paths by about ``delta /
    |y|``, which outweighs weaker noise at all distances that the Brownian tree resolves. `deltas`: Distances
    before the impact; by default 7 from 1e-7 to ``1e-3 min(1, sigma^2)``, below the range of the drift.
    """
    if deltas is None:
        largest = LARGEST * min(1.0, scene.sigma**2)
        if largest < 9.0 * SMALLEST:
            raise InputError("sigma", scene.sigma, "is too weak for the square-root law to be seen: give 0.03 or more")
        deltas = np.geomspace(SMALLEST, largest, POINTS)
    apart, place, missed = after_impact(scene, deltas, impacts, seed)
    speed, modulation = place[:, 1:2], place[:, 2:3]
    modulated = np.abs(modulation[:, 0]) > MODULATED
    if modulated.sum() < 100:
        raise NoRecord(f"only {modulated.sum()} impacts at mesh 1 are fast enough, and at a phase that has noise")
    law = (1.0 + scene.epsilon) * scene.sigma * np.abs(modulation) * np.sqrt(deltas / speed)
    square = (apart / law)[modulated] ** 2
    n = len(square)
    half = float(stdtrit(n - 1, 0.5 + 0.5 * CONFIDENCE)) * square.std(axis=0, ddof=1) / n**0.5
    table = pd.DataFrame(
        {
            "delta": deltas,
            "apart": np.sqrt((apart[modulated] ** 2).mean(axis=0)),
            "ratio": square.mean(axis=0),
            "low": square.mean(axis=0) - half,
            "high": square.mean(axis=0) + half,
            "impacts": n,
            "law": np.sqrt((law[modulated] ** 2).mean(axis=0)),
        }
    )
    return SqrtLaw(table, *fit(deltas, apart[modulated]), missed)


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
