"""Formulas as MathML, which browsers draw by themselves: the site needs neither a network nor a script for them."""

from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx

__all__ = ["setup"]

BLOCKS = ("aligned", "align", "gather", "\\\\")


def inline(self: Any, node: nodes.math) -> None:
    """Write a formula within a line."""
    self.body.append(tex2mathml(node.astext(), as_block=False))
    raise nodes.SkipNode


def block(self: Any, node: nodes.math_block) -> None:
    """Write a formula of its own; a blank line between two of them separates two formulas."""
    self.body.append(self.starttag(node, "div", CLASS="math"))
    for formula in node.astext().split("\n\n"):
        self.body.append(tex2mathml(formula, as_block=True))
    self.body.append("</div>")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer and choose it."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    app.config.html_math_renderer = "mathml"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
