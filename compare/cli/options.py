"""Types of the options of the commands: whole numbers as people write them, and names from a list."""

from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from typing import Any

import click

from rattle.scene.validate import choice

SCHEMES = ("euler-maruyama", "euler-maruyama-located", "exact-flight")
CLOSURES = ("published", "corrected", "saltation", "branching")
FIELDS = ("alpha", "epsilon", "beta1", "beta2", "gamma1", "gamma2", "mu", "gap1", "gap2", "sigma")
AXES = ("beta", "gap", "sigma", "epsilon")
# Written out, for --help does not wait for the modules that define them; a test compares them.

MOST_DIGITS = 60


class WholeNumber(click.ParamType):  # type: ignore[type-arg]  # generic only since click 8.2
    """A whole number, also written as 1e5 or 100_000.

    Examples
    --------
    >>> WholeNumber().convert("1e5", None, None), WholeNumber().convert("2_000", None, None)
    (100000, 2000)
    """

    name = "integer"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Read a whole number."""
        if isinstance(value, int):
            return value
        text = str(value).strip()
        try:
            number = Decimal(text)
        except InvalidOperation:
            self.fail(f"{text!r} is not a whole number; write it as 100000, 100_000 or 1e5", param, ctx)
        if not number.is_finite() or number.adjusted() > MOST_DIGITS or number != number.to_integral_value():
            self.fail(f"{text!r} is not a whole number of at most {MOST_DIGITS} digits", param, ctx)
        return int(number)


WHOLE = WholeNumber()
"""The type of every option that takes a whole number."""


class Name(click.Choice):  # type: ignore[type-arg]  # generic only since click 8.2
    """A name from a list, which ``--help`` shows and the shell completes.

    Examples
    --------
    >>> Name("scheme", SCHEMES).convert("exact-fligt", None, None)
    Traceback (most recent call last):
    ...
    rattle.scene.errors.InputError: scheme = 'exact-fligt': did you mean 'exact-flight'?
    """

    def __init__(self, field: str, names: Sequence[str]) -> None:
        super().__init__(names)
        self.field = field

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Check a name."""
        return choice(self.field, value, self.choices)
