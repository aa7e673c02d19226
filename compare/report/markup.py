"""Escaping of texts for each view, so that nothing in them is interpreted as markup or as a terminal command."""

import re
from collections.abc import Callable, Collection
from typing import TypeAlias

from markupsafe import Markup, escape

from rattle.scene.text import line

CODE = re.compile(r"`([^`\n]+)`")
Words: TypeAlias = Callable[[str, bool], Markup]


def parts(text: str) -> list[tuple[str, bool]]:
    """Split a text at its backticks.

    Examples
    --------
    >>> parts("see `a_b` there")
    [('see ', False), ('a_b', True), (' there', False)]
    """
    pieces = CODE.split(line(text))
    return [(piece, bool(i % 2)) for i, piece in enumerate(pieces) if piece]


def _escape_only(piece: str, _: bool) -> Markup:
    return escape(piece)


def as_html(text: str, files: Collection[str] = (), words: Words = _escape_only) -> Markup:
    """A text as HTML; code between backticks becomes a ``<code>`` element.

    `files`: Names of files beside the page; code that is such a name becomes a link to the file. `words`: Makes a
    piece of the text HTML, and is told whether it is code; see `rattle.compare.report.terms`.

    Examples
    --------
    >>> as_html("see `a.csv`", ["a.csv"])
    Markup('see <a href="a.csv"><code>a.csv</code></a>')
    """

    def render(piece: str, code: bool) -> Markup:
        if not code:
            return words(piece, False)
        if piece in files:
            return Markup('<a href="{0}"><code>{0}</code></a>').format(piece)
        return Markup("<code>{}</code>").format(words(piece, True))

    return Markup("").join(render(piece, code) for piece, code in parts(text))


def as_markdown(text: str, cell: bool = False, files: Collection[str] = ()) -> str:
    r"""A text as Markdown that shows it literally.

    Examples
    --------
    >>> print(as_markdown("# <b> *x* `a_b` a_b"))
    \# \<b> \*x\* `a_b` a_b
    """
    written = "".join(
        (f"[`{piece}`]({piece})" if piece in files else f"`{piece}`") if code else _escape(piece)
        for piece, code in parts(text)
    )
    if cell:
        return written.replace("|", r"\|")
    return re.sub(r"^(\d+)([.)])", r"\1\\\2", re.sub(r"^([#>+=-])", r"\\\1", written))  # no heading, no list


def _escape(text: str) -> str:
    text = re.sub(r"([\\`*\[\]<&~$])", r"\\\1", text)
    return re.sub(r"(?<!\w)_|_(?!\w)", r"\\_", text)  # within a word it is no emphasis


def as_code(text: str) -> str:
    """A text as inline code in Markdown, with as many backticks around it as its own require.

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
    """The fence around a block of code in Markdown: one backtick more than the longest run in it, at least three."""
    return "`" * max(3, 1 + _longest_run(text))
