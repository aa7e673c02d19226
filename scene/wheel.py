"""A loose wheel of a gearbox, and what compiled code knows of it (docs/model.md section 2).

A gearbox is a tree of loose wheels behind one driver: every wheel meshes with a parent.
"""

from typing import Any

from rattle.scene.compiled import internal
from rattle.scene.drive import most_modulation, most_modulation_rate
from rattle.scene.types import Wheels


@internal
def complete_wheels(wheels: Wheels, drive: Any) -> None:
    """Fill in what follows from parent, sign, ratio, turn, damping, drag and mass of wheels.

    Shapes: `wheels` (wheels,), of `rattle.scene.types.WHEEL`.
    """
    for i in range(wheels.size):
        wheel = wheels[i]
        wheel.drives = 0
        beta = wheel.beta if wheel.parent < 0 else wheels[wheel.parent].beta
        wheel.modulation = most_modulation(drive, beta)
        wheel.modulation_rate = most_modulation_rate(drive, beta)
        if wheel.parent < 0:
            wheel.share = 0.0
            wheel.coupling = 0.0
            wheel.drag = wheel.sign * wheel.gamma
            wheel.second = wheel.sign * wheel.turn
            wheel.first = wheel.sign * wheel.turn * wheel.beta
        else:
            parent = wheels[wheel.parent]
            parent.drives = 1
            carried = wheel.ratio * wheel.ratio * wheel.mass
            wheel.share = carried / (carried + parent.mass)
            wheel.coupling = wheel.ratio * (wheel.beta - parent.beta)
            wheel.drag = wheel.ratio * parent.gamma - wheel.gamma
            wheel.second = 0.0
            wheel.first = wheel.turn * (parent.beta - wheel.beta)
