"""What bifurcation diagrams share: something found at each value of a field, and its cells as a table."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from rattle.compare.chaos.sweep import with_field
from rattle.scene.scene import Scene

__all__ = ["cells_table", "over_field"]

Floats = NDArray[np.float64]
T = TypeVar("T")


def over_field(
    scene: Scene, at: Sequence[float], field: str, noise: Callable[[Scene], Scene] | None, workers: int,
    found_at: Callable[[Scene], T],
) -> list[T]:  # fmt: skip
    """Evaluate something of a scene at each value of a field.

    Parameters
    ----------
    scene : Scene
        All fields besides the one that varies.
    at : sequence of float
        Values of the field.
    field : str
        One of `rattle.compare.chaos.sweep.FIELDS`.
    noise : callable or None
        Maps each scene to the same with its noise set; without it, the noise of `scene` is used.
    workers : int
        Threads; the result does not depend on it.
    found_at : callable
        What is evaluated.

    Returns
    -------
    list
        In the order of the values.

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

    Parameters
    ----------
    side, field : str
        Of the diagram.
    at : ndarray, shape (values,)
        Values of the field.
    edges : ndarray, shape (bins + 1,)
        Of the quantity.
    what, name : str
        The quantity, and what is in its cells.
    cells : ndarray, shape (values, bins)
        Content of the cells.

    Returns
    -------
    DataFrame
        Columns ``side``, the field, the quantity (middle of the cell), and the content.
    """
    i, j = np.nonzero(cells)
    middle = 0.5 * (edges[1:] + edges[:-1])
    return pd.DataFrame({"side": side, field: at[i], what: middle[j], name: cells[i, j]})
