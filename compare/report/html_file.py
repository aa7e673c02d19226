"""HTML files that need no other: made from a template, with its style and its script inside."""

import base64
import hashlib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from rattle.scene.text import harmless

if TYPE_CHECKING:
    from jinja2 import Environment


def make_environment(package: str, escaped: bool) -> "Environment":
    """Jinja's environment for the templates of a package; all texts in it are without control characters."""
    from jinja2 import Environment, PackageLoader, StrictUndefined  # for what writes pages only

    return Environment(
        loader=PackageLoader(package),
        autoescape=escaped,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
        finalize=lambda value: harmless(value) if type(value) is str else value,
    )


def render_html(package: str, name: str, filters: Mapping[str, Any], /, **values: Any) -> str:
    """Render a package's template ``NAME.html.j2`` with ``NAME.css`` and ``NAME.js``, and no other style or script."""
    from markupsafe import Markup

    style, script = (_read_part(package, f"{name}.{kind}") for kind in ("css", "js"))
    policy = (
        f"default-src 'none'; img-src data:; style-src '{_hash(style)}'; script-src '{_hash(script)}'; "
        "base-uri 'none'; form-action 'none'"
    )
    environment = make_environment(package, True)
    environment.filters |= filters
    template = environment.get_template(f"{name}.html.j2")
    return template.render(policy=policy, style=Markup(style), script=Markup(script), **values)


@cache
def _read_part(package: str, name: str) -> str:
    return files(package).joinpath("templates", name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
