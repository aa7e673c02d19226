"""How objects show themselves: as Python text of a few lines, and as HTML for notebooks."""

import textwrap
from collections.abc import Mapping
from html import escape

__all__ = ["as_call", "as_html"]

WIDTH = 100


def as_call(name: str, arguments: Mapping[str, object], *, first: str = "") -> str:
    """Python text of a call, on as many lines as it needs.

    Parameters
    ----------
    name : str
        What is called.
    arguments : mapping of str to object
        Its keyword arguments.
    first : str
        Text of a positional argument before them.

    Returns
    -------
    str
        The text; continued lines are indented.

    Examples
    --------
    >>> as_call("Start", {"tau": 0.0, "mesh": 1})
    'Start(tau=0.0, mesh=1)'
    """
    listed = ", ".join([first] * bool(first) + [f"{key}={value!r}" for key, value in arguments.items()])
    text = " ".join(f"{name}({listed})".split())
    return textwrap.fill(text, WIDTH, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)


def as_html(text: str, table: str = "") -> str:
    """Show a text, and a table below it, in a notebook.

    Parameters
    ----------
    text : str
        Plain text; it is escaped.
    table : str
        HTML.

    Returns
    -------
    str
        HTML.

    Examples
    --------
    >>> as_html("1 < 2")
    '<pre>1 &lt; 2</pre>'
    """
    return f"<pre>{escape(text)}</pre>{table}"
