"""Pictures of the gallery's figures that pyplot does not know, beside those that it does."""

from pathlib import Path
from typing import Any

from sphinx_gallery.scrapers import figure_rst

from rattle.scene.plot import ShownFigure

__all__ = ["scrape"]

DPI = 100  # as pyplot's; a second picture has twice as many, for screens that show them


def scrape(block: Any, variables: dict[str, Any], settings: dict[str, Any]) -> str:
    """Save the figures among the variables of a script; returns the lines that show them."""
    paths = []
    sharper = []
    for figure in (v for v in variables["example_globals"].values() if isinstance(v, ShownFigure)):
        path = Path(next(variables["image_path_iterator"]))
        twice = path.with_name(f"{path.stem}_2_00x{path.suffix}")
        figure.savefig(path, dpi=DPI)
        figure.savefig(twice, dpi=2 * DPI)
        paths.append(path)
        sharper.append({0: path, 2.0: twice})
    return figure_rst(paths, settings["src_dir"], srcsetpaths=sharper)
