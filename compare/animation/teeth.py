"""Outlines of toothed wheels whose flanks touch exactly where the model's backlash ends.

Involute teeth transmit rotation at a constant ratio, so the play between two wheels, measured along the pitch circle,
is the same in every position: the teeth of the drawing touch if and only if a displacement is that of its wall.
"""

import math
from dataclasses import dataclass

TEETH = 12
PRESSURE = math.radians(25.0)
"""Pressure angle; with 25 degrees a wheel of 12 teeth needs no undercut."""
ADDENDUM, DEDENDUM = 0.8, 1.05
"""Height of a tooth above and depth below the pitch circle, in modules; 1.09 pairs of teeth are in mesh on average."""
PLAY, TOOTH = 0.3, 0.35
"""Largest backlash, and width of a tooth of wheel 1, as shares of the pitch."""
POINTS = 7  # of a flank


@dataclass(frozen=True)
class Wheel:
    """A toothed wheel of `TEETH` teeth.

    Examples
    --------
    >>> Wheel(6.0, 0.35).module
    1.0
    """

    radius: float
    width: float

    @property
    def module(self) -> float:
        """Diameter of the pitch circle over the number of teeth."""
        return 2.0 * self.radius / TEETH

    @property
    def pitch(self) -> float:
        """Distance of two teeth along the pitch circle."""
        return math.pi * self.module

    @property
    def tip(self) -> float:
        """Radius of its tips."""
        return self.radius + ADDENDUM * self.module

    def half_angle(self, radius: float) -> float:
        """Half the angle that a tooth spans at a radius.

        `radius`: From the root to the tip; below the base circle the flank is radial.

        Examples
        --------
        >>> wheel = Wheel(6.0, 0.35)
        >>> round(2.0 * wheel.half_angle(6.0) * 6.0 / wheel.pitch, 12)
        0.35
        """
        base = self.radius * math.cos(PRESSURE)
        at = math.acos(min(base / radius, 1.0))
        at_pitch = 0.5 * self.width * self.pitch / self.radius
        return at_pitch + (math.tan(PRESSURE) - PRESSURE) - (math.tan(at) - at)


def outline(wheel: Wheel) -> str:
    """The outline of a wheel as the data of an SVG path; the middle of a tooth points along the x axis.

    Examples
    --------
    >>> outline(Wheel(96.0, 0.35)).count("A")  # a tip and a root for each tooth
    24
    """
    root, tip = wheel.radius - DEDENDUM * wheel.module, wheel.tip
    base = wheel.radius * math.cos(PRESSURE)
    radii = [root, *(base + (tip - base) * (i / (POINTS - 1)) for i in range(POINTS))]
    flank = [(r, wheel.half_angle(r)) for r in radii]
    parts = []
    for tooth in range(TEETH):
        middle = 2.0 * math.pi * tooth / TEETH
        rising = [_point(r, middle - half) for r, half in flank]
        falling = [_point(r, middle + half) for r, half in reversed(flank)]
        begin = f"M{rising[0]}" if tooth == 0 else f"A{root:.1f} {root:.1f} 0 0 1 {rising[0]}"
        parts.append(f"{begin}L{' '.join(rising[1:])}A{tip:.1f} {tip:.1f} 0 0 1 {falling[0]}L{' '.join(falling[1:])}")
    return "".join(parts) + f"A{root:.1f} {root:.1f} 0 0 1 {_point(*_first(flank))}Z"


def _first(flank: list[tuple[float, float]]) -> tuple[float, float]:
    radius, half = flank[0]
    return radius, -half


def _point(radius: float, angle: float) -> str:
    return f"{radius * math.cos(angle):.2f} {radius * math.sin(angle):.2f}"
