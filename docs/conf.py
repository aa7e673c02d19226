"""The documentation site: ``make docs`` builds it into docs/_build, without a network and with
warnings as errors."""

import os
import sys
from importlib.metadata import version as version_of
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx_gallery.directives import imgsgnode

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE / "results"), str(HERE.parent / "tests" / "helpers")]


project = "rattle"
author = "the rattle developers"
copyright = author
html_title = "rattle"
extensions = [
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_gallery.gen_gallery",
    "command_help",
    "facts",
    "mathml",
    "tables",
]
exclude_patterns = [
    "**/*.table.md",
    "_build",
    "gallery",
    "templates",
    "auto_gallery/*.py",
    "auto_gallery/*.ipynb",
]
templates_path = ["templates"]
default_role = "py:obj"

# A reference that leads nowhere ends the build, but for these.
nitpicky = True
nitpick_ignore_regex = [
    ("py:obj", r"[a-z_]\w*"),  # parameters, between single backticks as numpydoc has them
    ("py:obj", r"(Scene|Orbit|Ensemble)\.\w+"),  # members, in docstrings of other modules
]
nitpick_ignore = [  # modules and functions that are no part of the reference
    ("py:obj", f"rattle.{name}")
    for name in (
        "compare.validation.errors.judge_correlation",
        "montecarlo.diagnostics.diagnostics",
        "montecarlo.schemes.sticking",
        "montecarlo.statistics.section_statistics.FEWEST_FOR_ERROR",
        "scene.gears_table",
        "scene.impact.energy_loss",
        "scene.plausible",
    )
]

# Pages are MyST; those with code cells are run when the site is built, and an error in one ends the
# build.
myst_enable_extensions = ["dollarmath", "amsmath", "deflist", "colon_fence"]
myst_heading_anchors = 3
os.environ["TQDM_DISABLE"] = "1"  # no bars on pages
os.environ["RATTLE_REPOSITORY"] = str(HERE.resolve().parent)  # whose examples cells load
# cells run the commands of this environment
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_in_temp = True
nb_execution_timeout = 900
nb_execution_show_tb = True
nb_merge_streams = True

# Docstrings are numpydoc; types stand in their sections, so signatures are short.
autosummary_generate = True
autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_class_members_toctree = False
numpydoc_show_class_members = False

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "auto_gallery",
    "filename_pattern": r"plot_",
    "image_scrapers": ("matplotlib", "own_figures.scrape"),
    "matplotlib_animations": False,
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_memory": False,
    "abort_on_example_error": True,
    "within_subsection_order": "FileNameSortKey",
    "show_signature": False,
    "write_computation_times": False,  # its page asks another host for a script
    "image_srcset": ["2x"],
    "thumbnail_size": (800, 560),
}

# No page asks for anything beyond its own folder.
html_theme = "pydata_sphinx_theme"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["animation-height.js"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navbar_end": ["theme-switcher"],
    "secondary_sidebar_items": ["page-toc"],
    "header_links_before_dropdown": 8,
    "show_prev_next": False,
    "footer_start": ["copyright"],
    "footer_end": [],
}
html_sidebars = {"index": [], "start": [], "auto_gallery/*": []}
html_context = {"default_mode": "auto"}

# Committed tables and figures that the pages show; tests give a folder of their own.
rattle_reports = os.environ.get("RATTLE_REPORTS", str(HERE.parent / "reports"))

release = version = version_of("rattle")


def frame_pictures(app: Sphinx, doctree: nodes.document) -> None:
    """Give each picture of the gallery a frame, in which it scrolls on a narrow screen
    (site.css)."""
    for picture in list(doctree.findall(imgsgnode)):
        frame = nodes.container(classes=["picture"])
        picture.replace_self(frame)
        frame += picture


def setup(app: Sphinx) -> None:
    """Register it."""
    app.connect("doctree-read", frame_pictures)
