"""How a text is written in each view, so that nothing in it can be taken for markup or for a command."""

import re

from markupsafe import Markup, escape

from rattle.scene.text import line

__all__ = ["as_code", "as_html", "as_markdown", "fence", "parts"]

CODE = re.compile(r"`([^`\n]+)`")


def parts(text: str) -> list[tuple[str, bool]]:
    """A text on one line in parts, and whether each is code.

    Examples
    --------
    >>> parts("see `a_b` there")
    [('see ', False), ('a_b', True), (' there', False)]
    """
    pieces = CODE.split(line(text))
    return [(piece, bool(i % 2)) for i, piece in enumerate(pieces) if piece]


def as_html(text: str) -> Markup:
    """A text as HTML, code between its backticks marked as such."""
    return Markup("").join(
        Markup("<code>{}</code>").format(piece) if code else escape(piece) for piece, code in parts(text)
    )


def as_markdown(text: str, cell: bool = False) -> str:
    r"""A text as Markdown; in the cell of a table a bar is escaped as well.

    Examples
    --------
    >>> print(as_markdown("# <b> *x* `a_b` a_b"))
    \# \<b> \*x\* `a_b` a_b
    """
    written = "".join(f"`{piece}`" if code else _escaped(piece) for piece, code in parts(text))
    if cell:
        return written.replace("|", r"\|")
    return re.sub(r"^(\d+)([.)])", r"\1\\\2", re.sub(r"^([#>+=-])", r"\\\1", written))  # no heading, no list


def _escaped(text: str) -> str:
    text = re.sub(r"([\\`*\[\]<&~$])", r"\\\1", text)
    return re.sub(r"(?<!\w)_|_(?!\w)", r"\\_", text)  # within a word it is no emphasis


def as_code(text: str) -> str:
    """A text as code within a line of Markdown, whatever backticks are in it.

    Examples
    --------
    >>> as_code("rattle validate"), as_code("a`b")
    ('`rattle validate`', '`` a`b ``')
    """
    text, ticks = line(text), "`" * (1 + _longest_run(text))
    return f"{ticks} {text} {ticks}" if "`" in text else f"`{text}`"


def _longest_run(text: str) -> int:
    return max((len(run) for run in re.findall("`+", text)), default=0)


def fence(text: str) -> str:
    """What encloses a block of code in Markdown: one backtick more than there are in it."""
    return "`" * max(3, 1 + _longest_run(text))
