"""Bodies that are no gears under white noise of their own: a ball above its floor, and an
oscillator with a wall in the middle.

The ball, ``dv = -g dt + sigma dW`` above a floor that returns ``epsilon`` of its speed, has an
exact density of flight time T and return speed w after a launch at u.  It is that of a randomly
accelerated particle (McKean 1963; Burkhardt, arXiv:0807.1671) times Girsanov's factor ``exp(u + w -
T / 2)``; speeds are in ``sigma^2 / g``, times in ``sigma^2 / g^2``.  In every flight ``E w = E T -
u`` and ``E w^2 = u^2 + E T``; the next launch is at ``epsilon w``.

The oscillator ``x'' + 2 zeta x' + x = sigma xi`` with a wall in its middle that keeps all of the
speed has the Gaussian distribution of the oscillator without a wall, cut at the wall.
"""

import math
from collections.abc import Callable, Mapping
from functools import cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import erf
from scipy.stats import kstest, norm, rayleigh, truncnorm

from rattle.compare.checks.check import Check, Checks, Found, check_moment
from rattle.compare.checks.published.noise import check_mean
from rattle.compare.validation.validate import validate
from rattle.montecarlo import Record, simulate
from rattle.montecarlo.long_run import LongRun, long_run
from rattle.montecarlo.long_run.sums import ENERGY, SPEED
from rattle.scene import Floats, Restitution, Scene, Start, Wheel

# restitution and first launch speed of the ball
LAUNCHES = ((0.8, 3.0), (0.9, 10.0))
IMPACTS = 5
BALL_PATHS = 40_000
SAMPLES = (
    (LAUNCHES[0], "exact-flight", IMPACTS),
    (LAUNCHES[1], "exact-flight", IMPACTS),
    (LAUNCHES[0], "euler-maruyama", 1),
    (LAUNCHES[0], "euler-maruyama-located", 1),
)
"""Launches, scheme and impacts of the ball's samples."""
# nodes of the square root of the speed, in which its density is even at 0, and of the logarithm of
# the flight time: sums over them give the moments of five impacts to 1e-7
ROOT_OF_FASTEST = 9.0
SPEED_NODES = 180
FLIGHT_NODES = np.geomspace(1e-7, 400.0, 400)
MOMENTS = {
    "flight": "mean flight",
    "sd_flight": "sd of flight",
    "y1": "mean speed",
    "sd_y1": "sd of speed",
}
"""Columns of a section that are checked, with their names."""

ALLOWED = 0.1  # error of an sd that `validate` calls accurate
VERDICT_PATHS = 200_000  # with which the closest of the true verdicts is clear by 7 standard errors

RUN_PATHS = 256  # of a long run
RUN_PERIODS = 512
ZETA = 0.1
OSCILLATOR_SIGMA = 0.7
RESTITUTIONS = (1.0, 0.8, 0.5)
PERCENTAGES = (5, 50, 95)  # quantiles of the impact speed

# a ball that is dropped, in metres and seconds, and its restitution
GRAVITY = 9.807
DROP_HEIGHT = 50.0
DROP_TIME = 12.5
DROPS = 100_000
RESTITUTION_MEAN = 0.9
RESTITUTION_SD = 0.02
RESTITUTION_ENDS = (0.84, 1.0)


class BallImpacts(NamedTuple):
    """Exact distributions of the impacts of a ball."""

    section: dict[str, Floats]  # by the keys of `MOMENTS`; (impacts,)
    # probability of a shorter flight to the first impact, and of a lower speed at it
    flight: Callable[[Any], Any]
    speed: Callable[[Any], Any]


def flight_density(flight: Floats, speed: Floats, launch: float) -> Floats:
    """Joint density of the time of a flight and of the speed at its end, for ``sigma = g = 1``.

    ``sqrt(3) w / (pi T^2) exp(-2 (u^2 - u w + w^2) / T + u + w - T / 2) erf sqrt(6 u w / T)``.
    """
    square = launch**2 - launch * speed + speed**2
    exponent = launch + speed - 0.5 * flight - 2.0 * square / flight
    scale = math.sqrt(3.0) / math.pi * speed / flight**2
    density = scale * np.exp(exponent) * erf(np.sqrt(6.0 * launch * speed / flight))
    return density


@cache
def exact_impacts(restitution: float, launch: float, sigma: float = 1.0) -> BallImpacts:
    """Compute the impacts of a ball under ``g = 1`` by quadrature, flight by flight."""
    unit = sigma**2  # of speeds and times
    root = np.linspace(0.0, ROOT_OF_FASTEST, SPEED_NODES + 1)[1:]
    speed = root**2
    speed_weight = 2.0 * root * root[0]
    log_flight = np.log(FLIGHT_NODES)
    flight_weight = FLIGHT_NODES * (log_flight[1] - log_flight[0])

    def land(u: float) -> tuple[Floats, Floats]:
        """Densities of speed and flight time after a launch."""
        joint = flight_density(FLIGHT_NODES, speed[:, None], u)
        return joint @ flight_weight, speed_weight @ joint

    speeds, flights = land(launch / unit)
    by_speed = CubicSpline(root, 2.0 * root * speeds).antiderivative()
    by_flight = CubicSpline(log_flight, FLIGHT_NODES * flights).antiderivative()
    landings = [land(u) for u in restitution * speed]
    speeds_after = np.array([of_speed for of_speed, _ in landings])
    flights_after = np.array([of_flight for _, of_flight in landings])
    rows = []
    for _ in range(IMPACTS):
        row = []
        for values, weights in (
            (FLIGHT_NODES, flight_weight * flights),
            (speed, speed_weight * speeds),
        ):
            mean = values @ weights
            row += [mean, math.sqrt(values**2 @ weights - mean**2)]
        rows.append(unit * np.array(row))
        launched = speed_weight * speeds
        flights = launched @ flights_after
        speeds = launched @ speeds_after
    section = dict(zip(MOMENTS, np.array(rows).T, strict=True))
    return BallImpacts(
        section,
        flight=lambda t: by_flight(np.log(t / unit)),
        speed=lambda w: by_speed(np.sqrt(w / unit)),
    )


def _under_noise(body: Wheel, restitution: float, sigma: float, x: float, y: float) -> Scene:
    """Build a scene of one body on a driver at rest, with white noise of its own."""
    return Scene(
        alpha=0.0,
        epsilon=restitution,
        sigma=sigma,
        noise=1,
        wheels=(body,),
        start=Start(0.0, x, y),
    )


def ball(restitution: float, launch: float) -> Scene:
    """Build a ball under gravity and noise that leaves its floor."""
    body = Wheel(gamma=1.0, gap=0.0, one_sided=True, name="ball")
    return _under_noise(body, restitution, 1.0, 0.0, -launch)


def _oscillator(restitution: float) -> Scene:
    """Build an oscillator under noise with a wall in its middle."""
    body = Wheel(beta=2.0 * ZETA, gap=0.0, stiffness=1.0, one_sided=True, name="mass")
    return _under_noise(body, restitution, OSCILLATOR_SIGMA, -0.3, -0.5)


def _run_long(scenes: Mapping[float, Scene], seed: int, workers: int) -> dict[float, LongRun]:
    """Follow scenes for long, by their restitution."""
    return {
        restitution: long_run(
            scene, periods=RUN_PERIODS, paths=RUN_PATHS, rng=seed + i, workers=workers
        )
        for i, (restitution, scene) in enumerate(scenes.items())
    }


def _kolmogorov(name: str, values: Floats, below: Callable[[Any], Any]) -> Check:
    """Check the Kolmogorov distance of a sample, as many standard errors as a normal deviate of its
    p-value has."""
    distance, p_value = kstest(values, below)
    deviate = max(float(norm.isf(0.5 * p_value)), 1e-9)
    return Check(f"Kolmogorov distance of {name}", float(distance), 0.0, float(distance) / deviate)


def noisy_ball(seed: int, workers: int) -> Found:
    """Check flights and speeds of five impacts of two balls: moments, both distributions at the
    first, and what holds in every flight; by Euler's steps the moments at the first impact."""
    runs = {
        (launched, scheme): simulate(
            ball(*launched),
            paths=BALL_PATHS,
            impacts=impacts,
            scheme=scheme,
            rng=np.random.SeedSequence([seed, i]),
            workers=workers,
            record=Record(raw=True),
        )
        for i, (launched, scheme, impacts) in enumerate(SAMPLES)
    }
    # of the exact flights, all paths at each impact
    exact: list[Any] = [
        (launched, run.raw) for (launched, scheme), run in runs.items() if scheme == "exact-flight"
    ]

    def moments(epsilon: float = 1.0) -> Checks:
        for ((restitution, launch), scheme), run in runs.items():
            truth = exact_impacts(epsilon * restitution, launch).section
            rows = run.section.to_dict("records")
            for (column, name), (k, row) in product(MOMENTS.items(), enumerate(rows, start=1)):
                of = f"{name} {k}, eps {restitution:g}, {scheme}"
                bias = abs(row.get(f"bias_{column}", 0.0))
                yield check_moment(row, column, of, truth[column][k - 1], bias)

    def distributions(sigma: float = 1.0) -> Checks:
        for launched, raw in exact:
            truth = exact_impacts(*launched, sigma)
            yield _kolmogorov(f"flight 1, eps {launched[0]:g}", raw[:, 0, 1], truth.flight)
            yield _kolmogorov(f"speed 1, eps {launched[0]:g}", raw[:, 0, 3], truth.speed)

    def every_flight(epsilon: float = 1.0) -> Checks:
        for (restitution, launch), raw in exact:
            flight = raw[:, :, 1]
            speed = raw[:, :, 3]
            launched = np.insert(epsilon * restitution * speed[:, :-1], 0, launch, axis=1)
            drift = speed - flight + launched
            squared = speed**2 - launched**2 - flight
            yield check_mean(f"w - T + u, eps {restitution:g}", drift.mean(axis=1), 0.0)
            yield check_mean(f"w^2 - u^2 - T, eps {restitution:g}", squared.mean(axis=1), 0.0)

    return [*moments(), *distributions(), *every_flight()], {
        "restitution 2 % larger": moments(epsilon=1.02),
        "5 % more noise": distributions(sigma=1.05),
        "launches after the first 1 % faster": every_flight(epsilon=1.01),
    }


def ball_verdicts(seed: int, workers: int) -> Found:
    """Check errors and verdicts that `validate` finds for the sds of first-order saltation at the
    first impact, against the true ones.

    To first order in the noise ``sd T = sqrt(8 u / 3)`` and ``sd w = sqrt(2 u / 3)``.
    """
    judged = {}
    for i, launched in enumerate(LAUNCHES):
        table = validate(
            ball(*launched),
            impacts=1,
            closures=["saltation"],
            paths=VERDICT_PATHS,
            rng=np.random.SeedSequence([seed, len(SAMPLES) + i]),
            workers=workers,
            fixed_times=False,
        ).table
        chosen = (table["kind"] == "section") & (table["moment"] == "sd")
        rows = table[chosen].to_dict("records")
        judged[launched] = {row["quantity"]: row for row in rows}

    def checks(allowed: float = ALLOWED, missing: float = 0.0) -> Checks:
        for (restitution, launch), rows in judged.items():
            truth = exact_impacts(restitution, launch).section
            for quantity, factor in (("flight", 8.0), ("y1", 2.0)):
                row = rows[quantity]
                predicted = math.sqrt(factor * launch / 3.0)
                exact = truth[f"sd_{quantity}"][0]
                error = predicted / exact - 1.0 - missing
                ratio = row["predicted"] / row["simulated"]
                se = ratio * row["se"] / row["simulated"]
                name = f"saltation's {MOMENTS['sd_' + quantity]}, launched at {launch:g}"
                yield Check(f"relative error of {name}", ratio - 1.0, error, se)
                verdict = "accurate" if abs(error) < allowed else "inaccurate"
                agrees = float(row["verdict"] == verdict)
                yield Check(f"verdict on {name}: {verdict}", agrees, 1.0)

    return checks(), {
        "15 % allowed": checks(allowed=0.15),
        "a closure whose sds are 2 % smaller": checks(missing=0.02),
    }


def stationary_ball(seed: int, workers: int) -> Found:
    """Check the stationary motion of two balls: ``E w^2 / E w = 1 / (1 - epsilon)``, and what
    impacts return of gravity's pull and take of the noise's energy."""
    runs = _run_long({launched[0]: ball(*launched) for launched in LAUNCHES}, seed, workers)

    def checks(epsilon: float = 1.0, gravity: float = 1.0) -> Checks:
        for restitution, run in runs.items():
            of = f"eps {restitution:g}"
            assumed = epsilon * restitution
            sums = run.sums.main.sum(axis=1)
            speed = sums[:, SPEED]
            square = 2.0 * sums[:, ENERGY] / (1.0 - restitution**2)
            ratio = square.sum() / speed.sum()
            rest = square - ratio * speed
            se = rest.std() / math.sqrt(run.paths) / speed.mean()
            yield Check(f"E w^2 / E w, {of}", ratio, 1.0 / (1.0 - assumed), se)
            time = run.sums.time
            gained = (1.0 + assumed) * speed / time
            yield check_mean(f"speed gained per time, {of}", gained, gravity)
            yield check_mean(f"loss per time, {of}", sums[:, ENERGY] / time, 0.5)

    return checks(), {
        "restitution 2 % larger": checks(epsilon=1.02),
        "gravity 1 % stronger": checks(gravity=1.01),
    }


def noisy_oscillator(seed: int, workers: int) -> Found:
    """Check rate and speeds of the impacts of an oscillator whose wall keeps all of its speed, and
    the energy balance for three restitutions."""
    runs = _run_long({r: _oscillator(r) for r in RESTITUTIONS}, seed, workers)

    def elastic(run: LongRun, stiffness: float = 1.0, noise: float = 1.0) -> Checks:
        speeds = rayleigh(scale=noise * OSCILLATOR_SIGMA / (2.0 * math.sqrt(ZETA)))
        truths = {
            "rate": math.sqrt(stiffness) / math.pi,
            "speed": speeds.mean(),
            "sd_speed": speeds.std(),
        }
        truths |= {f"q{p:02d}_speed": speeds.ppf(p / 100.0) for p in PERCENTAGES}
        for quantity, truth in truths.items():
            estimate = run.estimates[quantity]
            yield Check(f"{quantity}, eps 1", estimate.value, truth, estimate.se)

    def balances(kept: float = 1.0) -> Checks:
        """Loss against supply; `kept` of the loss is counted."""
        for restitution, run in runs.items():
            lost, supplied = run.energy_balance()
            excess = kept * lost - supplied
            yield check_mean(f"loss less supply, eps {restitution:g}", excess, 0.0)

    first = runs[RESTITUTIONS[0]]
    return [*elastic(first), *balances()], {
        "a spring 3 % stiffer": elastic(first, stiffness=1.03),
        "5 % more noise": elastic(first, noise=1.05),
        "10 % of the loss missing": balances(kept=0.9),
    }


def _height(restitution: Any) -> Any:
    """Height of the dropped ball at `DROP_TIME`, which it reaches after two bounces."""
    fall = math.sqrt(2.0 * DROP_HEIGHT / GRAVITY)
    since = DROP_TIME - fall * (1.0 + 2.0 * restitution)
    return (restitution**2 * fall - 0.5 * since) * GRAVITY * since


def random_restitution(seed: int, workers: int) -> Found:
    """Check mean and variance of the height of a ball that was dropped, whose restitution is drawn
    once from a cut normal distribution."""
    least, most = RESTITUTION_ENDS
    drawn = Restitution(sd=RESTITUTION_SD, least=least, most=most, draw="path")
    body = Wheel(gamma=GRAVITY, gap=0.0, one_sided=True, restitution=drawn)
    start = Start(0.0, -DROP_HEIGHT, 0.0)
    run = simulate(
        Scene(alpha=0.0, epsilon=RESTITUTION_MEAN, wheels=(body,), start=start),
        paths=DROPS,
        impacts=4,
        dt=DROP_TIME / 512,
        rng=seed,
        workers=workers,
        record=Record(times=[DROP_TIME]),
    )
    row = run.at_times().iloc[0]

    def checks(mean: float = RESTITUTION_MEAN, sd: float = RESTITUTION_SD) -> Checks:
        ends = [(end - mean) / sd for end in RESTITUTION_ENDS]
        truth = truncnorm(*ends, mean, sd)
        height = truth.expect(_height)
        variance = truth.expect(lambda e: (_height(e) - height) ** 2)
        yield Check("E y", -row["x1"], height, row["se_x1"])
        yield check_moment(row, "cov_x1_x1", "Var y", variance)

    return checks(), {
        "a mean of 0.903": checks(mean=0.903),
        "sd 5 % larger": checks(sd=1.05 * RESTITUTION_SD),
    }
