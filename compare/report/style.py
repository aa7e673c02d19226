"""What all figures share: colours, markers, symbols, a legend above the panels, the same bytes for the same figure."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

__all__ = ["ACCURATE", "FORBIDDEN", "STYLE", "SYMBOL", "caption_of", "legend_above", "new_figure", "save"]

# Okabe and Ito's palette: told apart with every common colour vision, and by marker as well.
STYLE: Any = {
    "published": {"color": "#D55E00", "marker": "s"},
    "corrected": {"color": "#0072B2", "marker": "o"},
    "saltation": {"color": "#009E73", "marker": "^"},
    "branching": {"color": "#E69F00", "marker": "v"},
    "monte carlo": {"color": "#000000", "marker": "D"},
}
ACCURATE, FORBIDDEN = "#56B4E9", "#CC79A7"
SYMBOL = {
    "tau": r"$\tau$",
    "flight": r"$\Delta\tau$",
    "x1": "$x_1$",
    "y1": "$y_1$",
    "x2": "$x_2$",
    "y2": "$y_2$",
    "rho1": r"$\rho_1$",
    "rho2": r"$\rho_2$",
}

SETTINGS: Any = {
    "svg.hashsalt": "rattle",
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
}


def new_figure(width: float, height: float, rows: int, columns: int) -> tuple[Figure, list[Axes]]:
    """A figure of so many inches with rows times columns of panels, listed row by row."""
    with mpl.rc_context(SETTINGS):
        figure = Figure(figsize=(width, height), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False)
    return figure, list(axes.ravel())


def legend_above(figure: Figure, axes: Sequence[Axes], columns: int) -> None:
    """One legend for all panels, above them."""
    gathered: dict[str, Artist] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            gathered.setdefault(label, handle)
    figure.legend(list(gathered.values()), list(gathered), loc="outside upper center", ncols=columns)


def caption_of(figure: Figure, parts: Sequence[tuple[str, str]]) -> str:
    """What is said beneath a figure: those parts whose word its legend has; an empty word is always said.

    Examples
    --------
    >>> figure, (ax,) = new_figure(2.0, 2.0, 1, 1)
    >>> _ = ax.plot([0.0, 1.0], label="closure")
    >>> legend_above(figure, [ax], 1)
    >>> caption_of(figure, (("Means", ""), (" of the closure", "closure"), (" and of the paths", "Monte"), (".", "")))
    'Means of the closure.'
    """
    drawn = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    return "".join(said for said, word in parts if any(word in label for label in drawn) or not word)


def save(figure: Figure, path: Path) -> None:
    """Write a figure as SVG, the same bytes for the same figure."""
    with mpl.rc_context(SETTINGS):
        figure.savefig(path, format="svg", metadata={"Date": None})
