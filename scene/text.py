r"""Text that a file, a name or a message has brought, made harmless before anybody sees it."""

import unicodedata

__all__ = ["harmless", "line"]

STEERING = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
"""Unicode's categories of what is no sign but an order to the terminal or to the reader's eye: control characters;
format characters, which turn the direction of the text around them or take no room; halves of surrogate pairs;
separators of lines and of paragraphs."""


def harmless(text: str, keep: str = "\n\t") -> str:
    r"""A text in which characters that steer are shown as escapes, in place of being obeyed.

    Parameters
    ----------
    text : str
    keep : str
        Control characters that may stay; line ends and tabs by default.

    Examples
    --------
    >>> print(harmless("\x1b[31mred, \u202eturned"))
    \x1b[31mred, \u202eturned
    """
    if text.isprintable():
        return text
    return "".join(
        c.encode("unicode_escape").decode() if unicodedata.category(c) in STEERING and c not in keep else c
        for c in text.replace("\r\n", "\n")
    )


def line(text: str) -> str:
    r"""A text on one line, harmless.

    Examples
    --------
    >>> print(line("one\n two\x1b[31m"))
    one two\x1b[31m
    """
    return " ".join(harmless(text).split())
