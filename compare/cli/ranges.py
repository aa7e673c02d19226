"""The one spelling of a range of values: ``NAME=LOW:HIGH[:POINTS[:log]]``, or ``NAME`` alone."""

from typing import NamedTuple

import click
import numpy as np

from rattle.scene import InputError, Scene, choice, count, finite, positive

SPELLING = "NAME=LOW:HIGH[:POINTS]"
EXAMPLE = "torque1=20:200:12"
RANGE_DIGITS = 3  # of values spaced evenly in their logarithm, but for both ends

RENAMED = {
    "--between": f"--over {SPELLING}",
    "--reach": f"--and {SPELLING}",
    "--values": f"--and {SPELLING}",
    "--field": f"--over {SPELLING}",
    "--points": f"--over {SPELLING}",
    "--validity": "--over sigma=LOW:HIGH[:POINTS]",
}
"""Options that said a range before there was one spelling, and how they are written now."""


class Range(NamedTuple):
    """A range of values of a parameter, as it was typed."""

    name: str
    ends: tuple[float, float] | None  # None for a name alone
    points: int | None
    log: bool

    def values(self, scene: Scene, points: int) -> tuple[float, ...]:
        """Its values; around that of the scene where it has no ends, so many where it does not say
        how many."""
        from rattle.compare.study.parameters import find_parameter, find_range

        low, high = self.ends or find_range(find_parameter(scene, self.name), None)
        number = self.points or points
        if self.ends and not self.log:
            return tuple(np.linspace(low, high, number).tolist())
        return self.even_logarithms(low, high, number)

    def even_logarithms(self, low: float, high: float, points: int) -> tuple[float, ...]:
        """Values spaced evenly in their logarithm, rounded between both ends."""
        positive(f"{self.name} LOW", low)
        between = (
            float(f"{value:.{RANGE_DIGITS}g}") for value in np.geomspace(low, high, points)[1:-1]
        )
        values = (low, *between, high)
        if len(set(values)) < points:
            ends = f"from {low:g} to {high:g}"
            why = f"cannot be told apart by {RANGE_DIGITS} digits {ends}; take fewer"
            raise InputError(f"{self.name} POINTS", points, why)
        return values


class RangeType(click.ParamType):  # type: ignore[type-arg]  # generic only since click 8.2
    """The type of an option that takes a range."""

    name = "range"

    def __init__(self, only: str = "") -> None:
        self.only = only  # the parameter whose range it is, where it can be no other

    def convert(
        self, value: str | Range, param: click.Parameter | None, ctx: click.Context | None
    ) -> Range:
        """Read a range."""
        if isinstance(value, Range):
            return value
        option = param.opts[0].lstrip("-") if param else "over"
        name, equals, numbers = value.partition("=")
        if not name or (":" in value and not equals) or (equals and not numbers):
            example = f"{self.only or 'torque1'}=0.1:2:12"
            raise InputError(option, value, f"write {SPELLING}, as in --{option} {example}")
        if self.only and name != self.only:
            why = f"can be {self.only} alone here; rattle study and rattle boundary go over others"
            raise InputError(option, name, why)
        return read_numbers(name, numbers) if equals else Range(name, None, None, log=False)


def read_numbers(name: str, numbers: str) -> Range:
    """Read what stands behind the name of a range."""
    low_text, _, rest = numbers.partition(":")
    high_text, _, rest = rest.partition(":")
    points_text, _, spacing = rest.partition(":")
    try:
        low = float(low_text)
        high = float(high_text)
        points = int(points_text) if points_text else None
    except ValueError:
        raise InputError(name, numbers, f"write {SPELLING}, as in {EXAMPLE}") from None
    if spacing:
        choice(f"{name} spacing", spacing, ["log"])
    if not finite(f"{name} LOW", low) < finite(f"{name} HIGH", high):
        raise InputError(f"{name} HIGH", high, f"must be greater than LOW = {low:g}")
    if points is not None:
        count(f"{name} POINTS", points, least=2)
    return Range(name, (low, high), points, log=bool(spacing))
