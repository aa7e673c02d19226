"""Formulas as MathML, which browsers draw by themselves: the site needs neither a network nor a
script for them."""

import re
from itertools import cycle
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx

__all__ = ["setup"]

REWRITTEN = (
    (re.compile(r"\\t?frac(\d)(\d)"), r"\\frac{\1}{\2}"),
    (re.compile(r"\\tfrac\b"), r"\\frac"),
    (re.compile(r"\\(d?dot)\s*(\\[a-zA-Z]+|[a-zA-Z])_(\w)"), r"\\\1{\2_\3}"),
    (re.compile(r"\\(sin|cos|ln|exp)\b(?!\^)"), r"\\,\\\1\\,"),
)
"""What docutils would set wrongly, and what it sets as meant."""
BAR = re.compile(r'<mo stretchy="false">\|</mo>')


def drawn(formula: str, as_block: bool) -> str:
    """A formula as MathML."""
    for pattern, replacement in REWRITTEN:
        formula = pattern.sub(replacement, formula)
    # an opening bar has no room on its inner side, nor has a closing one
    ends = cycle(("prefix", "postfix"))
    return BAR.sub(
        lambda _: f'<mo form="{next(ends)}" stretchy="false">|</mo>',
        tex2mathml(formula, as_block=as_block),
    )


def inline(self: Any, node: nodes.math) -> None:
    """Write a formula within a line."""
    self.body.append(drawn(node.astext(), False))
    raise nodes.SkipNode


def block(self: Any, node: nodes.math_block) -> None:
    """Write a formula of its own; a blank line between two of them separates two formulas."""
    self.body.append(self.starttag(node, "div", CLASS="formula"))
    for formula in node.astext().split("\n\n"):
        self.body.append(drawn(formula, True))
    self.body.append("</div>")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer and choose it."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    app.config.html_math_renderer = "mathml"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
