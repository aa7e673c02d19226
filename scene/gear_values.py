"""A scene of gears in which some values of the gears are others: what an axis of a study and a
search vary."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from rattle.scene.drag import DRAG_TABLES
from rattle.scene.gears import DRIVES, Gears, drive_by
from rattle.scene.parts import Start
from rattle.scene.scene import FREE, Scene

UNIT_VALUES = ("omega", "backlash1")
"""Values of gears that units of time, length and speed depend on."""


def values_of(gears: Gears) -> dict[str, float]:
    """The values of gears that may be varied, as they were typed; the drive is its amplitude in
    mm."""
    return {"amplitude": gears.amplitude} | {
        name: v for name, v in gears.values.items() if name not in (*DRIVES, *DRAG_TABLES)
    }


def is_value(name: str, gears: Gears | None) -> bool:
    """Whether a name is that of a value of gears."""
    if gears is None or name in DRAG_TABLES:
        return False
    return name in DRIVES[:2] or name in gears.values


def has_own_start(scene: Scene) -> bool:
    """Whether the start of a scene is not that of the paper, which follows the gaps."""
    return scene.start != Start(0.0, scene.gap1, 2.0, scene.gap2, 2.0, mesh=1)


def scene_with(scene: Scene, changes: Mapping[str, Any]) -> Scene:
    """The scene with other values of its gears; all others stay as they were typed, the drive and
    tolerances in mm."""
    assert scene.gears is not None
    gears = scene.gears
    for name, value in changes.items():
        if name in DRIVES:
            gears = Gears.driven(**drive_by(gears.values, name, value))
        else:
            amplitude = gears.amplitude
            gears = Gears.driven(**gears.values | {name: value})
            if "alpha" in gears.values:
                gears = replace(gears, alpha=amplitude / gears.backlash1)
    unit = scene.gears.backlash1 / gears.backlash1  # old unit of length over the new one
    tolerance = scene.tolerance and replace(
        scene.tolerance, c1_max=unit * scene.tolerance.c1_max, c2_max=unit * scene.tolerance.c2_max
    )
    settings = {field: getattr(scene, field) for field in FREE}
    settings |= {"tolerance": tolerance, "start": scene.start if has_own_start(scene) else None}
    return Scene.from_gears(gears, **settings)
