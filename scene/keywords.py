"""Unknown keywords of a class are refused with the nearest known one, as unknown keys of a file are."""

import functools
import inspect
from typing import Any, TypeVar

from rattle.scene.errors import InputError
from rattle.scene.validate import check_keys

C = TypeVar("C")


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
