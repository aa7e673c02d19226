"""The threshold of rattle: the drag from which on closed teeth stay closed, without noise
(docs/model.md section 3)."""

from typing import NamedTuple

import numpy as np

from rattle.scene.drive import velocity_acceleration
from rattle.scene.gears import KG_MM_PER_S2_PER_N
from rattle.scene.numpy_errors import numpy_defaults
from rattle.scene.scene import Scene, check_scene
from rattle.scene.sticking import lock
from rattle.scene.types import BODY, Constants, Floats

PULL_POINTS = 32  # points for each order of the drive, among which the largest pull is looked for
ZOOMS = 6  # times that the place of the largest pull is looked for sixteen times as closely


class RattleThreshold(NamedTuple):
    """The drag of a wheel from which on its closed teeth stay closed, from `rattle_threshold`.

    Attributes
    ----------
    wheel : int
        Which loose wheel, from 1 on.
    drag : float
        What the scene has: the drag torque in N mm, or ``gamma`` of a scene without gears.
    least : float
        The threshold, in the same unit.
    unit : str
        ``N mm``, or empty.
    name : str
        What a person calls the wheel: its name, or its number.

    Examples
    --------
    >>> from rattle.scene import DAT21
    >>> wheel1, wheel2 = rattle_threshold(Scene.from_gears(DAT21))
    >>> wheel2.drag, round(wheel2.least), wheel2.opens
    (50.0, 2579, True)
    """

    wheel: int
    drag: float
    least: float
    unit: str
    name: str

    @property
    def opens(self) -> bool:
        """Whether the drag is below the threshold, so that closed teeth open."""
        return self.drag < self.least


@numpy_defaults
def rattle_threshold(scene: Scene) -> tuple[RattleThreshold, ...]:
    """Compute the drag of each loose wheel from which on its closed teeth stay closed.

    It is that of the motion without noise.
    Closed teeth open when the driver decelerates faster than the drag slows the wheel.  With both
    meshes closed all wheels move with the driver, and they stay closed if

    - at mesh 2, ``gamma2 >= alpha max(-(f'' + beta2 f'))``;
    - at mesh 1, the same with the damping and the drag of both wheels as one body, ``(1 - mu)
      gamma1 + mu gamma2`` and ``(1 - mu) beta1 + mu beta2``.  What wheel 1 must have is stated for
      a wheel 2 that has its own threshold or more.

    So it is in any gearbox, with the ratios of the radii on the way: all that is driven through a
    mesh is one body, and wheels behind it have their own threshold or more.

    For ``f = sin`` the maximum is ``sqrt(1 + beta^2)``: the torque ``I amplitude omega^2 sqrt(1 +
    beta^2) / R``.  Below the threshold there is no rest.  Above it a motion that is at rest stays
    so, but one that rattles may go on where the restitution is high: `stationary` without noise
    lists both.  White noise opens closed teeth at any drag.

    Parameters
    ----------
    scene : Scene
        What is modelled; its noise is left out.

    Returns
    -------
    tuple of RattleThreshold
        One for each loose wheel; torques in N mm for a scene with gears.

    Raises
    ------
    InputError
        If `scene` is no Scene.

    Examples
    --------
    >>> (wheel,) = rattle_threshold(Scene(alpha=2.0, epsilon=0.7, beta1=0.0, gamma1=1.0, stages=1))
    >>> wheel.least, wheel.opens
    (2.0, True)
    """
    check_scene(scene)
    gears = scene.gears
    out = []
    c = scene.constants
    values = zip(scene.wheel_names, c.wheels["gamma"], least_drags(c), strict=True)
    for number, (name, gamma, threshold) in enumerate(values, 1):
        drag = float(gamma)
        least = float(threshold)
        unit = ""
        if gears is not None:
            at = gears.tree[number - 1]
            drag = at.torque
            # N mm of gamma = 1
            force = at.inertia * gears.units.length * gears.omega**2
            least *= force / (KG_MM_PER_S2_PER_N * at.radius)
            unit = "N mm"
        out.append(RattleThreshold(number, drag, least, unit, name))
    return tuple(out)


def least_drags(c: Constants) -> Floats:
    """The ``gamma`` of each wheel from which on its closed teeth stay closed.

    Shapes: result (wheels,).
    """
    wheels = c.wheels
    bodies = np.empty(wheels.size, BODY)
    lock(c, np.ones(wheels.size, np.int64), bodies)
    # least: of each wheel; kept: of all that is locked below its mesh, each with its own threshold
    # or more
    least = np.empty(wheels.size)
    kept = np.zeros(wheels.size)
    for i in range(wheels.size - 1, -1, -1):
        wheel = wheels[i]
        below = kept[i]
        pulls = wheel.turn * _largest_pull(c, bodies[i].beta) + wheel.stiffness * wheel.wall
        needed = pulls * bodies[i].mass
        least[i] = max((needed - below) / wheel.mass, 0.0)
        if wheel.parent >= 0:
            total = wheel.mass * max(wheel.gamma, least[i]) + below
            kept[wheel.parent] += wheel.ratio * total
    return least


def _largest_pull(c: Constants, beta: float) -> float:
    """``alpha max(-(f'' + beta f'))`` over a period."""
    if len(c.drive) == 0:
        return float(c.alpha * np.hypot(1.0, beta))
    middle = np.pi
    half = np.pi
    points = PULL_POINTS * int(c.drive.highest)
    for _ in range(ZOOMS):
        tau = np.linspace(middle - half, middle + half, points + 1)
        rates = np.array([velocity_acceleration(c.drive, t) for t in tau])
        pull = -(rates[:, 1] + beta * rates[:, 0])
        middle = tau[pull.argmax()]
        half = 2.0 * half / points
        points = PULL_POINTS
    return c.alpha * float(pull.max())
