"""How bodies are drawn that are no gear wheels: side by side, each with what it strikes.

Up is up, and the places of driver, bodies and walls have one scale.  A wall is drawn half a body
farther away, so that a body touches it if and only if its displacement is that of the wall.
"""

import math

import numpy as np

from rattle.compare.animation.drawing import Drawing, Part, places
from rattle.compare.animation.record import Recording
from rattle.scene import Scene

PLACES = 260.0  # height of all that bodies and walls go through
BODY_RADIUS = 18.0  # of a body
WALL = 18.0  # thickness of a wall
SPRING = 40.0  # least length of a spring


def find_walls(scene: Scene) -> list[list[tuple[float, float]]]:
    """The walls of each body, first that of side +1: 1 above it or -1 below it, and how far from
    its place at displacement 0.

    A displacement is the place of the driver less that of a body, and between two bodies the
    reverse.
    """
    wheels = scene.noise_free.constants.wheels
    walls = []
    for wheel, gap, low in zip(scene.tree, wheels["wall"], wheels["low"], strict=True):
        up = 1.0 if wheel.parent else -1.0
        both = [(up, float(gap)), (-up, float(low))]
        walls.append([wall for wall in both if math.isfinite(wall[1])])
    return walls


def draw_bodies(shown: Recording) -> Drawing:
    """Draw each body in a column, with the table, the frame or the other body that it strikes."""
    scene = shown.scene
    walls = find_walls(scene)
    passed = np.hstack([places(scene, motion) for motion in (shown.orbit, shown.path)])
    _, bodies, displacements = np.split(passed, [1, 1 + scene.stages])
    # what each body strikes, in the unit of length of that body
    struck = [wheel.ratio * passed[int(wheel.parent)] for wheel in scene.tree]
    at_walls = [struck[i] + up * gap for i, both in enumerate(walls) for up, gap in both]
    scale = PLACES / float(np.ptp(np.vstack([bodies, at_walls])))
    columns = []
    parts: list[Part] = []
    sparks = []
    reached = [-scale * bodies.max() - BODY_RADIUS, -scale * bodies.min() + BODY_RADIUS]
    for i, wheel in enumerate(scene.tree):
        surfaces = [-up * (scale * gap + BODY_RADIUS) for up, gap in walls[i]]
        ends = [surface + math.copysign(WALL, surface) for surface in surfaces]
        frame = Part(int(wheel.parent), -scale * wheel.ratio)
        first = len(parts)
        parts.append(frame)
        anchor = None
        if wheel.stiffness:
            free = scale * float(displacements[i].min()) - BODY_RADIUS
            anchor = min(free, *ends) - SPRING
            ends.append(anchor - WALL)
            # from its upper end to the body, of length 1 before it is stretched
            parts.append(Part(1 + scene.stages + i, scale, -BODY_RADIUS - anchor, "scale(1 "))
        parts += [Part(1 + i, -scale), frame]
        sparks.append((surfaces[-1], surfaces[0]))
        highest = -scale * float(struck[i].max())
        lowest = -scale * float(struck[i].min())
        reached += [highest + min(ends), lowest + max(ends)]
        columns.append(
            {
                "wheel": wheel,
                "first": first,
                "surfaces": surfaces,
                "anchor": anchor,
                "ends": (min(ends), max(ends)),
                "stroke": (highest, lowest),
            }
        )
    facts = {
        "columns": columns,
        "radius": BODY_RADIUS,
        "wall": WALL,
        "top": float(min(reached)),
        "bottom": float(max(reached)),
    }
    return Drawing(parts, sparks, facts)
