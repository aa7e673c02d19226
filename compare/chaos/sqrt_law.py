"""The square-root law: two paths on one noise that reach a wall delta apart leave it about sqrt(delta) apart.

One has been thrown back while the other still runs on for ``delta / |y|``, and in that time the noise acts on them with
different signs: they leave ``(1 + eps) sigma |m| sqrt(delta / |y|) |N(0, 1)|`` apart (docs/model.md section 8).
"""

from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from rattle.compare.chaos.exponents import CONFIDENCE
from rattle.montecarlo.coupling.pairs import after_impact
from rattle.scene.errors import InputError
from rattle.scene.scene import Scene

__all__ = ["SqrtLaw", "fitted", "sqrt_law"]

Floats = NDArray[np.float64]

SMALLEST, LARGEST = 1e-7, 1e-3
POINTS = 7
MODULATED = 0.2  # modulation of the noise below which the drift outweighs it


class SqrtLaw(NamedTuple):
    """The law as measured.

    Attributes
    ----------
    table : DataFrame
        Per ``delta``: ``apart`` (root mean square of the difference of y1 after the impact), ``ratio`` (mean square of
        it over the law's, which should be 1), ``low, high`` (its 95 % interval) and ``impacts``.
    exponent, low, high : float
        Power of delta with which the difference grows, and its 95 % interval.
    missed : int
        Impacts left out because the partner did not have the same one.
    """

    table: pd.DataFrame
    exponent: float
    low: float
    high: float
    missed: int


def fitted(deltas: Floats, apart: Floats) -> tuple[float, float, float]:
    """Power by which ``|apart|``, shape (events, deltas), grows with delta: mean of the events' slopes, with interval.

    Examples
    --------
    >>> d = np.geomspace(1e-6, 1e-4, 5)
    >>> z = np.random.default_rng(1).normal(size=(400, 5))
    >>> value, low, high = fitted(d, np.sqrt(d) * z)
    >>> bool(low < 0.5 < high)
    True
    """
    x = np.log(deltas) - np.log(deltas).mean()
    slopes = np.log(np.abs(apart)) @ x / (x @ x)
    half = float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, slopes.size - 1)) * float(slopes.std(ddof=1)) / slopes.size**0.5
    value = float(slopes.mean())
    return value, value - half, value + half


def sqrt_law(scene: Scene, *, impacts: int = 4000, seed: int = 0, deltas: Floats | None = None) -> SqrtLaw:
    """Measure exponent and prefactor of the square-root law at impacts at mesh 1 of a long path.

    Parameters
    ----------
    scene : Scene
        With noise of at least 0.03: the drift parts paths by about ``delta / |y|`` too, which outweighs weaker noise at
        all scales that the noise's tree resolves.
    impacts : int
    seed : int
    deltas : ndarray, optional
        From 1e-7 to where the drift begins to count, 1e-3 sigma^2 at most, by default.

    Raises
    ------
    InputError

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> law = sqrt_law(Scene.from_gears(DAT21, sigma=0.5), impacts=500)
    >>> bool(abs(law.exponent - 0.5) < 0.02)
    True
    """
    if deltas is None:
        largest = LARGEST * min(1.0, scene.sigma**2)
        if largest < 9.0 * SMALLEST:
            raise InputError("sigma", scene.sigma, "is too weak for the square-root law to be seen: give 0.03 or more")
        deltas = np.geomspace(SMALLEST, largest, POINTS)
    apart, place, missed = after_impact(scene, deltas, impacts, seed)
    speed, modulation = place[:, 1:2], place[:, 2:3]
    shaken = np.abs(modulation[:, 0]) > MODULATED
    if shaken.sum() < 100:
        raise InputError("impacts", impacts, f"gave {shaken.sum()} impacts at mesh 1 that can be used: give more")
    law = (1.0 + scene.epsilon) * scene.sigma * np.abs(modulation) * np.sqrt(deltas / speed)
    square = (apart / law)[shaken] ** 2
    n = len(square)
    half = float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, n - 1)) * square.std(axis=0, ddof=1) / n**0.5
    table = pd.DataFrame({
        "delta": deltas, "apart": np.sqrt((apart[shaken] ** 2).mean(axis=0)), "ratio": square.mean(axis=0),
        "low": square.mean(axis=0) - half, "high": square.mean(axis=0) + half, "impacts": n,
        "law": np.sqrt((law[shaken] ** 2).mean(axis=0)),
    })  # fmt: skip
    return SqrtLaw(table, *fitted(deltas, apart[shaken]), missed)
