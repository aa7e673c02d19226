"""Common style of all figures: colours, markers, symbols, legends, and reproducible SVG files."""

from collections.abc import Iterable, Sequence
from importlib.resources import files
from io import BytesIO
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from rattle.closure import CLOSURES
from rattle.compare.report.texts import REPORT_TEXTS
from rattle.scene import Floats, state_names
from rattle.scene.changes import unit_of_value, words_of_value
from rattle.scene.plot import ShownFigure
from rattle.scene.types import MOST_WHEELS
from rattle.scene.words import PAIR, Words

OWN_COLORS = ("#882255", "#332288", "#999933", "#117733", "#AA4499", "#661100")
OWN_MARKERS = "P*Xhp8"


class Styles(dict[str, Any]):
    """Colour and marker by the name of a closure; those of one's own get the next ones when they
    are first drawn."""

    def __missing__(self, name: str) -> Any:
        number = len(self) - len(CLOSURES) - 1
        self[name] = {
            "color": OWN_COLORS[number % len(OWN_COLORS)],
            "marker": OWN_MARKERS[number % len(OWN_MARKERS)],
        }
        return self[name]


# Palette of Okabe and Ito, which remains distinguishable with colour vision deficiencies; markers
# differ as well.
STYLE = Styles(
    {name: {"color": closure.color, "marker": closure.marker} for name, closure in CLOSURES.items()}
)
STYLE["monte carlo"] = {"color": "#000000", "marker": "D"}
ACCURATE_COLOUR = "#56B4E9"
FORBIDDEN = "#CC79A7"
SYMBOL = {"tau": r"$\tau$", "flight": r"$\Delta\tau$"}
SYMBOL |= {f"rho{i}": rf"$\rho_{{{i}}}$" for i in range(1, MOST_WHEELS + 1)}
SYMBOL |= {name: f"${name[0]}_{{{name[1:]}}}$" for name in state_names(MOST_WHEELS)}

VALUE_LABELS: dict[str, str] = REPORT_TEXTS["labels"]
"""Axis labels of the values that have a symbol."""

FIGURE_SETTINGS: Any = mpl.rc_params_from_file(
    str(files("rattle.compare.report") / "templates" / "figures.mplstyle"),
    use_default_template=False,
)


def axis_label(name: str) -> str:
    """Axis label of a value of a scene or of its gears, with its unit."""
    words = words_of_value(name) or name
    unit = unit_of_value(name)
    return VALUE_LABELS.get(name, f"{words}, {unit}" if unit else words)


def new_figure(
    width: float, height: float, rows: int = 1, columns: int = 1
) -> tuple[Figure, list[Axes]]:
    """A figure with a grid of panels."""
    with mpl.rc_context(FIGURE_SETTINGS):
        figure = ShownFigure(figsize=(width, height), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False)
    return figure, list(axes.ravel())


def new_panels(
    number: int,
    most_columns: int,
    width: float,
    height: float,
    beside: float = 0.0,
    above: float = 0.0,
) -> tuple[Figure, list[Axes]]:
    """A figure of some panels of one size, in rows of so many at most, with room for labels beside
    them and for a legend above."""
    columns = min(number, most_columns)
    rows = -(-number // columns)
    figure, axes = new_figure(beside + width * columns, above + height * rows, rows, columns)
    for ax in axes[number:]:
        ax.set_visible(False)
    return figure, axes[:number]


def legend_above(figure: Figure, columns: int, axes: Sequence[Axes] = ()) -> None:
    """Add one legend for all panels, or for some, above them; equal labels are shown once."""
    handles: dict[str, Artist] = {}
    for ax in axes or figure.axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    for most in range(columns, 0, -1):
        legend = figure.legend(
            list(handles.values()), list(handles), loc="outside upper center", ncols=most
        )
        if most == 1 or legend.get_window_extent().width <= figure.bbox.width:
            break
        legend.remove()


def plain_numbers(axis: Axis, values: Iterable[float]) -> None:
    """Put plain numbers at a logarithmic axis of some values, enough of them over few decades."""
    shown = sorted(values)
    if shown[-1] < 100.0 * shown[0]:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def cell_edges(places: Floats) -> Floats:
    """Edges of the cells around places on a logarithmic axis."""
    middle = np.sqrt(places[1:] * places[:-1])
    first = places[0] ** 2 / middle[0]
    last = places[-1] ** 2 / middle[-1]
    return np.concatenate([[first], middle, [last]])


def error_bars(rows: pd.DataFrame, column: str = "value") -> Any:
    """How far the intervals of a table reach below and above a column; shape (2, rows)."""
    return np.abs(rows[["low", "high"]].to_numpy().T - rows[column].to_numpy())


def whole_impacts(ax: Axes) -> None:
    """Put the ticks of the horizontal axis at whole numbers of impacts."""
    ax.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))


def caption_of(figure: Figure, parts: Iterable[tuple[str, str]]) -> str:
    """The caption of a figure: the texts whose word is in a label of its legends, or empty."""
    drawn = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    return "".join(
        text for text, word in parts if any(word in label for label in drawn) or not word
    )


def render(figure: Figure, words: Words = PAIR) -> bytes:
    """Draw a figure as SVG, its texts in the words of a scene; equal figures give equal files."""
    drawn = BytesIO()
    # looking for the texts makes the ticks, which nothing else may change
    for text in figure.findobj(Text) if words.changes else ():
        text.set_text(words.put_into(text.get_text()))
    with mpl.rc_context(FIGURE_SETTINGS):
        figure.savefig(drawn, format="svg", metadata={"Date": None})
    return drawn.getvalue()
