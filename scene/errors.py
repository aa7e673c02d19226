"""The exceptions of the project, and the input validation that raises them; each message names
field, value, remedy.

A check returns the value that it was given, or raises an InputError that says what to change.
"""

import functools
import inspect
import math
from collections.abc import Iterable
from dataclasses import fields
from difflib import SequenceMatcher, get_close_matches
from numbers import Integral, Real
from typing import Any, TypeVar

from rattle.scene.text import harmless, show

C = TypeVar("C")

LONGEST_QUOTE = 300  # most characters of a value that a message quotes


class RattleError(Exception):
    """Base of every error that this project raises on purpose; control characters in its message
    are escaped."""

    def __init__(self, message: str) -> None:
        super().__init__(harmless(message))


class InputError(RattleError, ValueError):
    """An input value that is not admissible.

    Parameters
    ----------
    field : str
        Name of the offending field, as the caller spells it.
    value : object
        The value that was given.
    remedy : str
        What to change, as a sentence without its first capital.
    where : str, optional
        The file that holds it, and the line if it is known.

    Examples
    --------
    >>> print(InputError("epsilon", 1.2, "give a restitution between 0 and 1"))
    epsilon = 1.2: give a restitution between 0 and 1
    """

    def __init__(self, field: str, value: object, remedy: str, where: str = "") -> None:
        super().__init__(
            harmless(f"{where}{': ' * bool(where)}{field} = {_show(value)}: {remedy}", keep="")
        )
        self.field = field
        self.value = value
        self.remedy = remedy
        self.where = where

    def __reduce__(self) -> tuple[type["InputError"], tuple[str, object, str, str]]:
        return type(self), (self.field, self.value, self.remedy, self.where)  # for worker processes


def _show(value: object) -> str:
    """A value as it was given, cut to `LONGEST_QUOTE` characters."""
    try:
        text = show(value)
    except Exception:  # a whole number of too many digits, or an object of the user's own
        text = f"<{type(value).__name__}>"
    return text if len(text) <= LONGEST_QUOTE else text[: LONGEST_QUOTE - 3] + "..."


class FileError(InputError):
    """An input file that cannot be read, or whose content is not valid."""


class OutputError(RattleError, OSError):
    """An output folder that cannot be written, or only by overwriting something."""


class BudgetEnded(BaseException):
    """The budget ended before there is a result; no ``except Exception`` of a function of one's own
    catches it."""


def finite(field: str, value: object) -> float:
    """Check for a finite real number; booleans and strings are refused."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputError(field, value, "give a number")
    try:
        number = float(value)
    except OverflowError:  # a whole number or a fraction beyond the range of floats
        number = math.inf
    if not math.isfinite(number):
        raise InputError(field, value, "give a finite number")
    return number


def take_numbers(part: object, place: str, *names: str) -> None:
    """Make fields of a part of a scene floats, or refuse what is no finite number."""
    for name in names:
        object.__setattr__(part, name, finite(f"{place}.{name}", getattr(part, name)))


def positive(field: str, value: float, least: float = 0.0, most: float = math.inf) -> float:
    """Check for a finite number above zero, and within bounds."""
    if not finite(field, value) > 0.0:
        raise InputError(field, value, "must be greater than 0")
    return check_range(field, value, least, most, zero=False)


def non_negative(field: str, value: float, least: float = 0.0, most: float = math.inf) -> float:
    """Check for a finite number that is zero, or above it and within bounds."""
    if not finite(field, value) >= 0.0:
        raise InputError(field, value, "must be 0 or greater")
    return check_range(field, value, least, most)


def unit_interval(field: str, value: float) -> float:
    """Check for a number between 0 and 1, both allowed."""
    if not 0.0 <= finite(field, value) <= 1.0:
        raise InputError(field, value, "must lie between 0 and 1")
    return value


def check_range(field: str, value: float, least: float, most: float, zero: bool = True) -> float:
    """Check that the absolute value of a number lies within bounds, or is 0 where that is
    allowed."""
    size = abs(finite(field, value))
    if not least <= size <= most and not (zero and size == 0.0):
        zeros = "0 or " if zero and least > 0.0 else ""
        raise InputError(field, value, f"must be {zeros}between {least:g} and {most:g} in size")
    return value


def count(field: str, value: object, least: int = 1, most: int | None = None) -> int:
    """Check for a whole number of at least `least` (and at most `most`)."""
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise InputError(field, value, "give a whole number")
    number = int(value)
    if number < least:
        raise InputError(field, value, f"must be at least {least}")
    if most is not None and number > most:
        raise InputError(field, value, f"must be at most {most}")
    return number


def nearest(word: str, valid: Iterable[str]) -> str:
    """The end of an error message about an unknown name: the closest valid ones, where several are
    as close, or all."""
    names = list(valid)
    plain = {name.casefold(): name for name in names}
    match = SequenceMatcher(b=word[:100].casefold())
    close = {}
    for name in get_close_matches(word[:100].casefold(), plain):
        match.set_seq1(name)
        close[plain[name]] = match.ratio()
    best = [name for name, likeness in close.items() if likeness == max(close.values())]
    return (
        f"did you mean {' or '.join(map(repr, sorted(best)))}?"
        if best
        else f"valid are {', '.join(map(repr, names))}"
    )


def choice(field: str, value: object, valid: Iterable[str]) -> str:
    """Check for one of a set of names."""
    names = list(valid)
    if not isinstance(value, str) or value not in names:
        raise InputError(field, value, nearest(value if isinstance(value, str) else "", names))
    return value


def check_keys(where: str, given: Iterable[str], valid: Iterable[str]) -> None:
    """Refuse a key that is not among the valid ones, and name the closest."""
    names = list(valid)
    for key in given:
        if not isinstance(key, str) or key not in names:
            raise InputError(
                where, key, f"unknown key; {nearest(key if isinstance(key, str) else '', names)}"
            )


def table_in(name: str, value: object, kind: Any = None) -> dict[str, Any]:
    """A table of a file, with no other keys than the fields of its kind, if it has one."""
    if not isinstance(value, dict):
        raise InputError(name, value, f"write it as a table: [{name}]")
    if kind is not None:
        check_keys(name, value, (f.name for f in fields(kind)))
    return dict(value)


def suggesting(cls: type[C]) -> type[C]:
    """Make a class refuse an unknown keyword by an InputError that names the nearest known one.

    `cls`: The class; it is changed in place.  Its dictionary ``ELSEWHERE``, if it has one, says of
    keywords that people try here where they belong.
    """
    made = cls.__init__
    names = tuple(inspect.signature(made).parameters)[1:]
    elsewhere = getattr(cls, "ELSEWHERE", {})

    @functools.wraps(made)
    def check(self: Any, *args: Any, **given: Any) -> None:
        for name in given:
            if name in elsewhere:
                raise InputError(cls.__name__, name, elsewhere[name])
        check_keys(cls.__name__, given, names)
        made(self, *args, **given)

    setattr(cls, "__init__", check)  # noqa: B010  (a method, by its type)
    return cls
