"""The laws of impact at both meshes: what a flank must do to the speeds of the wheels, whatever is written for it.

In rim speeds ``u1 = f' - y1`` and ``u2 = u1 + y2`` with the rims' masses ``I / R^2`` of the gears themselves: an impact
at mesh 1 acts on wheel 1 alone (so that y2 is kicked by as much as y1), one at mesh 2 on both wheels with opposite
forces; each turns the relative speed at its flank into ``-epsilon`` of it (Newton).
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.closure.orbit import follow
from rattle.compare.checks.check import Check, Result
from rattle.montecarlo import SCHEMES, Record, simulate
from rattle.scene import DAT21, Gears, Scene, Start
from rattle.scene.impact import energy_loss

Floats = NDArray[np.float64]

GEARS = replace(DAT21, backlash2=0.3, epsilon=0.8)
IMPACTS = 24
COASTING = 8  # impacts without forces, by the schemes of the simulation
ROUNDING = 1e-11


class Impacts(NamedTuple):
    """Speeds of both wheels' rims before and after impacts, and the driver's speed."""

    mesh: NDArray[np.int64]  # (impacts,)
    driver: Floats  # (impacts,)
    before: Floats  # before, after: (impacts, 2)
    after: Floats


def _rims(driver: Floats, y1: Floats, y2: Floats) -> Floats:
    return np.column_stack([driver - y1, driver - y1 + y2])


def _orbit(gears: Gears) -> tuple[Impacts, Floats]:
    """Impacts of the orbit with all forces; and the energy that the program says each has taken."""
    scene = Scene.from_gears(gears)
    orbit = follow(scene, IMPACTS)
    before, after, mesh = orbit.before[1:], orbit.after[1:], orbit.mesh[1:]
    driver = scene.alpha * np.cos(orbit.tau[1:])
    c = scene.constants
    lost = np.array([energy_loss(c, int(m), y1, y2) for m, (_, y1, _, y2) in zip(mesh, before, strict=True)])
    return Impacts(mesh, driver, _rims(driver, *before[:, 1::2].T), _rims(driver, *after[:, 1::2].T)), lost


def _coasting(gears: Gears, scheme: str) -> Impacts:
    """Impacts of a path without drive, damping, drag and noise: the speeds after each are those before the next."""
    free = replace(gears, alpha=0.0, damping1=0.0, damping2=0.0, torque1=0.0, torque2=0.0)
    scene = replace(Scene.from_gears(free), start=Start(0.0, 0.1, 1.3, -0.2, -0.7))
    run = simulate(scene, paths=1, impacts=COASTING, dt=2.0**-5, scheme=scheme, record=Record(raw=True))
    assert run.raw is not None
    rows = run.raw[0]
    speeds = _rims(np.zeros(len(rows)), rows[:, 3], rows[:, 5])
    return Impacts(np.abs(rows[:-1, 6]).astype(np.int64), np.zeros(len(rows) - 1), speeds[:-1], speeds[1:])


def _checks(who: str, i: Impacts, gears: Gears, mass: tuple[float, float], epsilon: float) -> list[Check]:
    """Largest violation of each law over the impacts at its mesh."""
    first, second = i.mesh == 1, i.mesh == 2
    u, v = i.before, i.after
    momentum = (v - u) @ np.array(mass) / sum(mass)
    approach = {1: (i.driver - u[:, 0])[first], 2: (u[:, 1] - u[:, 0])[second]}
    parting = {1: (i.driver - v[:, 0])[first], 2: (v[:, 1] - v[:, 0])[second]}
    laws = {
        "mesh 1 leaves wheel 2 alone": (v - u)[first, 1],
        "restitution at mesh 1": parting[1] + epsilon * approach[1],
        "momentum of both wheels at mesh 2": momentum[second],
        "restitution at mesh 2": parting[2] + epsilon * approach[2],
    }
    return [
        Check(f"{law}, {who}", float(np.abs(wrong).max(initial=0.0)) if wrong.size else math.nan, 0.0, 0.0, ROUNDING)
        for law, wrong in laws.items()
    ]


def _energy(i: Impacts, lost: Floats, mass: tuple[float, float]) -> list[Check]:
    """Energy that leaves both wheels at mesh 2, and what wheel 1 loses relative to the driver at mesh 1."""
    m = np.array(mass) / mass[0]
    gone = np.where(
        i.mesh == 1,
        0.5 * ((i.driver - i.before[:, 0]) ** 2 - (i.driver - i.after[:, 0]) ** 2),
        0.5 * ((i.before**2 - i.after**2) @ m),
    )
    return [
        Check(
            f"energy lost at mesh {k}, orbit",
            float(lost[i.mesh == k].sum()),
            float(gone[i.mesh == k].sum()),
            0.0,
            ROUNDING * IMPACTS,
        )
        for k in (1, 2)
    ]


def impact_laws(seed: int = 0, workers: int = 2) -> Result:
    """Check momentum, restitution and energy of the impacts at both meshes, of the orbit and of every scheme."""
    orbit, lost = _orbit(GEARS)
    sides = {"orbit": orbit} | {scheme: _coasting(GEARS, scheme) for scheme in SCHEMES}
    mass = GEARS.inertia1 / GEARS.radius1**2, GEARS.inertia2 / GEARS.radius2**2

    def checks(mass: tuple[float, float] = mass, epsilon: float = GEARS.epsilon) -> list[Check]:
        laws = [check for who, i in sides.items() for check in _checks(who, i, GEARS, mass, epsilon)]
        return laws + _energy(orbit, lost, mass)

    return Result(
        "impact laws",
        "Newton's restitution; momentum and energy of the wheels",
        "mesh 1 acts on wheel 1 alone, mesh 2 keeps the momentum of both wheels, and each flank returns epsilon of its "
        "speed: follow(), simulate() with every scheme, energy_loss()",
        checks(),
        {
            "masses of the wheels interchanged": checks(mass=mass[::-1]),
            "restitution 0.1 % larger": checks(epsilon=1.001 * GEARS.epsilon),
        },
    )
