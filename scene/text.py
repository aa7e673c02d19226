r"""Text for terminals, pages and notebooks: control characters escaped, durations in words, objects
as Python text."""

import textwrap
import unicodedata
from collections.abc import Mapping
from decimal import Decimal
from html import escape

CONTROL = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
"""Unicode categories that are escaped: control characters (Cc); format characters (Cf), which
change the direction of text or are invisible; halves of surrogate pairs (Cs); line and paragraph
separators (Zl, Zp)."""


def harmless(text: str, keep: str = "\n\t") -> str:
    r"""Show control and formatting characters as escapes, so that a terminal or a page does not
    obey them."""
    if text.isprintable():
        return text
    return "".join(
        (
            c.encode("unicode_escape").decode()
            if unicodedata.category(c) in CONTROL and c not in keep
            else c
        )
        for c in text.replace("\r\n", "\n")
    )


def line(text: str) -> str:
    r"""Put a text on one line: white space collapsed, control characters escaped."""
    return " ".join(harmless(text).split())


def duration_text(seconds: float, digits: int = 3) -> str:
    """A duration in a convenient unit, to some digits."""
    units = {
        "s": 1.0,
        "minutes": 60.0,
        "h": 3600.0,
        "days": 24.0 * 3600.0,
        "years": 365.25 * 24.0 * 3600.0,
    }
    name = max(
        (n for n, size in units.items() if seconds >= 1.5 * size),
        key=lambda n: units[n],
        default="s",
    )
    if 0.0 < seconds < 0.1:
        return f"{float(f'{1e3 * seconds:.{digits}g}'):g} ms"
    return f"{float(f'{seconds / units[name]:.{digits}g}'):g} {name}"


TEXT_WIDTH = 100


def show(value: object) -> str:
    """A value as Python text, its numbers without the names of numpy's types."""
    text = repr(value)
    if "np." not in text:
        return text
    import numpy as np

    with np.printoptions(legacy="1.25"):
        return repr(value)


def as_call(name: str, arguments: Mapping[str, object], *, first: str = "") -> str:
    """Python text of a call, on as many lines as it needs."""
    listed = ", ".join(
        [first] * bool(first) + [f"{key}={show(value)}" for key, value in arguments.items()]
    )
    text = " ".join(f"{name}({listed})".split())
    return textwrap.fill(
        text, TEXT_WIDTH, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False
    )


def as_html(text: str, table: str = "") -> str:
    """Show a text, and a table below it, in a notebook."""
    return f"<pre>{escape(text)}</pre>{table}"


def number_text(value: float, digits: int) -> str:
    """A number to some digits, without an exponent where it is not needed."""
    return f"{float(f'{value:.{digits}g}'):,.6g}"


def percent(share: float, digits: int = 2) -> str:
    """A share in percent to some digits, without a power of ten.

    >>> percent(0.9996), percent(0.0123), percent(2.5e-6)
    ('100 %', '1.2 %', '0.00025 %')
    """
    return f"{Decimal(f'{100.0 * share:.{digits}g}'):f} %"
