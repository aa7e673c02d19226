"""Impacts and the orbits that they make: laws and energy, the bouncing ball's chatter, periodic
orbits that are known.

The laws of impact are those of the rim speeds ``u1 = f' - y1`` and ``u2 = u1 + y2``, here relative
to the driver's f', with the rims' masses ``I / R^2``: an impact at mesh 1 acts on wheel 1 alone (so
that y2 is kicked by as much as y1), one at mesh 2 on both wheels with opposite forces; each turns
the relative speed at its flank into ``-epsilon`` of it (Newton).  The sum of all exponents is the
rate at which damping and impacts contract volumes of state space.

Basins are those of a published gear-rattling model (De Souza and Caldas 2001): ``s'' + beta s' =
gamma + alpha (sin t - beta cos t)`` between walls at -1 and 0; with ``x1 = s + 1/2`` and ``tau = t
+ pi`` one stage of this model.  Equation, values and figure (1200 x 1200 starts) are from
Wagemakers, "The Basins Zoo" (2025), arXiv:2504.01580.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rattle.closure.stationary import linear_law
from rattle.compare.chaos.exponents import drift_exponents, lyapunov
from rattle.compare.checks.check import Check, Checks, Found, bare
from rattle.compare.report.texts import read_file
from rattle.montecarlo import SCHEMES, Record, simulate
from rattle.montecarlo.long_run import LongRun, long_run
from rattle.montecarlo.long_run.estimates import corrections
from rattle.montecarlo.long_run.noise_work import CONTROLS
from rattle.montecarlo.long_run.sums import NOISE
from rattle.montecarlo.schemes.crossing import CLOSE_TO_WALL
from rattle.scene import DAT21, Floats, Ints, Scene, Start
from rattle.scene.drive import PERIOD
from rattle.scene.impact import energy_loss
from rattle.scene.long_orbit import LongOrbit, attractor
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

DRIVEN = "driven, damped, dragged"
SCENES = {
    "one stage, eps 0.3": bare(epsilon=0.3, gap1=1.0, sigma=1.0),
    "one stage, eps 0.5": bare(sigma=1.0),
    "one stage, eps 0.9": bare(epsilon=0.9, sigma=1.0),
    "two stages, eps 0.5": bare(mu=0.6, sigma=1.0, stages=2),
    "two stages, eps 0.8": bare(epsilon=0.8, mu=0.3, gap2=0.8, sigma=1.0, stages=2),
    DRIVEN: bare(alpha=1.0, epsilon=0.7, beta1=0.3, gamma1=0.1, sigma=1.0),
    "driven, weak noise": bare(alpha=1.5, epsilon=0.6, beta1=0.1, gamma1=0.05, sigma=0.3),
    "DAT21 at sigma 0.5": Scene.from_gears(DAT21, sigma=0.5),
}
PERIODS = {DRIVEN: 128}
"""Periods for which a scene is followed, if not `USUAL_PERIODS`."""
USUAL_PERIODS = 64


class ImpactVelocities(NamedTuple):
    """Velocities (y1, y2) before and after impacts; shapes (impacts,) and (impacts, 2)."""

    mesh: Ints
    before: Floats
    after: Floats

    def rim_speeds(self) -> tuple[Floats, Floats]:
        """Speeds of both wheels' rims relative to the driver, before and after each impact."""
        before, after = (
            np.column_stack([-y[:, 0], y[:, 1] - y[:, 0]]) for y in (self.before, self.after)
        )
        return before, after


def _coast(scheme: str) -> ImpactVelocities:
    """Impacts of a path without drive, damping, drag and noise: the speeds after each are those
    before the next."""
    free = replace(TWO_STAGES, alpha=0.0, damping1=0.0, damping2=0.0, torque1=0.0, torque2=0.0)
    scene = replace(Scene.from_gears(free), start=Start(0.0, 0.1, 1.3, -0.2, -0.7))
    run = simulate(
        scene, paths=1, impacts=COASTING, dt=2.0**-5, scheme=scheme, record=Record(raw=True)
    )
    assert run.raw is not None
    velocities = run.raw[0][:, [3, 5]]
    code = run.raw[0][:-1, 6]
    return ImpactVelocities(np.abs(code).astype(np.int64), velocities[:-1], velocities[1:])


def _laws(who: str, i: ImpactVelocities, mass: tuple[float, float], epsilon: float) -> list[Check]:
    """Largest violation of each law over the impacts at its mesh."""
    before, after = i.rim_speeds()
    change = after - before
    restitution = i.after + epsilon * i.before  # of the relative speeds at both meshes
    laws = {
        "mesh 1 leaves wheel 2 alone": (1, change[:, 1]),
        "restitution at mesh 1": (1, restitution[:, 0]),
        "momentum of both wheels at mesh 2": (2, change @ np.array(mass) / sum(mass)),
        "restitution at mesh 2": (2, restitution[:, 1]),
    }
    checks = []
    for law, (mesh, violation) in laws.items():
        at_mesh = np.abs(violation[i.mesh == mesh])
        largest = at_mesh.max() if at_mesh.size else math.nan
        checks.append(Check(f"{law}, {who}", largest, 0.0, slack=LAW_ROUNDING))
    return checks


def _energy(i: ImpactVelocities, lost: Floats, mass: tuple[float, float]) -> list[Check]:
    """Energy that leaves both wheels at mesh 2, and what wheel 1 loses relative to the driver at
    mesh 1."""
    before, after = i.rim_speeds()
    by_wheel = 0.5 * (before**2 - after**2)
    gone = {1: by_wheel[:, 0], 2: by_wheel @ (np.array(mass) / mass[0])}
    slack = LAW_ROUNDING * CHECKED_IMPACTS
    checks = []
    for mesh, energy in gone.items():
        at = i.mesh == mesh
        name = f"energy lost at mesh {mesh}, orbit"
        checks.append(Check(name, lost[at].sum(), energy[at].sum(), slack=slack))
    return checks


def impact_laws(seed: int, workers: int) -> Found:
    """Check momentum, restitution and energy of the impacts at both meshes, of the orbit and of
    every scheme."""
    scene = Scene.from_gears(TWO_STAGES)
    path = follow(scene, CHECKED_IMPACTS)
    orbit = ImpactVelocities(path.mesh[1:], path.before[1:, 1::2], path.after[1:, 1::2])
    lost = [
        energy_loss(scene.constants, int(mesh), y[mesh - 1])
        for mesh, y in zip(orbit.mesh, orbit.before, strict=True)
    ]
    sides = {"orbit": orbit} | {scheme: _coast(scheme) for scheme in SCHEMES}

    def checks(
        mass: tuple[float, float] = RIM_MASSES, epsilon: float = TWO_STAGES.epsilon
    ) -> list[Check]:
        laws = [law for who, impacts in sides.items() for law in _laws(who, impacts, mass, epsilon)]
        return laws + _energy(orbit, np.array(lost), mass)

    return checks(), {
        "masses of the wheels interchanged": checks(mass=RIM_MASSES[::-1]),
        "restitution 0.1 % larger": checks(epsilon=1.001 * TWO_STAGES.epsilon),
    }


def bouncing_ball(seed: int, workers: int) -> Found:
    """Check flights and time to rest of one stage under constant drag, for the orbit and for a
    simulated path.

    With ``alpha = beta = sigma = 0`` Eq. 3 is ``y' = gamma``: an impact at speed v is followed by a
    flight of ``2 epsilon v / gamma`` and an impact at ``epsilon v``, so that all flights add up to
    ``t1 / (1 - epsilon)``.
    """
    start = Start(0.0, PAIR_HALF_GAP, START_SPEED, mesh=1)
    scene = bare(epsilon=EPSILON, gamma1=GAMMA, gap1=PAIR_HALF_GAP, start=start)
    orbit = follow(scene, 40)
    run = simulate(scene, paths=1, impacts=SIMULATED_BOUNCES, record=Record(raw=True))
    assert run.raw is not None
    # times of the impacts, each located within a distance of its wall
    sides = {
        "orbit": (orbit.tau, WITHIN),
        "exact-flight": (np.append(0.0, run.raw[0, :, 0]), CLOSE_TO_WALL * PAIR_HALF_GAP),
    }

    def checks(epsilon: float = EPSILON) -> Checks:
        """Worst flight time, and the time to rest."""
        first = 2.0 * epsilon * START_SPEED / GAMMA
        for who, (tau, close) in sides.items():
            flights = np.diff(tau)
            exact = first * epsilon ** np.arange(flights.size)
            # close / speed at both ends of each
            slack = 2.0 * close / (0.5 * GAMMA * flights[-1]) / (1.0 - EPSILON)
            k = np.abs(flights - exact).argmax()
            name = f"flight {k + 1} of {flights.size}, {who}"
            yield Check(name, flights[k], exact[k], slack=slack)
            rest = tau[-1] - tau[0] + flights[-1] * epsilon / (1.0 - epsilon)
            yield Check(f"time to rest, {who}", rest, first / (1.0 - epsilon), slack=slack)

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
    se = difference.std(ddof=1) / math.sqrt(run.paths)
    closed = max(
        run.estimates[f"contact_share_mesh{m}"].value for m in range(1, run.scene.stages + 1)
    )
    balance = (supplied + difference).mean()
    scene = run.scene
    shares = [wheel.mass * (1.0 + wheel.beta**2) for wheel in scene.tree]
    power = 0.25 * scene.sigma**2 * sum(shares)  # what the noise supplies per unit of time
    truth = supplied.mean() + (noise - 1.0) * power
    return Check(f"loss per time, {name}", balance, truth, se, 2.0 * closed * power)


def energy_law(seed: int, workers: int) -> Found:
    """Check the energy balance of eight long runs, driven and not, of one stage and of two."""
    runs = {
        name: long_run(
            scene,
            periods=PERIODS.get(name, USUAL_PERIODS),
            paths=CHECK_PATHS,
            rng=seed + 31 * i,
            workers=workers,
        )
        for i, (name, scene) in enumerate(SCENES.items())
    }
    light = [
        _balance(name, replace(run, scene=replace(run.scene, mu=0.98 * run.scene.mu)))
        for name, run in runs.items()
        if run.scene.stages == 2
    ]
    return [_balance(name, run) for name, run in runs.items()], {
        **{f"2 % of the loss missing, {n}": [_balance(n, run, 0.98)] for n, run in runs.items()},
        "2 % less mass of wheel 2": light,
        "noise of 2 % more energy": [_balance(name, run, 1.0, 1.02) for name, run in runs.items()],
    }


# alpha, epsilon; with half gaps of 0.5 these orbits are stable
CASES = ((0.25, 0.5), (0.2, 0.6), (0.3, 0.4))
# noise and periods of the noisy run, of the first case
WEAK = 1e-3
CHECK_PATHS = 256  # of a long run
CHECKED_PERIODS = 256
SLACK = 2e-6  # orbits are found to 1e-8 of their state

# of the sum of the exponents, and of its noisy path
LONG_ORBIT = 20_000
PATH_SIGMA = 0.1
# alpha, epsilon; stable, with two different exponents each
IMPACT_PAIRS = ((0.35, 0.4), (0.35, 0.25), (0.15, 0.35))
PAIR_IMPACTS = 10_000
EXPONENT_ROUNDING = 1e-10


def symmetric_orbit(alpha: float, epsilon: float) -> tuple[float, float]:
    """Phase and speed of the impacts of the symmetric orbit (Masri and Caughey 1966)."""
    k = 0.5 * math.pi * (1.0 + epsilon) / (1.0 - epsilon)
    tau = math.asin(PAIR_HALF_GAP / (alpha * math.hypot(1.0, k))) - math.atan(k)
    return tau, 2.0 * alpha * math.cos(tau) / (1.0 - epsilon)


def _pair(alpha: float, epsilon: float, sigma: float = 0.0) -> Scene:
    return bare(alpha=alpha, epsilon=epsilon, gap1=PAIR_HALF_GAP, sigma=sigma)


def impact_pair(seed: int, workers: int) -> Found:
    """Check phase and speed of the impacts of three symmetric orbits, and the sds that weak noise
    gives them."""
    orbits = {case: attractor(_pair(*case)) for case in CASES}
    noisy = _pair(*CASES[0], WEAK)
    law = linear_law(noisy, orbits[CASES[0]])
    estimates = long_run(
        noisy, periods=CHECKED_PERIODS, paths=CHECK_PATHS, rng=seed, workers=workers
    ).estimates

    def states(factor: float = 1.0) -> Checks:
        """Phase (modulo half a period) and speed of the impacts."""
        for (alpha, epsilon), a in orbits.items():
            tau, speed = symmetric_orbit(alpha, factor * epsilon)
            phase = (a.tau[-1] - tau + 0.5 * math.pi) % math.pi - 0.5 * math.pi
            name = f"alpha {alpha}, eps {epsilon}"
            yield Check(f"phase less its truth, {name}", phase, 0.0, slack=2e-7)
            yield Check(f"speed, {name}", abs(a.before[-1, 1]), speed, slack=2e-7 * speed)

    def spreads(factor: float = 1.0) -> Checks:
        for q in ("sd_speed", "sd_flight"):
            truth = factor * math.sqrt((law.weight * getattr(law, q) ** 2).sum()) / WEAK
            name = f"{q} / sigma, alpha {CASES[0][0]}, eps {CASES[0][1]}"
            yield Check(name, estimates[q].value / WEAK, truth, estimates[q].se / WEAK, SLACK)

    return [*states(), *spreads()], {
        "restitution 0.1 % larger": states(1.001),
        "sds 2 % larger": spreads(1.02),
    }


def exponent_sum(seed: int, workers: int) -> Found:
    """Check the sum of the four exponents of DAT21: of the orbit, and of the drift along a noisy
    path."""
    scene = Scene.from_gears(DAT21)
    records = (
        lyapunov(scene, impacts=LONG_ORBIT),
        drift_exponents(scene.with_sigma(PATH_SIGMA), impacts=LONG_ORBIT, seed=seed),
    )
    both = scene.beta1 + scene.beta2

    def checks(power: float = 2.0, damping: float = both) -> Checks:
        for record in records:
            truth = -damping + record.rate * power * math.log(scene.epsilon)
            name = f"sum of exponents, {record.of}"
            yield Check(name, record.value.sum(), truth, slack=EXPONENT_ROUNDING)

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
    tau, speed = symmetric_orbit(alpha, epsilon)
    half = 0.5 * math.pi * (1.0 + epsilon) * -alpha * math.sin(tau) / speed - epsilon
    split = math.sqrt(half**2 - epsilon**2)
    first, second = sorted((abs(half + split), abs(half - split)), reverse=True)
    return math.log(first) / math.pi, math.log(second) / math.pi


def orbit_exponents(seed: int, workers: int) -> Found:
    """Check both exponents of three symmetric orbits: the tangent frames through flights and
    impacts."""
    computed = {case: lyapunov(_pair(*case), impacts=PAIR_IMPACTS).value for case in IMPACT_PAIRS}

    def checks(factor: float = 1.0, saltation: bool = True) -> Checks:
        for (alpha, epsilon), exponents in computed.items():
            exact = _exponents(alpha, factor * epsilon)
            if not saltation:  # an impact takes (dx, dy) to (dx, -epsilon dy)
                exact = 0.0, math.log(epsilon) / math.pi
            for i in (0, 1):
                name = f"exponent {i + 1}, alpha {alpha}, eps {epsilon}"
                yield Check(name, exponents[i], exact[i], slack=EXPONENT_ROUNDING)

    return checks(), {
        "impacts without the saltation term": checks(saltation=False),
        "restitution 0.1 % larger": checks(1.001),
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


def _impacts_a_period(scene: Scene, start: Start) -> float:
    """Impacts in a period of the motion that is reached from a start; NaN for another one."""
    orbit = LongOrbit(replace(scene, start=start))
    for _ in range(MOST_STRETCHES):
        flight = orbit.stretch(REPEAT_IMPACTS, tangent=False).flight
        if flight.size < REPEAT_IMPACTS:  # at rest
            break
        number = REPEAT_IMPACTS / 2 * PERIOD / flight[REPEAT_IMPACTS // 2 :].sum()
        if abs(number - round(number)) < SAME_ORBIT:
            return float(round(number))
    return math.nan


def _find_motions(scene: Scene, across: Floats, up: Floats, phase: float = math.pi) -> Floats:
    """Impacts in a period of the motion that is reached from each place of the figure, 0 to 1."""
    (left, right), (bottom, top) = FRAME
    displacement = left + (right - left) * across + 0.5
    velocity = bottom + (top - bottom) * up
    starts = zip(displacement, velocity, strict=True)
    return np.array([_impacts_a_period(scene, Start(phase, *state)) for state in starts])


def gear_rattle_basins(seed: int, workers: int) -> Found:
    """Check from which starts each of two coexisting motions is reached, and the share of all
    starts."""
    figure = np.array([list(line) for line in FIGURE.split()])
    row, column = np.nonzero(figure != ".")
    printed = figure[row, column].astype(int)
    places = (column + 0.5) / len(figure), 1.0 - (row + 0.5) / len(figure)

    def differ(scene: Scene = GEARS, phase: float = math.pi) -> list[Check]:
        other = _find_motions(scene, *places, phase) != printed
        return [Check(f"places of {len(printed)} that differ from the figure", other.sum(), 0.0)]

    rng = np.random.default_rng(seed)
    three = _find_motions(GEARS, *rng.uniform(size=(2, BASIN_STARTS))) == 3.0
    se = three.std() * math.sqrt(1.0 / BASIN_STARTS + 1.0 / PIXELS**2)
    name = "share of starts that end in three impacts a period"
    return [*differ(), Check(name, three.mean(), COLOURED_SHARE, se)], {
        "restitution 0.88": differ(replace(GEARS, epsilon=0.88)),
        "drive 5 % smaller": differ(replace(GEARS, alpha=0.95 * GEARS.alpha)),
        "drag 20 % larger": differ(replace(GEARS, gamma1=1.2 * GEARS.gamma1)),
        "drag on the other flank": differ(phase=0.0),
    }
