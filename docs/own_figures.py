"""Pictures of the gallery's figures that pyplot does not know, beside those that it does."""

from typing import Any

from sphinx_gallery.scrapers import figure_rst

from rattle.scene.plot import ShownFigure

__all__ = ["scrape"]


def scrape(block: Any, variables: dict[str, Any], settings: dict[str, Any]) -> str:
    """Save the figures among the variables of a script; returns the lines that show them."""
    paths = []
    for figure in (v for v in variables["example_globals"].values() if isinstance(v, ShownFigure)):
        paths.append(next(variables["image_path_iterator"]))
        figure.savefig(paths[-1], dpi=200)
    return figure_rst(paths, settings["src_dir"])
