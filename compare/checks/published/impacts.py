"""What impacts do: the laws of both meshes, the bouncing ball's chatter, and the energy that noise and drive supply.

The laws of impact are those of the rim speeds ``u1 = f' - y1`` and ``u2 = u1 + y2``, with the rims' masses
``I / R^2`` of the gears themselves: an impact at mesh 1 acts on wheel 1 alone (so that y2 is kicked by as much as y1),
one at mesh 2 on both wheels with opposite forces; each turns the relative speed at its flank into ``-epsilon`` of it
(Newton).
"""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from rattle.closure.orbit import follow
from rattle.compare.checks.check import Check, Found, self_test
from rattle.montecarlo import SCHEMES, Record, simulate
from rattle.montecarlo.long_run import LongRun, long_run
from rattle.montecarlo.long_run.estimates import corrections
from rattle.montecarlo.long_run.noise_work import CONTROLS
from rattle.montecarlo.long_run.sums import NOISE
from rattle.montecarlo.schemes.crossing import CLOSE
from rattle.scene import DAT21, Scene, Start
from rattle.scene.impact import energy_loss
from rattle.scene.types import Floats, Ints

GEARS = replace(DAT21, backlash2=0.3, epsilon=0.8)
MASS = GEARS.inertia1 / GEARS.radius1**2, GEARS.inertia2 / GEARS.radius2**2  # of the rims
IMPACTS = 24
COASTING = 8  # impacts without forces, by the schemes of the simulation
ROUNDING = 1e-11

GAMMA, EPSILON, SPEED, HALF = 1.0, 0.7, 1.0, 0.5  # of the ball
BOUNCES = 12  # impacts of its simulated path
WITHIN = 1e-15 + 4e-16 * HALF  # distance within which the orbit locates a wall

UNDRIVEN: dict[str, Any] = {"alpha": 0.0, "beta1": 0.0, "gamma1": 0.0, "sigma": 1.0}

SCENES = {
    "one stage, eps 0.3": (Scene(epsilon=0.3, gap1=1.0, stages=1, **UNDRIVEN), 64),
    "one stage, eps 0.5": (Scene(epsilon=0.5, stages=1, **UNDRIVEN), 64),
    "one stage, eps 0.9": (Scene(epsilon=0.9, stages=1, **UNDRIVEN), 64),
    "two stages, eps 0.5": (Scene(epsilon=0.5, mu=0.6, **UNDRIVEN), 64),
    "two stages, eps 0.8": (Scene(epsilon=0.8, mu=0.3, gap2=0.8, **UNDRIVEN), 64),
    "driven, damped, dragged": (Scene(alpha=1.0, epsilon=0.7, beta1=0.3, gamma1=0.1, sigma=1.0, stages=1), 128),
    "driven, weak noise": (Scene(alpha=1.5, epsilon=0.6, beta1=0.1, gamma1=0.05, sigma=0.3, stages=1), 64),
    "DAT21 at sigma 0.5": (Scene.from_gears(DAT21, sigma=0.5), 64),
}
"""Scenes, and the periods for which each is followed."""


class Impacts(NamedTuple):
    """Speeds of both wheels' rims before and after impacts, and the driver's speed."""

    mesh: Ints  # (impacts,)
    driver: Floats  # (impacts,)
    before: Floats  # before, after: (impacts, 2)
    after: Floats


def _rims(driver: Floats, y1: Floats, y2: Floats) -> Floats:
    return np.column_stack([driver - y1, driver - y1 + y2])


def _follow_orbit() -> tuple[Impacts, Floats]:
    """Impacts of the orbit with all forces; and the energy that the program says each has taken."""
    scene = Scene.from_gears(GEARS)
    orbit = follow(scene, IMPACTS)
    before, after, mesh = orbit.before[1:], orbit.after[1:], orbit.mesh[1:]
    driver = scene.alpha * np.cos(orbit.tau[1:])
    c = scene.constants
    lost = np.array([energy_loss(c, int(m), y1, y2) for m, (_, y1, _, y2) in zip(mesh, before, strict=True)])
    return Impacts(mesh, driver, _rims(driver, *before[:, 1::2].T), _rims(driver, *after[:, 1::2].T)), lost


def _coast(scheme: str) -> Impacts:
    """Impacts of a path without drive, damping, drag and noise: the speeds after each are those before the next."""
    free = replace(GEARS, alpha=0.0, damping1=0.0, damping2=0.0, torque1=0.0, torque2=0.0)
    scene = replace(Scene.from_gears(free), start=Start(0.0, 0.1, 1.3, -0.2, -0.7))
    run = simulate(scene, paths=1, impacts=COASTING, dt=2.0**-5, scheme=scheme, record=Record(raw=True))
    assert run.raw is not None
    rows = run.raw[0]
    speeds = _rims(np.zeros(len(rows)), rows[:, 3], rows[:, 5])
    return Impacts(np.abs(rows[:-1, 6]).astype(np.int64), np.zeros(len(rows) - 1), speeds[:-1], speeds[1:])


def _laws(who: str, i: Impacts, mass: tuple[float, float], epsilon: float) -> list[Check]:
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
    relative = 0.5 * ((i.driver - i.before[:, 0]) ** 2 - (i.driver - i.after[:, 0]) ** 2)
    gone = np.where(i.mesh == 1, relative, 0.5 * ((i.before**2 - i.after**2) @ (np.array(mass) / mass[0])))
    return [
        Check(f"energy lost at mesh {k}, orbit", float(lost[at].sum()), float(gone[at].sum()), 0.0, ROUNDING * IMPACTS)
        for k in (1, 2)
        for at in (i.mesh == k,)
    ]


@self_test
def impact_laws(seed: int = 0, workers: int = 2) -> Found:
    """Check momentum, restitution and energy of the impacts at both meshes, of the orbit and of every scheme."""
    orbit, lost = _follow_orbit()
    sides = {"orbit": orbit} | {scheme: _coast(scheme) for scheme in SCHEMES}

    def checks(mass: tuple[float, float] = MASS, epsilon: float = GEARS.epsilon) -> list[Check]:
        laws = [check for who, impacts in sides.items() for check in _laws(who, impacts, mass, epsilon)]
        return laws + _energy(orbit, lost, mass)

    return checks(), {
        "masses of the wheels interchanged": checks(mass=MASS[::-1]),
        "restitution 0.1 % larger": checks(epsilon=1.001 * GEARS.epsilon),
    }


@self_test
def bouncing_ball(seed: int = 0, workers: int = 2) -> Found:
    """Check flights and time to rest of one stage under constant drag, for the orbit and for a simulated path.

    With ``alpha = beta = sigma = 0`` Eq. 3 is ``y' = gamma``: an impact at speed v is followed by a flight of
    ``2 epsilon v / gamma`` and an impact at ``epsilon v``, so that all flights add up to ``t1 / (1 - epsilon)``.
    """
    start = Start(0.0, HALF, SPEED, mesh=1)
    scene = Scene(alpha=0.0, epsilon=EPSILON, beta1=0.0, gamma1=GAMMA, gap1=HALF, start=start, stages=1)
    orbit = follow(scene, 40)
    run = simulate(scene, paths=1, impacts=BOUNCES, scheme="exact-flight", record=Record(raw=True))
    assert run.raw is not None
    # times of the impacts, each located within a distance of its wall
    sides = {"orbit": (orbit.tau, WITHIN), "exact-flight": (np.append(0.0, run.raw[0, :, 0]), CLOSE * HALF)}

    def checks(epsilon: float = EPSILON) -> list[Check]:
        """Worst flight time, and the time to rest."""
        out, first = [], 2.0 * epsilon * SPEED / GAMMA
        for who, (tau, close) in sides.items():
            flights = np.diff(tau)
            exact = first * epsilon ** np.arange(flights.size)
            slack = 2.0 * close / (0.5 * GAMMA * flights[-1]) / (1.0 - EPSILON)  # close / speed at both ends of each
            k = int(np.argmax(np.abs(flights - exact)))
            name = f"flight {k + 1} of {flights.size}, {who}"
            out.append(Check(name, float(flights[k]), first * epsilon**k, 0.0, slack))
            rest = float(tau[-1] - tau[0] + flights[-1] * epsilon / (1.0 - epsilon))
            out.append(Check(f"time to rest, {who}", rest, first / (1.0 - epsilon), 0.0, slack))
        return out

    return checks(), {"epsilon 1 % larger": checks(1.01 * EPSILON), "epsilon squared": checks(EPSILON**2)}


def _balance(name: str, run: LongRun, kept: float = 1.0, noise: float = 1.0) -> Check:
    """Loss against supply; `kept` of the loss is counted, and the noise supplies `noise` times what it does.

    Of their difference, the noise's own work, whose mean is zero, explains most of the variance.
    """
    lost, supplied = run.energy_balance()
    difference, work = kept * lost - supplied, run.sums.main[:, :, NOISE : NOISE + CONTROLS].sum(axis=1)
    difference -= (work[:, :, None] * corrections(difference[:, None], work)).sum(axis=(1, 2))
    se = float(difference.std(ddof=1)) / math.sqrt(run.paths)
    closed = max(run.estimates[f"contact_share_mesh{m}"].value for m in range(1, run.scene.stages + 1))
    found, power = float((supplied + difference).mean()), _noise_power(run.scene)
    truth = float(supplied.mean()) + (noise - 1.0) * power
    return Check(f"loss per time, {name}", found, truth, se, 2.0 * closed * power)


def _noise_power(scene: Scene) -> float:
    """What the noise supplies per unit of time."""
    mass = scene.mu / (1.0 - scene.mu) if scene.stages == 2 else 0.0
    return 0.25 * scene.sigma**2 * (1.0 + scene.beta1**2 + mass * (1.0 + scene.beta2**2))


@self_test
def energy_law(seed: int = 0, workers: int = 2) -> Found:
    """Check the energy balance of eight long runs, driven and not, of one stage and of two."""
    runs = {
        name: long_run(scene, periods=periods, rng=seed + 31 * i, workers=workers)
        for i, (name, (scene, periods)) in enumerate(SCENES.items())
    }
    two = {name: run for name, run in runs.items() if run.scene.stages == 2}
    light = {name: replace(run, scene=replace(run.scene, mu=0.98 * run.scene.mu)) for name, run in two.items()}
    return [_balance(name, run) for name, run in runs.items()], {
        **{f"2 % of the loss missing, {n}": [_balance(n, run, 0.98)] for n, run in runs.items()},
        "2 % less mass of wheel 2": [_balance(name, run) for name, run in light.items()],
        "noise of 2 % more energy": [_balance(name, run, 1.0, 1.02) for name, run in runs.items()],
    }
