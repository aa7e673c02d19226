"""How gear wheels are drawn: their teeth, and where each wheel of the tree stands.

Involute teeth transmit rotation at a constant ratio, so the play between two wheels, measured along
the pitch circle, is the same in every position: the teeth of the drawing touch if and only if a
displacement is that of its wall.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rattle.compare.animation.drawing import Drawing, Part
from rattle.compare.animation.record import Recording
from rattle.scene import Floats, Scene

PITCH_RADIUS = 90.0  # of the pitch circles in the drawing
TEETH = 12
PRESSURE = math.radians(25.0)
"""Pressure angle; with 25 degrees a wheel of 12 teeth needs no undercut."""
ADDENDUM = 0.8
DEDENDUM = 1.05
"""Height of a tooth above and depth below the pitch circle, in modules; 1.09 pairs of teeth are in
mesh on average."""
PLAY = 0.3
TOOTH = 0.35
"""Largest backlash, and width of a tooth of wheel 1, as shares of the pitch."""
FLANK = 7  # points of a flank
FLASH = 9.0  # from the middle of a mesh to where an impact at a flank flashes


def draw_teeth(shown: Recording) -> Drawing:
    """Draw the tree of wheels."""
    scene = shown.scene
    gaps = scene.noise_free.constants.wheels["wall"].tolist()
    toothings = place_toothings(scene, [PLAY * gap / max(gaps) for gap in gaps])
    # of a displacement, to the drawing
    scale = PLAY * DrawnWheel(PITCH_RADIUS, TOOTH).pitch / (2.0 * max(gaps))
    turn = math.degrees(scale / PITCH_RADIUS)
    parts = [Part(one.body, turn * one.factor, one.rest, "rotate(") for one in toothings]
    sparks = [(-FLASH, FLASH) if wheel.parent else (FLASH, -FLASH) for wheel in scene.tree]
    return Drawing(parts, sparks, {"radius": PITCH_RADIUS, "toothings": toothings})


@dataclass(frozen=True)
class Toothing:
    """A toothing as it is drawn: that of a wheel, or another one on the same shaft."""

    body: int  # its wheel; 0 for the driver
    depth: int  # meshes between its wheel and the driver
    row: int
    ratio: float  # of its displacement to that of its wheel's own toothing
    width: float  # of a tooth, as a share of the pitch
    is_own: bool  # whether its wheel meshes with the parent there

    @property
    def is_odd(self) -> bool:
        """Whether its gaps hold the teeth of both neighbours."""
        return self.depth % 2 == 1

    @property
    def rest(self) -> float:
        """Its angle without displacement: a gap at each mesh, or a tooth of the neighbours."""
        if self.is_odd:
            return 180.0 / TEETH
        return 180.0 if self.depth else 0.0

    @property
    def factor(self) -> float:
        """Of the displacement of its wheel, to its rotation: neighbours turn against each other."""
        return self.ratio if self.is_odd else -self.ratio

    @property
    def outline(self) -> str:
        """Its outline as the data of an SVG path."""
        return outline(DrawnWheel(PITCH_RADIUS, self.width))


def place_toothings(scene: Scene, plays: Sequence[float]) -> list[Toothing]:
    """Lay out the tree from left to right, the toothings of a shaft one below the other.

    A wheel an odd number of meshes behind the driver has gaps for its parent's teeth on the left
    and those of one wheel on the right; all further meshes have toothings of their own.

    `plays`: Backlash of each mesh as a share of the pitch.
    """
    tree = scene.tree
    depths = [0]
    for wheel in tree:
        depths.append(depths[int(wheel.parent)] + 1)

    def below(parent: int) -> Iterator[int]:
        meshing = [i for i, wheel in enumerate(tree, 1) if wheel.parent == parent]
        for i in sorted(meshing, key=lambda i: tree[i - 1].ratio != 1.0):
            yield i
            yield from below(i)

    toothings: list[Toothing] = []
    rows = {0: -1}
    taken = {0}  # wheels whose right side is not free
    last = -1
    for i in below(0):
        parent = int(tree[i - 1].parent)
        ratio = tree[i - 1].ratio
        odd = depths[i] % 2 == 1
        other = 1.0 - TOOTH - plays[i - 1]
        rows[i] = rows[parent]
        if odd or parent in taken or ratio != 1.0:
            last += 1
            rows[i] = last
            width = other if odd else TOOTH
            toothings.append(Toothing(parent, depths[parent], last, ratio, width, False))
        taken.add(parent)
        width = TOOTH if odd else other
        toothings.append(Toothing(i, depths[i], rows[i], 1.0, width, True))
    return toothings


@dataclass(frozen=True)
class DrawnWheel:
    """A toothed wheel of `TEETH` teeth."""

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

    def half_angle(self, radius: float) -> float:
        """Half the angle that a tooth spans at a radius.

        `radius`: From the root to the tip; below the base circle the flank is radial.
        """
        base = self.radius * math.cos(PRESSURE)
        at = math.acos(min(base / radius, 1.0))
        at_pitch = 0.5 * self.width * self.pitch / self.radius
        return at_pitch + (math.tan(PRESSURE) - PRESSURE) - (math.tan(at) - at)


def outline(wheel: DrawnWheel) -> str:
    """The outline of a wheel as the data of an SVG path; the middle of a tooth points along the x
    axis."""
    root = wheel.radius - DEDENDUM * wheel.module
    tip = wheel.radius + ADDENDUM * wheel.module
    base = wheel.radius * math.cos(PRESSURE)
    radii = np.append(root, np.linspace(base, tip, FLANK))
    half = np.array([wheel.half_angle(radius) for radius in radii])
    along_root = f"A{root:.1f} {root:.1f} 0 0 1 "
    along_tip = f"A{tip:.1f} {tip:.1f} 0 0 1 "
    teeth = []
    for middle in 2.0 * math.pi / TEETH * np.arange(TEETH):
        rising = _line(radii, middle - half)
        falling = _line(radii[::-1], middle + half[::-1])
        teeth.append(f"{rising}{along_tip}{falling}")
    start = teeth[0].split("L")[0]
    return f"M{along_root.join(teeth)}{along_root}{start}Z"


def _line(radius: Floats, angle: Floats) -> str:
    """Points in polar coordinates as a line of an SVG path."""
    first, *others = (
        f"{x:.2f} {y:.2f}"
        for x, y in zip(radius * np.cos(angle), radius * np.sin(angle), strict=True)
    )
    return f"{first}L{' '.join(others)}"
