"""Numpy's treatment of floating-point errors: the package computes under numpy's defaults, a user's
function under his.

``np.seterr(all="raise")`` in a program makes an exponential that underflows, which is nothing
wrong, an exception.
"""

import functools
import inspect
from collections.abc import Callable
from contextvars import ContextVar
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")

DEFAULTS: dict[str, Any] = {"divide": "warn", "over": "warn", "under": "ignore", "invalid": "warn"}
# the user's, while the package computes
_given: ContextVar[dict[str, Any] | None] = ContextVar("given", default=None)


def numpy_defaults(named: T) -> T:
    """Make a function, or a class with its methods and properties, compute under numpy's default
    treatment of errors.

    `named`: What a user calls; a class is changed in place, without what it inherits.
    """
    if not inspect.isclass(named):
        return _under_defaults(named)  # type: ignore[arg-type, return-value]
    for name, member in list(vars(named).items()):
        if isinstance(member, property):
            setattr(named, name, property(_under_defaults(member.fget), doc=member.__doc__))  # type: ignore[arg-type]
        elif isinstance(member, functools.cached_property):
            member.func = _under_defaults(member.func)
        elif inspect.isfunction(member) and (
            name in ("__repr__", "_repr_html_") or not name.startswith("_")
        ):
            setattr(named, name, _under_defaults(member))
    return named


def _under_defaults(function: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(function)
    def compute(*args: Any, **options: Any) -> Any:
        if _given.get() is not None:  # called by the package itself
            return function(*args, **options)
        token = _given.set(dict(np.geterr()))
        try:
            with np.errstate(**DEFAULTS):
                return function(*args, **options)
        finally:
            _given.reset(token)

    return compute


def call_users(function: Callable[..., Any], *args: Any) -> Any:
    """Call a function of the user's under his own settings, which hold again for what it calls of
    the package."""
    given = _given.get()
    if given is None:  # in a thread of its own, where numpy's defaults hold for him too
        return function(*args)
    token = _given.set(None)
    try:
        with np.errstate(**given):
            return function(*args)
    finally:
        _given.reset(token)
