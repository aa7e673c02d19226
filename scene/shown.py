"""How objects show themselves: as Python text of a few lines, and as HTML for notebooks."""

import textwrap
from collections.abc import Mapping
from html import escape

WIDTH = 100


def as_call(name: str, arguments: Mapping[str, object], *, first: str = "") -> str:
    """Python text of a call, on as many lines as it needs.

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

    Examples
    --------
    >>> as_html("1 < 2")
    '<pre>1 &lt; 2</pre>'
    """
    return f"<pre>{escape(text)}</pre>{table}"
