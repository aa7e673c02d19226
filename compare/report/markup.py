"""Escaping of texts for each view, so that nothing in them is interpreted as markup or as a terminal command."""

import re

from markupsafe import Markup, escape

from rattle.scene.text import line

__all__ = ["as_code", "as_html", "as_markdown", "fence", "parts"]

CODE = re.compile(r"`([^`\n]+)`")


def parts(text: str) -> list[tuple[str, bool]]:
    """Split a text at its backticks.

    Parameters
    ----------
    text : str

    Returns
    -------
    list of (str, bool)
        Pieces, on one line and without control characters, and whether each is code.

    Examples
    --------
    >>> parts("see `a_b` there")
    [('see ', False), ('a_b', True), (' there', False)]
    """
    pieces = CODE.split(line(text))
    return [(piece, bool(i % 2)) for i, piece in enumerate(pieces) if piece]


def as_html(text: str) -> Markup:
    """A text as HTML; code between backticks becomes a ``<code>`` element.

    Parameters
    ----------
    text : str

    Returns
    -------
    Markup
    """
    return Markup("").join(
        Markup("<code>{}</code>").format(piece) if code else escape(piece) for piece, code in parts(text)
    )


def as_markdown(text: str, cell: bool = False) -> str:
    r"""A text as Markdown that shows it literally.

    Parameters
    ----------
    text : str
    cell : bool
        Whether it stands in a table, where vertical bars must be escaped as well.

    Returns
    -------
    str

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
    """A text as inline code in Markdown, with as many backticks around it as its own require.

    Parameters
    ----------
    text : str

    Returns
    -------
    str

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
    """The fence around a block of code in Markdown: one backtick more than the longest run in it, at least three.

    Parameters
    ----------
    text : str
        The code.

    Returns
    -------
    str
    """
    return "`" * max(3, 1 + _longest_run(text))
