"""Writes an animation as one HTML file that needs no other: its drawings, its data and its script
are inside."""

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from rattle.compare.animation.bodies import draw_bodies
from rattle.compare.animation.drawing import places
from rattle.compare.animation.record import ANIMATED_SCHEME, Motion, Recording
from rattle.compare.animation.teeth import draw_teeth
from rattle.compare.report.folder import check_own, check_place, refusals, write_whole
from rattle.compare.report.json_text import Facts, json_text
from rattle.compare.report.render import render_animation
from rattle.compare.report.texts import wheel_label
from rattle.scene import Floats, OutputError, line
from rattle.scene.drive import PERIOD

GENERATOR = '<meta name="generator" content="rattle animate">'
"""In the head of every animation; a file without it is never replaced."""
# seconds of watching: for a period, and for each of the impacts of a shorter time
SECONDS_OF_A_PERIOD = 10.0
SECONDS_OF_A_SWING = 4.0  # of bodies, whose flights may be longer
SECONDS_OF_AN_IMPACT = 0.9
FEW_IMPACTS = 24
# inner coordinates of a strip
STRIP_WIDTH = 10_000
HIGH = 1000
STRIP_HEIGHT = 1.3  # height of a strip in gaps, or in what a body goes through before its one wall
CLEAR = 0.15  # share of that which is left free beside the label of the wall
DIGITS = 4  # of a displacement: a thousandth of a backlash
MOST_TAU = 1e4  # beyond it time is counted from the start
SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


def animation(shown: Recording, name: str, command: str = "") -> str:
    """The text of an animation's HTML file."""
    scene = shown.scene
    words = scene.words
    drawing = draw_bodies(shown) if scene.bodies else draw_teeth(shown)
    begin = scene.start.tau if abs(scene.start.tau) <= MOST_TAU else 0.0
    ms = None if scene.gears is None else 1000.0 / scene.gears.omega
    data = {
        "span": shown.span,
        "phase": scene.phase,
        "alpha": scene.alpha,
        "drive": [[one.order, one.amplitude, one.phase] for one in scene.drive],
        "parents": [wheel.parent for wheel in scene.tree],
        "ratios": [wheel.ratio for wheel in scene.tree],
        "parts": drawing.parts,
        "sparks": drawing.sparks,
        "words": [words.mesh, words.flank],
        "seconds": max(
            (SECONDS_OF_A_SWING if scene.bodies else SECONDS_OF_A_PERIOD) * shown.span / PERIOD,
            SECONDS_OF_AN_IMPACT * min(shown.orbit.impacts, FEW_IMPACTS),
        ),
        "offset": begin,
        # of a time that is shown
        "digits": min(max(0, 2 - math.floor(math.log10(shown.span / 10.0))), 15),
        "ms": ms,
        "paths": [_numbers(motion) for motion in (shown.orbit, shown.path)],
    }
    at_start = places(scene, shown.orbit)[:, 0].tolist()
    numbers = range(1, scene.stages + 1)
    return render_animation(
        generator=Markup(GENERATOR),
        data=Markup(json_text(data, indent=None)),
        name=line(name),
        shown=shown,
        command=line(command),
        drawing=drawing.facts,
        transforms=[part.at(at_start) for part in drawing.parts],
        names=["driver", *(f"{words.wheel} {i}" for i in numbers)],
        labels=["driver", *(f"{words.wheel} {wheel_label(scene, i)}" for i in numbers)],
        strips=[_strip(shown, mesh) for mesh in numbers],
        ticks=[
            (round(100.0 * (time - begin) / shown.span, 3), label)
            for time, label in _ticks(begin, shown.span, 6.5)
        ],
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


def _ticks(begin: float, span: float, most: float) -> Iterator[tuple[float, str]]:
    """Round numbers on an axis, and their labels; steps between them: at most `most`, 4 or more."""
    power = 10.0 ** math.floor(math.log10(span / 4.0))
    step = next(power * n for n in (1, 2, 5, 10) if span / (power * n) <= most)
    for k in range(math.ceil(begin / step), math.floor((begin + span) / step) + 1):
        yield k * step, f"{k * step:.10g}".replace("-", "−")


def _strip(shown: Recording, mesh: int) -> Facts:
    """The displacement at a mesh over time, for the template.

    Returns: ``mesh``, ``ticks`` (height of a tick from the top in percent, its label, and whether a
    wall is there), ``curves`` (name and SVG points of each path), ``marks`` (name of the path,
    number of the impact, and its place from left and top in percent) and ``band`` (half the height
    of the band in which a flank of a toleranced gap lies, in percent; 0 for none).
    """
    scene = shown.scene
    wheel = scene.tree[mesh - 1]
    random = scene.tolerance is not None and scene.tolerance.distribution != "fixed"
    c_max = wheel.tolerance if random else 0.0
    gap = float(scene.noise_free.constants.wheels["wall"][mesh - 1])
    half = max(STRIP_HEIGHT * gap, 1.1 * (gap + c_max))
    middle = 0.0
    label = f"{(scene.gears.units.length if scene.gears else 1.0) * gap:.3g}"
    values = [(gap, f"+{label}", True), (0.0, "0", False), (-gap, f"−{label}", True)]
    paths = (("orbit", shown.orbit), ("path", shown.path))
    if wheel.one_sided:
        span = gap - min(float(motion.x[:, mesh - 1].min()) for _, motion in paths)
        middle = gap - 0.5 * span
        half = 0.5 * STRIP_HEIGHT * span
        values = [(gap, label, True)]
        for x, text in _ticks(gap - span, (1.0 - CLEAR) * span, 4.0):
            values.append((x, text, False))
    if scene.bodies and not wheel.parent:
        half = -half  # up is where the body is

    def height(x: Any) -> Any:
        return 0.5 - 0.5 * (x - middle) / half

    curves = []
    marks = []
    for name, motion in paths:
        heights = height(motion.x[:, mesh - 1]).tolist()
        points = zip((motion.time / shown.span).tolist(), heights, strict=True)
        curves.append((name, " ".join(f"{STRIP_WIDTH * a:.0f},{HIGH * b:.0f}" for a, b in points)))
        left = 100.0 * motion.impact_time / shown.span
        down = 100.0 * height(motion.impact_x)
        for k in np.flatnonzero(np.abs(motion.code) == mesh).tolist():
            marks.append((name, k, round(float(left[k]), 3), round(float(down[k]), 2)))
    return {
        "mesh": mesh,
        "subscript": str(mesh).translate(SUBSCRIPTS),
        "parent": wheel.parent,
        "ticks": [(round(100.0 * height(x), 3), text, is_wall) for x, text, is_wall in values],
        "curves": curves,
        "marks": marks,
        "band": round(50.0 * c_max / abs(half), 3),
    }
