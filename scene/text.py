r"""Escaping of control characters in text from files, names and messages, before it is printed or written to a page."""

import unicodedata

CONTROL = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
"""Unicode categories that are escaped: control characters (Cc); format characters (Cf), which change the direction of
text or are invisible; halves of surrogate pairs (Cs); line and paragraph separators (Zl, Zp)."""


def harmless(text: str, keep: str = "\n\t") -> str:
    r"""Show control and formatting characters as escapes, so that a terminal or a page does not obey them.

    Examples
    --------
    >>> print(harmless("\x1b[31mred, \u202eturned"))
    \x1b[31mred, \u202eturned
    """
    if text.isprintable():
        return text
    return "".join(
        c.encode("unicode_escape").decode() if unicodedata.category(c) in CONTROL and c not in keep else c
        for c in text.replace("\r\n", "\n")
    )


def line(text: str) -> str:
    r"""Put a text on one line: white space collapsed, control characters escaped.

    Examples
    --------
    >>> print(line("one\n two\x1b[31m"))
    one two\x1b[31m
    """
    return " ".join(harmless(text).split())
