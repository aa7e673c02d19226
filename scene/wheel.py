"""A loose wheel of a gearbox, and what compiled code knows of it (docs/model.md section 2).

A gearbox is a tree of loose wheels behind one driver: every wheel meshes with a parent.
"""

from rattle.scene.compiled import internal
from rattle.scene.types import Wheels


@internal
def complete_wheels(wheels: Wheels) -> None:
    """Fill in what follows from parent, sign, ratio, turn, damping, drag and mass of wheels.

    Shapes: `wheels` (wheels,), of `rattle.scene.types.WHEEL`.
    """
    sign = wheels["sign"]
    ratio = wheels["ratio"]
    turn = wheels["turn"]
    beta = wheels["beta"]
    gamma = wheels["gamma"]
    mass = wheels["mass"]
    for i, p in enumerate(wheels["parent"]):
        if p < 0:
            wheels["share"][i] = 0.0
            wheels["coupling"][i] = 0.0
            wheels["drag"][i] = sign[i] * gamma[i]
            wheels["second"][i] = sign[i] * turn[i]
            wheels["first"][i] = sign[i] * turn[i] * beta[i]
        else:
            carried = ratio[i] * ratio[i] * mass[i]
            wheels["share"][i] = carried / (carried + mass[p])
            wheels["coupling"][i] = ratio[i] * (beta[i] - beta[p])
            wheels["drag"][i] = ratio[i] * gamma[p] - gamma[i]
            wheels["second"][i] = 0.0
            wheels["first"][i] = turn[i] * (beta[p] - beta[i])
