"""Input validation: each check returns the value it was given, or raises an InputError that says what to change."""

import math
from collections.abc import Iterable
from difflib import get_close_matches
from numbers import Integral, Real

from rattle.scene.errors import InputError


def finite(field: str, value: object) -> float:
    """Check for a finite real number; booleans and strings are refused."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputError(field, value, "give a number")
    try:
        number = float(value)
    except OverflowError:  # an integer or a fraction beyond the floats
        number = math.inf
    if not math.isfinite(number):
        raise InputError(field, value, "give a finite number")
    return number


def positive(field: str, value: float) -> float:
    """Check for a finite number above zero."""
    if not finite(field, value) > 0.0:
        raise InputError(field, value, "must be greater than 0")
    return value


def non_negative(field: str, value: float) -> float:
    """Check for a finite number, zero or above."""
    if not finite(field, value) >= 0.0:
        raise InputError(field, value, "must be 0 or greater")
    return value


def unit_interval(field: str, value: float) -> float:
    """Check for a number between 0 and 1, both allowed."""
    if not 0.0 <= finite(field, value) <= 1.0:
        raise InputError(field, value, "must lie between 0 and 1")
    return value


def check_range(field: str, value: float, least: float, most: float, zero: bool = True) -> float:
    """Check that the absolute value of a number lies within bounds, or is 0 where that is allowed.

    Examples
    --------
    >>> check_range("alpha", 1e200, 1e-30, 1e6)
    Traceback (most recent call last):
    ...
    rattle.scene.errors.InputError: alpha = 1e+200: must be 0 or between 1e-30 and 1e+06 in size
    """
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
    """The end of an error message about an unknown name: the closest valid one, or all of them."""
    names = list(valid)
    close = get_close_matches(word[:100], names, n=1)
    return f"did you mean {close[0]!r}?" if close else "valid are " + ", ".join(map(repr, names))


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
            raise InputError(where, key, f"unknown key; {nearest(key if isinstance(key, str) else '', names)}")
