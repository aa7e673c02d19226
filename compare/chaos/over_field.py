"""What bifurcation diagrams share: something found at each value of a field, and its cells as a table."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.compare.chaos.sweep import with_field
from rattle.scene.scene import Scene

Floats = NDArray[np.float64]
T = TypeVar("T")


def over_field(
    scene: Scene,
    at: Sequence[float],
    field: str,
    noise: Callable[[Scene], Scene] | None,
    workers: int,
    found_at: Callable[[Scene], T],
) -> list[T]:
    """Evaluate something of a scene at each value of a field.

    `noise`: Maps each scene to the same with its noise set; without it, the noise of `scene` is used.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> over_field(Scene.from_gears(DAT21), (0.5, 1.0), "alpha", None, 1, lambda s: s.alpha)
    [0.5, 1.0]
    """

    def one(value: float) -> T:
        s = with_field(scene, field, value)
        return found_at(noise(s) if noise else s)

    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(one, at))


def cells_table(
    side: str, field: str, at: Floats, edges: Floats, what: str, cells: NDArray[np.float64 | np.int64], name: str
) -> pd.DataFrame:
    """Cells of a bifurcation diagram that are not empty.

    Shapes: `at` (values,); `edges` (bins + 1,); `cells` (values, bins).
    """
    i, j = np.nonzero(cells)
    middle = 0.5 * (edges[1:] + edges[:-1])
    return pd.DataFrame({"side": side, field: at[i], what: middle[j], name: cells[i, j]})
