"""Writes an animation as one HTML file that needs no other: its drawings, its data and its script
are inside.

Involute teeth transmit rotation at a constant ratio, so the play between two wheels, measured along
the pitch circle, is the same in every position: the teeth of the drawing touch if and only if a
displacement is that of its wall.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from rattle.compare.animation.record import SCHEME, Motion, Recording
from rattle.compare.report.folder import check_own, check_place, refusals, write_whole
from rattle.compare.report.json_text import json_text
from rattle.compare.report.render import render_animation
from rattle.scene import OutputError, line
from rattle.scene.drive import driver_motion

LARGEST = 1_000_000
"""Most bytes of an animation."""
GENERATOR = '<meta name="generator" content="rattle animate">'
"""In the head of every animation; a file without it is never replaced."""
RADIUS = 90.0  # of the pitch circles in the drawing
SECONDS = 0.9  # of watching for each impact of the orbit
# inner coordinates of a strip
WIDE = 10_000
HIGH = 1000
ROOM = 1.3  # height of a strip in half gaps
MOST_TAU = 1e4  # beyond it time is counted from the start
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


def animation(shown: Recording, name: str, command: str = "") -> str:
    """The text of an animation's HTML file."""
    scene = shown.scene
    span = shown.span
    walls = shown.scene.noise_free.constants
    gaps = (walls.wall1, walls.wall2)[: scene.stages]
    begin = scene.start.tau if abs(scene.start.tau) <= MOST_TAU else 0.0
    symbol = "τ" if begin == scene.start.tau else "τ − τ₀"
    ms = None if scene.gears is None else 1000.0 / scene.gears.omega
    first = Wheel(RADIUS, TOOTH)
    scale = PLAY * first.pitch / (2.0 * max(gaps))  # of a displacement, to the drawing
    widths = [TOOTH, *(1.0 - TOOTH - 2.0 * gap * scale / first.pitch for gap in gaps)]
    data = {
        "span": span,
        "phase": scene.phase,
        "alpha": scene.alpha,
        "drive": [[one.order, one.amplitude, one.phase] for one in scene.drive],
        "turn": math.degrees(scale / RADIUS),
        "seconds": SECONDS * shown.orbit.impacts,
        "offset": begin,
        # of a time that is shown
        "digits": min(max(0, 2 - math.floor(math.log10(span / 10.0))), 15),
        "ms": ms,
        "paths": [_numbers(motion) for motion in (shown.orbit, shown.path)],
    }
    return render_animation(
        generator=Markup(GENERATOR),
        data=Markup(json_text(data, indent=None)),
        name=line(name),
        shown=shown,
        scene=scene,
        command=line(command),
        radius=RADIUS,
        wheels=[outline(Wheel(RADIUS, width)) for width in widths],
        turns=_turns(shown, scale),
        strips=[_strip(shown, mesh) for mesh in range(1, scene.stages + 1)],
        ticks=list(_ticks(begin, span)),
        ms=ms,
        symbol=symbol,
        scheme=SCHEME,
        size=(WIDE, HIGH),
    )


def check_file(out: Path, overwrite: bool) -> None:
    """Check before the work that a file can be written without losing another's."""
    with refusals(out):
        if out.suffix.lower() != ".html":
            raise OutputError(
                f"out = {str(out)!r}: an animation is an HTML file; give a name that ends in .html"
            )
        check_own(out, re.escape(GENERATOR.encode()), "an animation of rattle")
        check_place(out)
    if out.exists() and not overwrite:
        raise OutputError(
            f"out = {str(out)!r}: exists; choose another name, or overwrite it (--overwrite)"
        )


def write_animation(
    out: Path, shown: Recording, name: str, command: str = "", overwrite: bool = False
) -> None:
    """Write an animation, whole or not at all."""
    text = animation(shown, name, command)
    check_file(out, overwrite)
    write_whole(out, text)


def _numbers(motion: Motion) -> Mapping[str, Any]:
    """A path as numbers for the script, to 7 digits."""
    columns = {"t": motion.time, "x1": motion.x1, "hits": motion.impact_time}
    if not np.isnan(motion.x2).all():
        columns["x2"] = motion.x2
    texts = {key: [float(f"{v:.7g}") for v in values.tolist()] for key, values in columns.items()}
    return texts | {"codes": motion.code.tolist()}


def _turns(shown: Recording, scale: float) -> list[float]:
    """Angles of the wheels at the start, in degrees clockwise; see `animation.js`."""
    scene = shown.scene
    x1 = shown.orbit.x1[0]
    x2 = shown.orbit.x2[0]
    driver = scene.alpha * driver_motion(scene.constants.drive, scene.phase)
    turns = [driver - x1, -driver, x1 - driver - x2][: scene.stages + 1]  # wheel 1, driver, wheel 2
    return [round(math.degrees(scale / RADIUS * float(turn)), 3) for turn in turns]


def _ticks(begin: float, span: float) -> Iterator[tuple[float, str]]:
    """Ticks of the time axis: place in percent, and label."""
    power = 10.0 ** math.floor(math.log10(span / 4.0))
    step = next(power * n for n in (1, 2, 5, 10) if span / (power * n) <= 6.5)
    for k in range(math.ceil(begin / step), math.floor((begin + span) / step) + 1):
        yield round(100.0 * (k * step - begin) / span, 3), f"{k * step:.10g}".replace("-", "−")


def _strip(shown: Recording, mesh: int) -> dict[str, Any]:
    """The displacement at a mesh over time, for the template.

    Returns: ``label, unit`` (what is drawn), ``ticks`` (height of a tick from the top in percent,
    and its label), ``curves`` (name and SVG points of each path), ``marks`` (name of the path,
    number of the impact, and its place from left and top in percent) and ``band`` (half the height
    of the band in which a flank of a toleranced gap lies, in percent; 0 for none).
    """
    scene = shown.scene
    walls = shown.scene.noise_free.constants
    symbol, wall, ahead = (
        ("x₁", walls.wall1, "driver") if mesh == 1 else ("x₂", walls.wall2, "wheel 2")
    )
    random = scene.tolerance is not None and scene.tolerance.distribution != "fixed"
    c_max = getattr(scene.tolerance, f"c{mesh}_max") if random else 0.0
    top = max(ROOM * wall, 1.1 * (wall + c_max))
    label = f"{(scene.gears.backlash1 if scene.gears else 1.0) * wall:.3g}"
    heights = {f"+{label}": wall, "0": 0.0, f"−{label}": -wall}
    curves = []
    marks = []
    for name, motion in (("orbit", shown.orbit), ("path", shown.path)):
        x = motion.x1 if mesh == 1 else motion.x2
        places = zip((motion.time / shown.span).tolist(), _height(x, top).tolist(), strict=True)
        curves.append((name, " ".join(f"{WIDE * a:.0f},{HIGH * b:.0f}" for a, b in places)))
        left = 100.0 * motion.impact_time / shown.span
        down = 100.0 * _height(motion.impact_x, top)
        own = np.flatnonzero(np.abs(motion.code) == mesh)
        marks += [(name, int(k), round(float(left[k]), 3), round(float(down[k]), 2)) for k in own]
    return {
        "label": f"{symbol}: {ahead} ahead of wheel 1",
        "unit": "mm" if scene.gears else "dimensionless",
        "ticks": [
            (round(100.0 * _height(height, top), 3), text) for text, height in heights.items()
        ],
        "curves": curves,
        "marks": marks,
        "band": round(50.0 * c_max / top, 3),
    }


def _height(x: Any, top: float) -> Any:
    """Share of a strip's height from its top."""
    return 0.5 - 0.5 * x / top


@dataclass(frozen=True)
class Wheel:
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


def outline(wheel: Wheel) -> str:
    """The outline of a wheel as the data of an SVG path; the middle of a tooth points along the x
    axis."""
    root = wheel.radius - DEDENDUM * wheel.module
    tip = wheel.radius + ADDENDUM * wheel.module
    base = wheel.radius * math.cos(PRESSURE)
    radii = [root, *(base + (tip - base) * (i / (FLANK - 1)) for i in range(FLANK))]
    flank = [(r, wheel.half_angle(r)) for r in radii]
    start = _point(root, -flank[0][1])
    path = ""
    for tooth in range(TEETH):
        middle = 2.0 * math.pi * tooth / TEETH
        rising = [_point(r, middle - half) for r, half in flank]
        falling = [_point(r, middle + half) for r, half in reversed(flank)]
        path += f"A{root:.1f} {root:.1f} 0 0 1 {rising[0]}" if tooth else f"M{start}"
        path += (
            f"L{' '.join(rising[1:])}A{tip:.1f} {tip:.1f} 0 0 1"
            f" {falling[0]}L{' '.join(falling[1:])}"
        )
    return f"{path}A{root:.1f} {root:.1f} 0 0 1 {start}Z"


def _point(radius: float, angle: float) -> str:
    return f"{radius * math.cos(angle):.2f} {radius * math.sin(angle):.2f}"
