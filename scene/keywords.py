"""Unknown keywords are refused with the nearest known one, as unknown keys of a file are, or with their new place."""

import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any, ParamSpec, TypeVar

from rattle.scene.errors import InputError
from rattle.scene.validate import check_keys

C = TypeVar("C")
P = ParamSpec("P")
R = TypeVar("R")


def suggesting(cls: type[C]) -> type[C]:
    """Make a class refuse an unknown keyword by an InputError that names the nearest known one.

    `cls`: The class; it is changed in place.  Its dictionary ``ELSEWHERE``, if it has one, says of keywords that
    people try here where they belong.

    Examples
    --------
    >>> @suggesting
    ... class Wheel:
    ...     def __init__(self, radius: float) -> None:
    ...         self.radius = radius
    >>> Wheel(raduis=41.0)
    Traceback (most recent call last):
    ...
    rattle.scene.errors.InputError: Wheel = 'raduis': unknown key; did you mean 'radius'?
    """
    made = cls.__init__
    names = tuple(inspect.signature(made).parameters)[1:]
    elsewhere = getattr(cls, "ELSEWHERE", {})

    @functools.wraps(made)
    def checked(self: Any, *args: Any, **given: Any) -> None:
        for name in given:
            if name in elsewhere:
                raise InputError(cls.__name__, name, elsewhere[name])
        check_keys(cls.__name__, given, names)
        made(self, *args, **given)

    setattr(cls, "__init__", checked)  # noqa: B010  (a method, by its type)
    return cls


def moved(elsewhere: Mapping[str, str]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Make a function refuse keywords that it once had by an InputError that says where they are now.

    Examples
    --------
    >>> @moved({"radius": "is now in wheel=Wheel(radius=...)"})
    ... def turn(wheel: object) -> None: ...
    >>> turn(radius=41.0)
    Traceback (most recent call last):
    ...
    rattle.scene.errors.InputError: radius = 41.0: is now in wheel=Wheel(radius=...)
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(function)
        def checked(*args: P.args, **given: P.kwargs) -> R:
            for name in elsewhere.keys() & given.keys():
                raise InputError(name, given[name], elsewhere[name])
            return function(*args, **given)

        return checked

    return decorate
