"""Writes an animation as one HTML file that needs no other: its drawings, its data and its script
are inside."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from rattle.compare.animation.record import ANIMATED_SCHEME, Motion, Recording
from rattle.compare.animation.teeth import (
    PITCH_RADIUS,
    PLAY,
    TOOTH,
    DrawnWheel,
    Toothing,
    place_toothings,
)
from rattle.compare.report.folder import check_own, check_place, refusals, write_whole
from rattle.compare.report.json_text import Facts, json_text
from rattle.compare.report.render import render_animation
from rattle.compare.report.texts import wheel_label
from rattle.scene import Floats, OutputError, line
from rattle.scene.drive import PERIOD, driver_motion

GENERATOR = '<meta name="generator" content="rattle animate">'
"""In the head of every animation; a file without it is never replaced."""
# seconds of watching: for a period, and for each of the impacts of a shorter time
SECONDS_OF_A_PERIOD = 10.0
SECONDS_OF_AN_IMPACT = 0.9
FEW_IMPACTS = 24
# inner coordinates of a strip
STRIP_WIDTH = 10_000
HIGH = 1000
STRIP_HEIGHT = 1.3  # height of a strip in half gaps
DIGITS = 4  # of a displacement: a thousandth of a backlash
MOST_TAU = 1e4  # beyond it time is counted from the start
SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


def animation(shown: Recording, name: str, command: str = "") -> str:
    """The text of an animation's HTML file."""
    scene = shown.scene
    gaps = scene.noise_free.constants.wheels["wall"].tolist()
    begin = scene.start.tau if abs(scene.start.tau) <= MOST_TAU else 0.0
    ms = None if scene.gears is None else 1000.0 / scene.gears.omega
    # of a displacement, to the drawing
    scale = PLAY * DrawnWheel(PITCH_RADIUS, TOOTH).pitch / (2.0 * max(gaps))
    toothings = place_toothings(scene, [PLAY * gap / max(gaps) for gap in gaps])
    data = {
        "span": shown.span,
        "phase": scene.phase,
        "alpha": scene.alpha,
        "drive": [[one.order, one.amplitude, one.phase] for one in scene.drive],
        "turn": math.degrees(scale / PITCH_RADIUS),
        "parents": [wheel.parent for wheel in scene.tree],
        "ratios": [wheel.ratio for wheel in scene.tree],
        "drawn": [(one.body, one.factor, one.rest) for one in toothings],
        "seconds": max(
            SECONDS_OF_A_PERIOD * shown.span / PERIOD,
            SECONDS_OF_AN_IMPACT * min(shown.orbit.impacts, FEW_IMPACTS),
        ),
        "offset": begin,
        # of a time that is shown
        "digits": min(max(0, 2 - math.floor(math.log10(shown.span / 10.0))), 15),
        "ms": ms,
        "paths": [_numbers(motion) for motion in (shown.orbit, shown.path)],
    }
    return render_animation(
        generator=Markup(GENERATOR),
        data=Markup(json_text(data, indent=None)),
        name=line(name),
        shown=shown,
        command=line(command),
        radius=PITCH_RADIUS,
        toothings=list(zip(toothings, _turns(shown, scale, toothings), strict=True)),
        own=sorted((one for one in toothings if one.is_own), key=lambda one: one.body),
        names=["driver", *(f"wheel {i}" for i in range(1, scene.stages + 1))],
        labels=["driver", *(f"wheel {wheel_label(scene, i + 1)}" for i in range(scene.stages))],
        strips=[_strip(shown, mesh, gap) for mesh, gap in enumerate(gaps, 1)],
        ticks=list(_ticks(begin, shown.span)),
        ms=ms,
        begin=begin,
        scheme=ANIMATED_SCHEME,
        size=(STRIP_WIDTH, HIGH),
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
    """A path as numbers for the script: times to 7 digits, displacements to what can be seen."""

    def rounded(values: Floats, digits: int) -> list[float]:
        return [float(f"{value:.{digits}g}") for value in values.tolist()]

    return {
        "t": rounded(motion.time, 7),
        "hits": rounded(motion.impact_time, 7),
        "x": [rounded(x, DIGITS) for x in motion.x.T],
        "codes": motion.code.tolist(),
        "numbers": motion.number.tolist(),
    }


def _turns(shown: Recording, scale: float, toothings: Sequence[Toothing]) -> list[float]:
    """Angles of the toothings at the start, in degrees clockwise; see `animation.js`."""
    scene = shown.scene
    moved = [scene.alpha * float(driver_motion(scene.constants.drive, scene.phase))]
    for wheel, x in zip(scene.tree, shown.orbit.x[0].tolist(), strict=True):
        parent = int(wheel.parent)
        moved.append(wheel.ratio * moved[parent] + (x if parent else -x))
    turn = math.degrees(scale / PITCH_RADIUS)
    return [round(one.rest + turn * one.factor * moved[one.body], 3) for one in toothings]


def _ticks(begin: float, span: float) -> Iterator[tuple[float, str]]:
    """Ticks of the time axis: place in percent, and label."""
    power = 10.0 ** math.floor(math.log10(span / 4.0))
    step = next(power * n for n in (1, 2, 5, 10) if span / (power * n) <= 6.5)
    for k in range(math.ceil(begin / step), math.floor((begin + span) / step) + 1):
        yield round(100.0 * (k * step - begin) / span, 3), f"{k * step:.10g}".replace("-", "−")


def _strip(shown: Recording, mesh: int, gap: float) -> Facts:
    """The displacement at a mesh over time, for the template.

    Returns: ``mesh``, ``ticks`` (height of a tick from the top in percent, and its label),
    ``curves`` (name and SVG points of each path), ``marks`` (name of the path, number of the
    impact, and its place from left and top in percent) and ``band`` (half the height of the band in
    which a flank of a toleranced gap lies, in percent; 0 for none).
    """
    scene = shown.scene
    random = scene.tolerance is not None and scene.tolerance.distribution != "fixed"
    c_max = scene.tree[mesh - 1].tolerance if random else 0.0
    top = max(STRIP_HEIGHT * gap, 1.1 * (gap + c_max))
    label = f"{(scene.gears.units.length if scene.gears else 1.0) * gap:.3g}"
    heights = {f"+{label}": gap, "0": 0.0, f"−{label}": -gap}
    curves = []
    marks = []
    for name, motion in (("orbit", shown.orbit), ("path", shown.path)):
        x = motion.x[:, mesh - 1]
        places = zip((motion.time / shown.span).tolist(), _height(x, top).tolist(), strict=True)
        curves.append((name, " ".join(f"{STRIP_WIDTH * a:.0f},{HIGH * b:.0f}" for a, b in places)))
        left = 100.0 * motion.impact_time / shown.span
        down = 100.0 * _height(motion.impact_x, top)
        for k in np.flatnonzero(np.abs(motion.code) == mesh).tolist():
            marks.append((name, k, round(float(left[k]), 3), round(float(down[k]), 2)))
    return {
        "mesh": mesh,
        "subscript": str(mesh).translate(SUBSCRIPTS),
        "parent": scene.tree[mesh - 1].parent,
        "ticks": [(round(100.0 * _height(x, top), 3), text) for text, x in heights.items()],
        "curves": curves,
        "marks": marks,
        "band": round(50.0 * c_max / top, 3),
    }


def _height(x: Any, top: float) -> Any:
    """Share of a strip's height from its top."""
    return 0.5 - 0.5 * x / top
