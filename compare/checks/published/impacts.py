"""Impacts and the orbits that they make: laws and energy, the bouncing ball's chatter, periodic
orbits that are known.

The laws of impact are those of the rim speeds ``u1 = f' - y1`` and ``u2 = u1 + y2``, with the rims'
masses ``I / R^2``: an impact at mesh 1 acts on wheel 1 alone (so that y2 is kicked by as much as
y1), one at mesh 2 on both wheels with opposite forces; each turns the relative speed at its flank
into ``-epsilon`` of it (Newton).  The sum of all exponents is the rate at which damping and impacts
contract volumes of state space.

Basins are those of a published gear-rattling model (De Souza and Caldas 2001): ``s'' + beta s' =
gamma + alpha (sin t - beta cos t)`` between walls at -1 and 0; with ``x1 = s + 1/2`` and ``tau = t
+ pi`` one stage of this model.  Equation, values and figure (1200 x 1200 starts) are from
Wagemakers, "The Basins Zoo" (2025), arXiv:2504.01580.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from rattle.closure.stationary import linear_law
from rattle.compare.chaos.exponents import drift_exponents, lyapunov
from rattle.compare.checks.check import Check, Found, bare
from rattle.compare.report.texts import read_file
from rattle.montecarlo import SCHEMES, Record, simulate
from rattle.montecarlo.long_run import LongRun, long_run
from rattle.montecarlo.long_run.estimates import corrections
from rattle.montecarlo.long_run.noise_work import CONTROLS
from rattle.montecarlo.long_run.sums import NOISE
from rattle.montecarlo.schemes.crossing import CLOSE_TO_WALL
from rattle.scene import DAT21, Floats, Ints, Scene, Start
from rattle.scene.impact import energy_loss
from rattle.scene.long_orbit import PERIOD, LongOrbit, attractor
from rattle.scene.orbit import follow

TWO_STAGES = replace(DAT21, backlash2=0.3, epsilon=0.8)
# of the rims
RIM_MASSES = (
    TWO_STAGES.inertia1 / TWO_STAGES.radius1**2,
    TWO_STAGES.inertia2 / TWO_STAGES.radius2**2,
)
CHECKED_IMPACTS = 24  # of the orbit whose laws are checked
COASTING = 8  # impacts without forces, by the schemes of the simulation
LAW_ROUNDING = 1e-11  # of the laws of impact

# of the ball
GAMMA = 1.0
EPSILON = 0.7
START_SPEED = 1.0
PAIR_HALF_GAP = 0.5
SIMULATED_BOUNCES = 12  # impacts of its simulated path
WITHIN = 1e-15 + 4e-16 * PAIR_HALF_GAP  # distance within which the orbit locates a wall

SCENES = {
    "one stage, eps 0.3": (bare(epsilon=0.3, gap1=1.0, sigma=1.0), 64),
    "one stage, eps 0.5": (bare(epsilon=0.5, sigma=1.0), 64),
    "one stage, eps 0.9": (bare(epsilon=0.9, sigma=1.0), 64),
    "two stages, eps 0.5": (bare(epsilon=0.5, mu=0.6, sigma=1.0, stages=2), 64),
    "two stages, eps 0.8": (bare(epsilon=0.8, mu=0.3, gap2=0.8, sigma=1.0, stages=2), 64),
    "driven, damped, dragged": (
        Scene(alpha=1.0, epsilon=0.7, beta1=0.3, gamma1=0.1, sigma=1.0, stages=1),
        128,
    ),
    "driven, weak noise": (
        Scene(alpha=1.5, epsilon=0.6, beta1=0.1, gamma1=0.05, sigma=0.3, stages=1),
        64,
    ),
    "DAT21 at sigma 0.5": (Scene.from_gears(DAT21, sigma=0.5), 64),
}
"""Scenes, and the periods for which each is followed."""


class ImpactSpeeds(NamedTuple):
    """Speeds of both wheels' rims before and after impacts, and the driver's speed."""

    mesh: Ints  # (impacts,)
    driver: Floats  # (impacts,)
    before: Floats  # before, after: (impacts, 2)
    after: Floats


def _rims(driver: Floats, y1: Floats, y2: Floats) -> Floats:
    return np.column_stack([driver - y1, driver - y1 + y2])


def _follow_orbit() -> tuple[ImpactSpeeds, Floats]:
    """Impacts of the orbit with all forces; and the energy that the program says each has taken."""
    scene = Scene.from_gears(TWO_STAGES)
    orbit = follow(scene, CHECKED_IMPACTS)
    before = orbit.before[1:]
    after = orbit.after[1:]
    mesh = orbit.mesh[1:]
    driver = scene.alpha * np.cos(orbit.tau[1:])
    c = scene.constants
    lost = np.array(
        [energy_loss(c, int(m), y1, y2) for m, (_, y1, _, y2) in zip(mesh, before, strict=True)]
    )
    return (
        ImpactSpeeds(
            mesh, driver, _rims(driver, *before[:, 1::2].T), _rims(driver, *after[:, 1::2].T)
        ),
        lost,
    )


def _coast(scheme: str) -> ImpactSpeeds:
    """Impacts of a path without drive, damping, drag and noise: the speeds after each are those
    before the next."""
    free = replace(TWO_STAGES, alpha=0.0, damping1=0.0, damping2=0.0, torque1=0.0, torque2=0.0)
    scene = replace(Scene.from_gears(free), start=Start(0.0, 0.1, 1.3, -0.2, -0.7))
    run = simulate(
        scene, paths=1, impacts=COASTING, dt=2.0**-5, scheme=scheme, record=Record(raw=True)
    )
    assert run.raw is not None
    rows = run.raw[0]
    speeds = _rims(np.zeros(len(rows)), rows[:, 3], rows[:, 5])
    return ImpactSpeeds(
        np.abs(rows[:-1, 6]).astype(np.int64), np.zeros(len(rows) - 1), speeds[:-1], speeds[1:]
    )


def _laws(who: str, i: ImpactSpeeds, mass: tuple[float, float], epsilon: float) -> list[Check]:
    """Largest violation of each law over the impacts at its mesh."""
    first = i.mesh == 1
    second = i.mesh == 2
    u = i.before
    v = i.after
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
        Check(
            f"{law}, {who}",
            float(np.abs(wrong).max(initial=0.0)) if wrong.size else math.nan,
            0.0,
            0.0,
            LAW_ROUNDING,
        )
        for law, wrong in laws.items()
    ]


def _energy(i: ImpactSpeeds, lost: Floats, mass: tuple[float, float]) -> list[Check]:
    """Energy that leaves both wheels at mesh 2, and what wheel 1 loses relative to the driver at
    mesh 1."""
    relative = 0.5 * ((i.driver - i.before[:, 0]) ** 2 - (i.driver - i.after[:, 0]) ** 2)
    gone = np.where(
        i.mesh == 1, relative, 0.5 * ((i.before**2 - i.after**2) @ (np.array(mass) / mass[0]))
    )
    sums = {k: (float(lost[i.mesh == k].sum()), float(gone[i.mesh == k].sum())) for k in (1, 2)}
    return [
        Check(f"energy lost at mesh {k}, orbit", *sums[k], 0.0, LAW_ROUNDING * CHECKED_IMPACTS)
        for k in sums
    ]


def impact_laws(seed: int = 0, workers: int = 2) -> Found:
    """Check momentum, restitution and energy of the impacts at both meshes, of the orbit and of
    every scheme."""
    orbit, lost = _follow_orbit()
    sides = {"orbit": orbit} | {scheme: _coast(scheme) for scheme in SCHEMES}

    def checks(
        mass: tuple[float, float] = RIM_MASSES, epsilon: float = TWO_STAGES.epsilon
    ) -> list[Check]:
        laws = [
            check for who, impacts in sides.items() for check in _laws(who, impacts, mass, epsilon)
        ]
        return laws + _energy(orbit, lost, mass)

    return checks(), {
        "masses of the wheels interchanged": checks(mass=RIM_MASSES[::-1]),
        "restitution 0.1 % larger": checks(epsilon=1.001 * TWO_STAGES.epsilon),
    }


def bouncing_ball(seed: int = 0, workers: int = 2) -> Found:
    """Check flights and time to rest of one stage under constant drag, for the orbit and for a
    simulated path.

    With ``alpha = beta = sigma = 0`` Eq. 3 is ``y' = gamma``: an impact at speed v is followed by a
    flight of ``2 epsilon v / gamma`` and an impact at ``epsilon v``, so that all flights add up to
    ``t1 / (1 - epsilon)``.
    """
    start = Start(0.0, PAIR_HALF_GAP, START_SPEED, mesh=1)
    scene = bare(epsilon=EPSILON, gamma1=GAMMA, gap1=PAIR_HALF_GAP, start=start)
    orbit = follow(scene, 40)
    run = simulate(
        scene, paths=1, impacts=SIMULATED_BOUNCES, scheme="exact-flight", record=Record(raw=True)
    )
    assert run.raw is not None
    # times of the impacts, each located within a distance of its wall
    sides = {
        "orbit": (orbit.tau, WITHIN),
        "exact-flight": (np.append(0.0, run.raw[0, :, 0]), CLOSE_TO_WALL * PAIR_HALF_GAP),
    }

    def checks(epsilon: float = EPSILON) -> Iterator[Check]:
        """Worst flight time, and the time to rest."""
        first = 2.0 * epsilon * START_SPEED / GAMMA
        for who, (tau, close) in sides.items():
            flights = np.diff(tau)
            exact = first * epsilon ** np.arange(flights.size)
            # close / speed at both ends of each
            slack = 2.0 * close / (0.5 * GAMMA * flights[-1]) / (1.0 - EPSILON)
            k = int(np.argmax(np.abs(flights - exact)))
            name = f"flight {k + 1} of {flights.size}, {who}"
            yield Check(name, float(flights[k]), first * epsilon**k, 0.0, slack)
            rest = float(tau[-1] - tau[0] + flights[-1] * epsilon / (1.0 - epsilon))
            yield Check(f"time to rest, {who}", rest, first / (1.0 - epsilon), 0.0, slack)

    return checks(), {
        "epsilon 1 % larger": checks(1.01 * EPSILON),
        "epsilon squared": checks(EPSILON**2),
    }


def _balance(name: str, run: LongRun, kept: float = 1.0, noise: float = 1.0) -> Check:
    """Loss against supply; `kept` of the loss is counted, and the noise supplies `noise` times what
    it does.

    Of their difference, the noise's own work, whose mean is zero, explains most of the variance.
    """
    lost, supplied = run.energy_balance()
    difference = kept * lost - supplied
    work = run.sums.main[:, :, NOISE : NOISE + CONTROLS].sum(axis=1)
    difference -= (work[:, :, None] * corrections(difference[:, None], work)).sum(axis=(1, 2))
    se = float(difference.std(ddof=1)) / math.sqrt(run.paths)
    closed = max(
        run.estimates[f"contact_share_mesh{m}"].value for m in range(1, run.scene.stages + 1)
    )
    found = float((supplied + difference).mean())
    power = _noise_power(run.scene)
    truth = float(supplied.mean()) + (noise - 1.0) * power
    return Check(f"loss per time, {name}", found, truth, se, 2.0 * closed * power)


def _noise_power(scene: Scene) -> float:
    """What the noise supplies per unit of time."""
    mass = scene.mu / (1.0 - scene.mu) if scene.stages == 2 else 0.0
    return 0.25 * scene.sigma**2 * (1.0 + scene.beta1**2 + mass * (1.0 + scene.beta2**2))


def energy_law(seed: int = 0, workers: int = 2) -> Found:
    """Check the energy balance of eight long runs, driven and not, of one stage and of two."""
    runs = {
        name: long_run(scene, periods=periods, rng=seed + 31 * i, workers=workers)
        for i, (name, (scene, periods)) in enumerate(SCENES.items())
    }
    two = {name: run for name, run in runs.items() if run.scene.stages == 2}
    light = {
        name: replace(run, scene=replace(run.scene, mu=0.98 * run.scene.mu))
        for name, run in two.items()
    }
    return [_balance(name, run) for name, run in runs.items()], {
        **{f"2 % of the loss missing, {n}": [_balance(n, run, 0.98)] for n, run in runs.items()},
        "2 % less mass of wheel 2": [_balance(name, run) for name, run in light.items()],
        "noise of 2 % more energy": [_balance(name, run, 1.0, 1.02) for name, run in runs.items()],
    }


# alpha, epsilon; with half gaps of 0.5 these orbits are stable
CASES = ((0.25, 0.5), (0.2, 0.6), (0.3, 0.4))
# noise and periods of the noisy run, of the first case
WEAK = 1e-3
CHECKED_PERIODS = 256
SLACK = 2e-6  # orbits are found to 1e-8 of their state

# of the sum of the exponents, and of its noisy path
LONG_ORBIT = 20_000
PATH_SIGMA = 0.1
# alpha, epsilon; stable, with two different exponents each
IMPACT_PAIRS = ((0.35, 0.4), (0.35, 0.25), (0.15, 0.35))
PAIR_IMPACTS = 10_000
EXPONENT_ROUNDING = 1e-10


def symmetric_orbit(alpha: float, epsilon: float, gap: float) -> tuple[float, float]:
    """Phase and speed of the impacts of the symmetric orbit (Masri and Caughey 1966)."""
    k = 0.5 * math.pi * (1.0 + epsilon) / (1.0 - epsilon)
    tau = math.asin(gap / (alpha * math.hypot(1.0, k))) - math.atan(k)
    return tau, 2.0 * alpha * math.cos(tau) / (1.0 - epsilon)


def _pair(alpha: float, epsilon: float, sigma: float = 0.0) -> Scene:
    return bare(alpha=alpha, epsilon=epsilon, gap1=PAIR_HALF_GAP, sigma=sigma)


def impact_pair(seed: int = 0, workers: int = 2) -> Found:
    """Check phase and speed of the impacts of three symmetric orbits, and the sds that weak noise
    gives them."""
    orbits = {case: attractor(_pair(*case)) for case in CASES}
    noisy = _pair(*CASES[0], WEAK)
    law = linear_law(noisy, orbits[CASES[0]])
    found = long_run(noisy, periods=CHECKED_PERIODS, rng=seed, workers=workers).estimates

    def states(factor: float = 1.0) -> Iterator[Check]:
        """Phase (modulo half a period) and speed of the impacts."""
        for (alpha, epsilon), a in orbits.items():
            tau, speed = symmetric_orbit(alpha, factor * epsilon, PAIR_HALF_GAP)
            phase = float((a.tau[-1] - tau + 0.5 * math.pi) % math.pi - 0.5 * math.pi)
            name = f"alpha {alpha}, eps {epsilon}"
            yield Check(f"phase less its truth, {name}", phase, 0.0, 0.0, 2e-7)
            yield Check(f"speed, {name}", float(np.abs(a.before[-1, 1])), speed, 0.0, 2e-7 * speed)

    def spreads(factor: float = 1.0) -> Iterator[Check]:
        for q, sds in (("sd_speed", law.sd_speed), ("sd_flight", law.sd_flight)):
            truth = float(np.sqrt((law.weight * sds**2).sum()))
            name = f"{q} / sigma, alpha {CASES[0][0]}, eps {CASES[0][1]}"
            yield Check(
                name, found[q].value / WEAK, factor * truth / WEAK, found[q].se / WEAK, SLACK
            )

    return [*states(), *spreads()], {
        "restitution 0.1 % larger": states(1.001),
        "sds 2 % larger": spreads(1.02),
    }


def exponent_sum(seed: int = 0, workers: int = 2) -> Found:
    """Check the sum of the four exponents of DAT21: of the orbit, and of the drift along a noisy
    path."""
    scene = Scene.from_gears(DAT21)
    records = (
        lyapunov(scene, impacts=LONG_ORBIT),
        drift_exponents(scene.with_sigma(PATH_SIGMA), impacts=LONG_ORBIT, seed=seed),
    )
    both = scene.beta1 + scene.beta2

    def checks(power: float = 2.0, damping: float = both) -> Iterator[Check]:
        for found in records:
            truth = -damping + found.rate * power * math.log(scene.epsilon)
            yield Check(
                f"sum of exponents, {found.of}",
                float(found.value.sum()),
                truth,
                0.0,
                EXPONENT_ROUNDING,
            )

    return checks(), {
        "epsilon to the first power": checks(power=1.0),
        "damping of one stage alone": checks(damping=scene.beta1),
        "1 % more damping": checks(damping=1.01 * both),
    }


def _exponents(alpha: float, epsilon: float) -> tuple[float, float]:
    """Both exponents, from trace and determinant of the map of (dx, dy) from one impact to the
    next.

    A flight of pi takes dx to dx + pi dy.  An impact at the speed v and the acceleration a towards
    the gap takes (dx, dy) to -(epsilon dx, epsilon dy - (1 + epsilon) a dx / v).
    """
    tau, speed = symmetric_orbit(alpha, epsilon, PAIR_HALF_GAP)
    half = 0.5 * math.pi * (1.0 + epsilon) * -alpha * math.sin(tau) / speed - epsilon
    split = math.sqrt(half**2 - epsilon**2)
    first, second = sorted((abs(half + split), abs(half - split)), reverse=True)
    return math.log(first) / math.pi, math.log(second) / math.pi


def _without_saltation(alpha: float, epsilon: float) -> tuple[float, float]:
    """The same where an impact takes (dx, dy) to (dx, -epsilon dy)."""
    return 0.0, math.log(epsilon) / math.pi


def orbit_exponents(seed: int = 0, workers: int = 2) -> Found:
    """Check both exponents of three symmetric orbits: the tangent frames through flights and
    impacts."""
    found = {case: lyapunov(_pair(*case), impacts=PAIR_IMPACTS).value for case in IMPACT_PAIRS}

    def checks(truth: Callable[[float, float], tuple[float, float]]) -> Iterator[Check]:
        for (a, e), exponents in found.items():
            for i, exact in enumerate(truth(a, e)):
                yield Check(
                    f"exponent {i + 1}, alpha {a}, eps {e}",
                    float(exponents[i]),
                    exact,
                    0.0,
                    EXPONENT_ROUNDING,
                )

    return checks(_exponents), {
        "impacts without the saltation term": checks(_without_saltation),
        "restitution 0.1 % larger": checks(
            lambda alpha, epsilon: _exponents(alpha, 1.001 * epsilon)
        ),
    }


GEARS = Scene(alpha=0.48, epsilon=0.9, beta1=0.1, gamma1=0.1, stages=1)
# of the figure of basins: s from left to right, its velocity from bottom to top
FRAME = (-0.99, -0.02), (-1.0, 1.0)
FIGURE = read_file("checks.published", "basins.md")
"""The figure: impacts a period of the motion at each place whose surroundings have one colour."""
# of the coloured pixels of the figure as printed; a side of it
COLOURED_SHARE = 0.3821
PIXELS = 334
BASIN_STARTS = 6000
# impacts of a stretch, and the most stretches until an orbit repeats
REPEAT_IMPACTS = 120
MOST_STRETCHES = 24
SAME_ORBIT = 1e-6


def _impacts_a_period(scene: Scene, starts: Iterable[Any], phase: float = math.pi) -> Floats:
    """Impacts in a period of the motion that is reached from each start ``(s, s')``; NaN for
    another one."""
    found = []
    for s, velocity in starts:
        orbit = LongOrbit(replace(scene, start=Start(phase, s + 0.5, velocity)))
        found.append(math.nan)
        for _ in range(MOST_STRETCHES):
            flight = orbit.stretch(REPEAT_IMPACTS, tangent=False).flight
            if flight.size < REPEAT_IMPACTS:  # at rest
                break
            number = REPEAT_IMPACTS / 2 * PERIOD / flight[REPEAT_IMPACTS // 2 :].sum()
            if abs(number - round(number)) < SAME_ORBIT:
                found[-1] = round(number)
                break
    return np.array(found)


def _in_frame(across: Floats, up: Floats) -> Floats:
    """Starts at places of the figure, 0 to 1; shape (starts, 2)."""
    (left, right), (bottom, top) = FRAME
    return np.column_stack([left + (right - left) * across, bottom + (top - bottom) * up])


def gear_rattle_basins(seed: int = 0, workers: int = 2) -> Found:
    """Check from which starts each of two coexisting motions is reached, and the share of all
    starts."""
    lines = FIGURE.split()
    cells = [(i, j, int(c)) for i, line in enumerate(lines) for j, c in enumerate(line) if c != "."]
    row, column, printed = np.array(cells).T
    places = _in_frame((column + 0.5) / len(lines), 1.0 - (row + 0.5) / len(lines))

    def differ(scene: Scene = GEARS, phase: float = math.pi) -> list[Check]:
        other = _impacts_a_period(scene, places, phase) != printed
        return [
            Check(f"places of {len(cells)} that differ from the figure", float(other.sum()), 0.0)
        ]

    rng = np.random.default_rng(seed)
    three = _impacts_a_period(GEARS, _in_frame(*rng.uniform(size=(2, BASIN_STARTS)))) == 3.0
    se = float(three.std()) * math.sqrt(1.0 / BASIN_STARTS + 1.0 / PIXELS**2)
    share = Check(
        "share of starts that end in three impacts a period",
        float(three.mean()),
        COLOURED_SHARE,
        se,
    )
    return [*differ(), share], {
        "restitution 0.88": differ(replace(GEARS, epsilon=0.88)),
        "drive 5 % smaller": differ(replace(GEARS, alpha=0.95 * GEARS.alpha)),
        "drag 20 % larger": differ(replace(GEARS, gamma1=1.2 * GEARS.gamma1)),
        "drag on the other flank": differ(phase=0.0),
    }
