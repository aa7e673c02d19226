"""Formulas compared with 400-digit arithmetic: flights, their derivatives and noise, window means,
steps, impacts."""

import math
from collections.abc import Iterator
from itertools import product

import mpmath as mp
import numpy as np

from rattle import montecarlo
from rattle.closure import edgeworth
from rattle.closure import saltation as linear
from rattle.compare.checks.check import bare, extreme, farthest, spread
from rattle.compare.checks.extremes import truth
from rattle.montecarlo.schemes import short_flight as short
from rattle.scene import (
    Constants,
    Scene,
    Start,
    damping,
    drive,
    flight,
    impact,
    moments,
    orbit,
    tangent,
)
from rattle.scene.impact import TOUCH_STEP

BETAS = spread(1e-14, 1e3, 7, 0.0)
TIME_GRID = spread(1e-12, 1e6, 10)
POINTS_OF_A_ROW = 120  # random grid points of each row
SERIES_ORDER = 6  # of the Edgeworth series


def constants(**fields: float) -> Constants:
    """Build the constants of a two-stage scene with moderate values."""
    plain = {
        "alpha": 1.5,
        "epsilon": 0.9,
        "beta1": 0.08,
        "beta2": 0.13,
        "gamma1": 0.06,
        "gamma2": 0.03,
        "mu": 0.6,
    }
    return Constants(**({**plain, "wall1": 0.5, "wall2": 0.5, "sigma": 1.0, "stages": 2} | fields))  # type: ignore[arg-type]


def _pairs(rng: np.random.Generator) -> tuple[float, float]:
    """Two damping coefficients: far apart, equal, or equal but for the last digits."""
    beta = float(rng.choice(BETAS))
    other = (float(rng.choice(BETAS)), beta, beta * (1.0 + 2.0 ** -float(rng.integers(1, 53))))[
        rng.integers(3)
    ]
    return (beta, other) if rng.random() < 0.5 else (other, beta)


def _draw(seed: int, points: int | None = None) -> Iterator[tuple[Constants, float, float]]:
    """Random scenes, each with a phase and a flight time."""
    rng = np.random.default_rng(seed)
    for _ in range(points or POINTS_OF_A_ROW):
        beta1, beta2 = _pairs(rng)
        alpha = float(rng.choice(spread(1e-8, 1e4, 4, 0.0)))
        gamma1, gamma2 = (float(v) for v in rng.choice(spread(1e-8, 1e6, 4, 0.0), 2))
        tau = float(rng.choice([0.0, math.pi, 0.5 * math.pi, rng.uniform(-3.0, 3.0)]))
        c = constants(alpha=alpha, beta1=beta1, beta2=beta2, gamma1=gamma1, gamma2=gamma2)
        yield c, tau, float(rng.choice(TIME_GRID))


@extreme()
def flight_state() -> Iterator[float]:
    """Displacements and velocities after a flight."""
    rng = np.random.default_rng(1)
    for c, tau, t in _draw(0):
        y1, y2 = (
            float(rng.choice([-1.0, 1.0]) * v) for v in rng.choice(spread(1e-12, 1e4, 5, 0.0), 2)
        )
        values, sizes = truth.flight(c, tau, y1, y2, t)
        yield farthest(flight.displacement(c, tau, y1, y2, t), values, sizes)


@extreme()
def phi_functions() -> Iterator[float]:
    """``t phi1(-beta t)`` and ``t^2 phi2(-beta t)``."""
    for beta, t in product(BETAS, TIME_GRID):
        values, _ = truth.flight(constants(alpha=0.0, beta1=beta, gamma1=1.0), 0.0, 0.0, 0.0, t)
        (_, e, _, _), *_ = truth.jacobian(constants(beta1=beta), t)
        yield farthest(damping.phi1(beta, t), e, e)
        yield farthest(damping.phi2(beta, t), values[0], values[0])


@extreme()
def flight_jacobian() -> Iterator[float]:
    """Every entry of the Jacobian of a flight, with its own relative error."""
    for c, _, t in _draw(2):
        exact = np.array(truth.jacobian(c, t))
        size = np.abs(exact) * (1.0 + max(c.beta1, c.beta2) * t)
        yield farthest(flight.jacobian(c, t), exact, size)


@extreme(allowed=1e-13)
def flight_noise() -> Iterator[float]:
    """Covariance of the noise accumulated in a flight."""
    for c, tau, t in _draw(3):
        unit = np.array(truth.noise(c, tau, t))
        for sigma in (1e-8, 1e4):
            exact = sigma * sigma * unit
            sd = np.sqrt(exact.diagonal())
            found = flight.noise_covariance(c._replace(sigma=sigma), tau, t)
            yield farthest(found, exact, np.outer(sd, sd))


@extreme(allowed=1e-11)
def noise_phase_derivative() -> Iterator[float]:
    """Derivative of that covariance by the phase of the start."""
    for c, tau, t in _draw(4, POINTS_OF_A_ROW // 3):
        h = 1e-3
        ahead, behind = (np.array(truth.noise(c, tau + k * h, t)) for k in (1.0, -1.0))
        # exact derivative of A + B cos 2 tau + C sin 2 tau
        exact = (ahead - behind) / math.sin(2.0 * h)
        most = np.sqrt(
            np.maximum(
                ahead.diagonal(), np.array(truth.noise(c, tau + 0.5 * math.pi, t)).diagonal()
            )
        )
        found = linear.noise_slope(c, tau, t)
        yield farthest(found, exact, np.outer(most, most))


def _series(seed: int) -> np.ndarray:
    a = np.zeros((SERIES_ORDER + 1, SERIES_ORDER + 1))
    rng = np.random.default_rng(seed)
    for i in range(SERIES_ORDER + 1):
        a[i, : SERIES_ORDER + 1 - i] = rng.normal(size=SERIES_ORDER + 1 - i) * 0.3 ** (i + 1)
    a[0, 0] = 1.0
    return a


@extreme()
def edgeworth_windows() -> Iterator[float]:
    """Window means of Eqs. 20 and 21."""
    for n, middle in enumerate([0.0, 1e-9, 0.3, -2.0, 8.0, -20.0, 35.0]):
        for width in spread(1e-12, 30.0, 8):
            a = _series(n)
            sd = 10.0 ** (n - 3)
            low = middle - 0.5 * width
            high = middle + 0.5 * width
            exact, size = _by_parts(a, low * sd / sd, high * sd / sd)
            found = edgeworth.window_means(a, sd, 2.0 * sd, low * sd, high * sd)
            # of the density, since the edges are rounded
            condition = 1.0 + abs(middle) * (abs(middle) + width)
            condition += abs(middle) / width  # of the width, since both edges are rounded
            sds = np.array([sd, 2.0 * sd])
            yield farthest(found, sds * exact, sds * size * condition)


@truth.in_digits
def _by_parts(a: np.ndarray, low: float, high: float) -> tuple[list[float], list[float]]:
    integral, size = truth.normal_integrals(low, high, SERIES_ORDER + 1)
    values = []
    sizes = []
    for column, power in ((0, 1), (1, 0)):  # of the position, and of the velocity
        weights = a[:, column, None] * edgeworth.HERMITE[: SERIES_ORDER + 1, : SERIES_ORDER + 1]
        terms = [(n + power, w) for (_, n), w in np.ndenumerate(weights)]
        values.append(float(sum(w * integral[n] for n, w in terms)))
        sizes.append(float(sum(abs(w) * size[n] for n, w in terms)))
    return values, sizes


@extreme()
def correlations() -> Iterator[float]:
    """Correlations close to 1, smallest eigenvalues and realizability, in any units."""
    for unit in spread(1e-16, 1e8, 7):
        none = np.array([[0.0, 1e-3 * unit], [1e-3 * unit, 1.0]])  # no variance, yet a covariance
        yield math.inf if moments.realizability(none).realizable else 0.0
        for distance, beyond in product(spread(1e-12, 1.0, 7), (False, True)):
            rho = 1.0 + distance if beyond else 1.0 - distance
            covariance = np.array([[unit * unit, rho * unit], [rho * unit, 1.0]])
            judged = moments.realizability(covariance)
            least = _least(covariance)
            yield farthest(
                judged.rho, 1.0 if beyond and distance < moments.RHO_ROUNDING else rho, 1.0
            )
            yield farthest(judged.smallest_eigenvalue, least, min(unit, 1.0) ** 2)
            within = not beyond or distance < moments.RHO_ROUNDING
            yield 0.0 if judged.realizable == within else math.inf


@truth.in_digits
def _least(covariance: np.ndarray) -> float:
    a = mp.mpf(covariance[0, 0])
    b = mp.mpf(covariance[0, 1])
    d = mp.mpf(covariance[1, 1])
    return float((a + d) / 2 - mp.sqrt(((a - d) / 2) ** 2 + b * b))


def _scenes_and_steps() -> Iterator[tuple[Constants, tuple[float, ...]]]:
    """Scenes with steps, up to the longest admissible one."""
    for beta1 in spread(1e-9, 1e3, 5, 0.0):
        for beta2 in (0.0, beta1, beta1 * (1.0 + 1e-9), 2.0, 1e3):
            # largest admissible dt, and beta dt
            longest = min(0.1, 0.2 / max(beta1, beta2, 1e-300))
            yield constants(beta1=beta1, beta2=beta2), (1e-12, 1e-3 * longest, longest)


@extreme()
def step_phase() -> Iterator[float]:
    """Sine and cosine by the project's own operations."""
    for tau in (*spread(1e-9, 1e6, 200, 0.0), *(-0.25 * math.pi * k for k in range(1, 40))):
        with mp.workdps(40):
            exact = float(mp.sin(mp.mpf(tau))), float(mp.cos(mp.mpf(tau)))
        yield farthest(drive.sine_cosine(tau), exact)


@extreme()
def step_flight() -> Iterator[float]:
    """Flight of a part of a step without noise: what it adds to the displacements, and the
    velocities after it."""
    tau = 2.2
    y1 = -0.4
    y2 = 0.5
    for c, steps in _scenes_and_steps():
        for h in steps:
            exact, sizes = truth.flight(c, tau, y1, y2, h)
            found, _ = short.short_flight(
                c, drive.sine_cosine(tau), h, (0.0, y1, 0.0, y2), 0.0, 0.0
            )
            yield farthest(found, exact, sizes)


@extreme(allowed=1e-8)
def step_noise() -> Iterator[float]:
    """Noise of a step from its Brownian increment and space-time Lévy area."""
    for c, steps in _scenes_and_steps():
        for h, (first, slope) in product(steps[1:], ((1.0, 0.0), (0.0, 1.0))):
            exact = _integral(c, 0.4, h, first, slope)
            found = short.kick(c, 0.4, h, first, slope / 12.0)
            m = 1.0 + c.beta1
            size = [
                m * h,
                m,
                abs(c.beta1 - c.beta2) * (1.0 + h) * h,
                abs(c.beta1 - c.beta2) * (1.0 + h),
            ]
            yield farthest(found, exact, size)


def _integral(c: Constants, tau: float, h: float, first: float, slope: float) -> list[float]:
    with mp.workdps(30):
        nodes = [
            (mp.mpf(x), mp.mpf(w))
            for x, w in mp.calculus.quadrature.GaussLegendre(mp.mp).calc_nodes(2, 110)
        ]
    total = np.zeros(4)
    for x, w in nodes:
        share = float((x + 1) / 2)
        weight = float(w / 2) * c.sigma * (first + slope * (share - 0.5))
        total += weight * np.array(truth.unit_noise(c, tau + h, h * (1.0 - share)))
    return total.tolist()


PULLS = (0.01, 1.0, 100.0)  # accelerations by drag, in half gaps per unit of time squared
EPSILONS = (0.0, 1e-12, 0.1, math.exp(-math.pi / math.sqrt(3.0)), 0.9, 1.0 - 2.0**-53, 1.0)


@extreme()
def saltation() -> Iterator[float]:
    """Saltation matrix."""
    rng = np.random.default_rng(5)
    for epsilon, speed, mesh in product(EPSILONS, spread(1e-9, 1e4, 8), (1, 2)):
        beta1, beta2, alpha = (float(v) for v in rng.choice(spread(1e-6, 1e3, 4, 0.0), 3))
        gamma1 = float(rng.choice([0.0, 1e4]))
        c = constants(epsilon=epsilon, beta1=beta1, beta2=beta2, alpha=alpha, gamma1=gamma1)
        other = float(rng.normal())
        tau = float(rng.uniform(-3.0, 3.0))
        y1, y2 = (speed, other) if mesh == 1 else (other, -speed)
        exact, size = truth.saltation(c, mesh, tau, y1, y2)
        yield farthest(tangent.saltation_matrix(c, mesh, tau, y1, y2), exact, size)


@extreme()
def grazing() -> Iterator[float]:
    """A parabolic flight whose apex passes or misses a wall by a small fraction of the gap."""
    shares = [sign * share for share in spread(1e-12, 1e-1, 7) for sign in (1.0, -1.0)]
    for gap, share, pull in product((1e-8, 0.5, 1e4), shares, PULLS):
        # from 0 towards the lower wall
        drag = pull * gap
        rise = gap * (1.0 + share)
        c = constants(alpha=0.0, beta1=0.0, gamma1=drag, wall1=gap, stages=1)
        y = -math.sqrt(2.0 * drag * rise)
        t, mesh, side, *_ = impact.next_impact(c, 0.0, 0.0, y, 0.0, 0.0, 1e4)
        exact, sign, speed = _meet(y, drag, gap)
        # the wall is known to rounding, so the time to rounding of gap / speed
        yield farthest(t, exact, exact + gap / speed) if (mesh, side) == (1, sign) else math.inf


@truth.in_digits
def _meet(y: float, drag: float, gap: float) -> tuple[float, int, float]:
    """Time, side and speed at which ``y t + drag t^2 / 2`` meets a wall at distance `gap`."""
    a = mp.mpf(drag)
    v = mp.mpf(y)
    fall = 2 * mp.mpf(drag) * mp.mpf(gap)
    side = -1 if v * v > fall else 1
    speed = mp.sqrt(v * v + side * fall)
    return float((-v + side * speed) / a), side, float(speed)


@extreme(allowed=1e-9)
def simultaneous() -> Iterator[float]:
    """Simultaneous impacts at both meshes: mesh 1 comes first, then mesh 2 with the velocity left
    by it."""
    for gap in (2.0**-27, 0.5, 2.0**13):
        start = Start(0.0, 0.0, 2.0 * gap, 0.0, -3.0 * gap)
        scene = bare(mu=0.25, gap1=gap, gap2=1.5 * gap, start=start, stages=2)
        # at tau = 1/2: mesh 1 at +gap1 and mesh 2 at -gap2; the impact at mesh 1 leaves y = (-gap,
        # -6 gap)
        exact: dict[str, list[float]] = {
            "tau": [0.5, 0.5],
            "flight": [0.5, 0.0],
            "mesh": [1, 2],
            "side": [1, -1],
        }
        # in gaps
        lengths = {"x1": [1.0, 1.0], "y1": [2.0, -1.0], "x2": [-1.5, -1.5], "y2": [-3.0, -6.0]}
        followed = orbit.follow(scene, 2)
        found = {
            "tau": followed.tau[1:],
            "flight": np.diff(followed.tau),
            "mesh": followed.mesh[1:],
        }
        sides = [
            found
            | {"side": followed.side[1:]}
            | dict(zip(lengths, followed.before[1:].T, strict=True))
        ]
        for scheme in ("euler-maruyama-located", "exact-flight"):
            sides.append(
                dict(
                    montecarlo.simulate(
                        scene, paths=1, impacts=2, scheme=scheme, dt=2.0**-7
                    ).columns
                )
            )
        for side in sides:
            yield from (farthest(side[name], exact[name]) for name in exact)
            yield from (farthest(side[name] / gap, lengths[name]) for name in lengths)


@extreme(allowed=1e-9)
def chatter_time() -> Iterator[float]:
    """A ball that falls from the middle of the gap completes its chatter after ``(1 + eps) / (1 -
    eps)`` fall times."""
    for gap, pull, epsilon in product(
        (2.0**-26, 0.5, 2.0**13), PULLS, (0.0, 1e-12, 0.1, 0.5, 0.9, 0.99)
    ):
        scene = bare(epsilon=epsilon, gamma1=pull * gap, gap1=gap, start=Start())
        phases = orbit.follow(scene, 5000).sticking
        closed = phases[0].closed if len(phases) == 1 and math.isinf(phases[0].opened) else math.nan
        exact = math.sqrt(2.0 / pull) * (1.0 + epsilon) / (1.0 - epsilon)
        yield farthest(closed, exact, exact)


@extreme(allowed=2.0 * TOUCH_STEP)
def sticking_end() -> Iterator[float]:
    """A mesh that drag keeps closed opens when the driver's acceleration exceeds the drag."""
    shares = (0.3, 0.9, 0.999)  # drag over the largest acceleration of the driver
    for size, share, beta in product((2.0**-26, 1.0, 2.0**13), shares, spread(1e-6, 1.0, 3, 0.0)):
        start = Start(0.0, 0.5 * size, 0.1 * size, 0.0, 0.0, mesh=1)
        drag = share * math.hypot(1.0, beta) * size  # the driver's is |beta cos tau - sin tau|
        scene = Scene(
            alpha=size, epsilon=0.2, beta1=beta, gamma1=drag, gap1=0.5 * size, stages=1, start=start
        )
        phases = [p for p in orbit.follow(scene, 60).sticking if p.opened - p.closed > 0.1]
        # the decreasing zero of share + sin(atan beta - tau)
        exact = [math.asin(share) + math.atan(beta) + 2.0 * math.pi * n for n in range(200)]
        yield math.inf if not phases else 0.0
        yield from (min(abs(p.opened - e) for e in exact) for p in phases)
