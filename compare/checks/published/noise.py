"""Motions that noise alone drives: a particle in a gap and at a wall, gaps that are random, and
Gaussian motions.

A randomly accelerated particle leaves a gap after a mean time and to a side that are known, and
returns to a wall with a known distribution of its speed; below a critical restitution it collapses.
Return times are heavy-tailed, ``P(T > t) ~ t^(-1/4)``, but ``x'' = sigma eta`` is self-similar
under ``(t, y, x) -> (s^2 t, s y, s^3 x)``: the state is rescaled before each step such that the
step is `RESTART_GROWTH` times the particle's time scale ``max(y^2, d^(2/3)) / sigma^2``, d the
distance to the wall.  The step is one of `rattle.montecarlo.coupling.dyadic.walk_step`, at the
phase where the modulation of the noise is stationary; it fails to return with a probability of
about ``RESTART_GROWTH^(-1/4)``.

Between elastic walls an impact changes the sign of y, and damping and white noise are symmetric
under this reflection: ``x = fold(X), y = +-Y`` in distribution, exactly and at any time, with the
free stage ``Y' = -beta Y + sigma (-sin tau + beta cos tau) eta, X' = Y`` (Eq. 5).  Once X has
spread over many boxes, x is uniform and independent of y.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.integrate import quad
from scipy.special import betainc, gamma, hyp2f1
from scipy.stats import truncnorm

from rattle.compare.checks.check import Check, Checks, Found, bare, check_moment
from rattle.montecarlo import Ensemble, Record, Sampling, simulate
from rattle.montecarlo.coupling.dyadic import (
    DEEPEST,
    Tree,
    clockwork_at,
    grow_tree,
    new_hits,
    walk_step,
)
from rattle.montecarlo.kernel.block import state_pairs
from rattle.montecarlo.noise.philox import STEP, Word, normals
from rattle.scene import Floats, RattleError, Scene, Start, Tolerance, state_names
from rattle.scene.compiled import jit
from rattle.scene.flight import flow, noise_covariance
from rattle.scene.impact import strike

# half gap; an exit takes about 0.02, in which the modulation of the noise (1 at -pi/2) falls by
# 3e-4
EXIT_HALF_GAP = 1e-3
EXIT_PATHS = 20_000
STRONGER = 1.05  # factor on the noise in the negative control

# time step, and bound of the relative error of the mean time: by step and modulation for the Euler
# schemes, by the modulation alone for exact flights
EXIT_STEPS = {
    "euler-maruyama": (1e-5, 2e-3),
    "euler-maruyama-located": (2e-5, 2e-3),
    "exact-flight": (1e-2, 3e-4),
}

# which turns the orbit without noise to one side; a random path moves by 2e-5 of the gap for it
DRAG = 1e-4
MOST_CHANGED = 1e-4  # share of paths that this may change
# starting points of exits whose side is checked, as fractions of the gap
SIDES = (0.1, 0.25, 0.5, 0.75)

TOLERANCE_WIDTH = 0.1  # of the tolerance
WIDTH_SDS = {
    "uniform": 1.0 / math.sqrt(3.0),
    "normal": 0.5 * truncnorm(-2.0, 2.0).std(),
}
"""Sd of a gap by its distribution, in widths of the tolerance; normal ones are cut at two sds."""


def particle(share: float, half: float, sigma: float, drag: float = 0.0) -> Scene:
    """Build ``x'' = sigma eta`` from rest at a fraction of a gap, at the phase where the modulation
    is stationary."""
    start = Start(-0.5 * math.pi, half * (2.0 * share - 1.0), 0.0)
    return bare(gamma1=drag, gap1=half, sigma=sigma, start=start)


def mean_exit_time(start: float, gap: float, sigma: float) -> float:
    """Compute the mean time after which ``x'' = sigma eta``, starting at zero velocity, leaves a
    gap.

    Masoliver and Porra 1995; docs/model.md section 8.
    """
    z = start / gap
    both = hyp2f1(1.0, -1.0 / 3.0, 7.0 / 6.0, z) + hyp2f1(1.0, -1.0 / 3.0, 7.0 / 6.0, 1.0 - z)
    scale = (4.0 / 3.0) ** (1.0 / 6.0) / gamma(7.0 / 3.0) * (2.0 * gap**2 / sigma**2) ** (1.0 / 3.0)
    return float(scale * (z * (1.0 - z)) ** (1.0 / 6.0) * both)


def check_exit(
    scheme: str,
    share: float,
    half: float,
    sigma: float,
    *,
    dt: float,
    left: float,
    paths: int,
    rng: int | np.random.SeedSequence,
    stronger: float = 1.0,
    workers: int = 2,
) -> Check:
    """Check the mean exit time from a fraction of a gap, with `left` of it as bound of the bias;
    the noise that is simulated is `stronger` than that of the truth."""
    truth = mean_exit_time(2.0 * half * share, 2.0 * half, sigma)
    run = simulate(
        particle(share, half, stronger * sigma),
        paths=paths,
        impacts=1,
        scheme=scheme,
        dt=dt,
        rng=rng,
        workers=workers,
        sampling=Sampling(horizon=40.0 * truth),
        record=Record(step_bias=False),
    )
    row = run.section.iloc[0]
    mean = row["flight"] if run.unfinished == 0 else math.nan
    name = f"mean exit time from {share:g}, {scheme}"
    return Check(name, mean, truth, row["se_flight"], left * truth)


def exit_time(seed: int, workers: int) -> Found:
    """Check the mean exit time from three starting points, for all three schemes of
    `montecarlo.simulate`."""

    def check(scheme: str, share: float, stronger: float = 1.0) -> Check:
        dt, left = EXIT_STEPS[scheme]
        return check_exit(
            scheme,
            share,
            EXIT_HALF_GAP,
            1.0,
            dt=dt,
            left=left,
            paths=EXIT_PATHS,
            rng=np.random.SeedSequence([seed, 1]),
            stronger=stronger,
            workers=workers,
        )

    return [check(scheme, share) for scheme in EXIT_STEPS for share in (0.1, 0.25, 0.5)], {
        f"{STRONGER - 1.0:.0%} more noise, {scheme}": [check(scheme, 0.5, STRONGER)]
        for scheme in EXIT_STEPS
    }


def exit_side(seed: int, workers: int) -> Found:
    """Check the share of paths that leave a gap on the side of the orbit without noise (its
    agreement)."""
    agreement = {}
    for i, share in enumerate(SIDES):
        scene = particle(share, EXIT_HALF_GAP, 1.0, DRAG)
        run = simulate(scene, paths=EXIT_PATHS, impacts=1, rng=seed + i, workers=workers)
        agreement[share] = run.columns["agreement"][0]

    def checks(truth: dict[float, float]) -> Checks:
        for z, p in truth.items():
            se = math.sqrt(p * (1.0 - p) / EXIT_PATHS)
            yield Check(f"agreement from {z:g}", agreement[z], p, se, MOST_CHANGED)

    side = {z: float(betainc(1.0 / 6.0, 1.0 / 6.0, z)) for z in SIDES}
    return checks(side), {
        "the other side": checks({z: 1.0 - p for z, p in side.items()}),
        "a share linear in the start, as of Brownian motion": checks({z: z for z in SIDES}),
    }


def random_gap(seed: int, workers: int) -> Found:
    """Check mean and sd of the wall that coasting paths strike first, for both distributions of the
    gap."""
    coasting = bare(start=Start(0.0, 0.0, 1.0))
    rows = {}
    for name in WIDTH_SDS:
        scene = replace(coasting, tolerance=Tolerance(TOLERANCE_WIDTH, distribution=name))
        run = simulate(scene, paths=EXIT_PATHS, impacts=1, rng=seed, workers=workers)
        rows[name] = run.section.iloc[0]

    def checks(spreads: dict[str, float], width: float = TOLERANCE_WIDTH) -> Checks:
        for name, row in rows.items():
            yield check_moment(row, "x1", f"mean wall, {name}", 0.5)
            yield check_moment(row, "sd_x1", f"sd of the wall, {name}", spreads[name] * width)

    return checks(WIDTH_SDS), {
        "the other distribution": checks(
            dict(zip(WIDTH_SDS, reversed(WIDTH_SDS.values()), strict=True))
        ),
        "a tolerance 5 % wider": checks(WIDTH_SDS, 1.05 * TOLERANCE_WIDTH),
    }


RESTART_GROWTH = 64.0
# index of the step, such that it begins at 3 pi / 2; the modulation, 1 there, varies by 7e-7 in the
# step
ROW = 4096
STEP_TIME = 1.5 * math.pi / ROW
# steps after which a flight counts as lost; a correct program never needs as many
MOST_FLIGHT_STEPS = 200
COUNTERS_APART = Word(2**24)  # distance of the random-number counters of two paths


@jit
def _bounce(tree: Tree, log_speed: Floats) -> int:
    """Fill `log_speed`, shape (paths, bounces), with ln of the speed after each impact; return the
    lost flights."""
    # one hit: it ends the step
    c = tree.c
    w = tree.clock
    wall = c.wheels[0].wall
    hits = new_hits(c, 1)
    state = np.zeros(2)
    lost = 0
    for p in range(len(log_speed)):
        n = Word(p) * COUNTERS_APART
        scale = 0.0
        y = 1.0
        for bounce in range(log_speed.shape[1]):
            # positive y is towards the wall
            distance = 0.0
            y = -y
            met = 0
            for _ in range(MOST_FLIGHT_STEPS):
                s = math.sqrt(
                    w.h
                    * c.sigma**2
                    / (RESTART_GROWTH * max(y * y, (distance * c.sigma**2) ** (2.0 / 3.0)))
                )
                scale -= math.log(s)
                state[0] = wall - s**3 * distance
                state[1] = s * y
                z0, z1, _, _ = normals(tree.key, n, Word(ROW), Word(STEP))
                met, _ = walk_step(tree, n, ROW, (z0, z1), state, hits)
                n += Word(1)
                if met > 0:
                    break
                distance = wall - state[0]
                y = state[1]
            if met == 0 or hits[0, 1] != 1.0:
                lost += 1
                continue
            after = hits[0, 2:]
            strike(c, 1, after)
            y = -after[1]
            log_speed[p, bounce] = scale + math.log(y)
    return lost


def log_speeds(epsilon: float, paths: int, bounces: int, seed: int) -> Floats:
    """Simulate bounces of a randomly accelerated particle that leaves the wall at speed 1.

    Shapes: result (paths, bounces).
    """
    start = Start(0.0, 0.0, -1.0)
    scene = bare(epsilon=epsilon, gap1=EXIT_HALF_GAP, sigma=1.0, start=start)
    # of the single step, at the phase 3 pi / 2
    clock = clockwork_at(scene, np.array([ROW * STEP_TIME]), STEP_TIME, DEEPEST)
    clock = clock._replace(forcing=np.repeat(clock.forcing, ROW + 1, axis=0))
    out = np.empty((paths, bounces))
    lost = _bounce(grow_tree(scene.constants, clock, np.random.SeedSequence([seed, 2])), out)
    if lost:
        raise RattleError(
            f"{lost} of {out.size} flights did not return in {MOST_FLIGHT_STEPS} steps,"
            " or reached the far wall"
        )
    return out


MEAN = math.pi / math.sqrt(3.0)
"""E ln rho, rho being the ratio of consecutive speeds, with the density ``3 / (2 pi) rho^(3/2) / (1
+ rho^3)``."""

LOG_RATIO_VARIANCE = 4.0 * math.pi**2 / 9.0
"""Var ln rho."""

RETURNS = 300_000
RATIO_ORDERS = (-0.6, -0.3, 0.1)
"""Orders s of the moments E rho^s; E rho^(4 s) is finite too, so that standard errors can be
estimated."""
# restitutions below and above the critical one, exp(-MEAN) = 0.163
BELOW_CRITICAL = 0.12
ABOVE_CRITICAL = 0.22
NOISY_BOUNCES = 8


def check_mean(quantity: str, values: Floats, truth: float) -> Check:
    """Check the mean of independent values."""
    return Check(quantity, values.mean(), truth, values.std() / math.sqrt(len(values)))


def return_speed(seed: int, workers: int) -> Found:
    """Check mean and variance of ln rho, and P(rho < 1), over `RETURNS` flights that start at speed
    1."""
    flights = log_speeds(1.0, RETURNS, 1, seed)[:, 0]
    slower = quad(lambda r: 1.5 / math.pi * r**1.5 / (1.0 + r**3), 0.0, 1.0)[0]

    def checks(
        mean: float = MEAN, variance: float = LOG_RATIO_VARIANCE, ln: Floats = flights
    ) -> Checks:
        yield check_mean("E ln rho", ln, mean)
        yield check_mean("Var ln rho", (ln - ln.mean()) ** 2, variance)
        yield check_mean("P(rho < 1)", (ln < 0.0).astype(float), slower)

    return checks(), {
        "mean 3 % larger": checks(mean=1.03 * MEAN),
        "variance 3 % smaller": checks(variance=0.97 * LOG_RATIO_VARIANCE),
        "an impact that keeps 97 %": checks(ln=flights + math.log(0.97)),
    }


def return_moments(seed: int, workers: int) -> Found:
    """Check moments of the ratio of consecutive speeds, ``E rho^s = 1 / (2 cos(pi (1 + s) /
    3))``."""
    ln = log_speeds(1.0, RETURNS, 1, seed + 2)[:, 0]

    def checks(wrong: float = 1.0, shifted: float = 0.0) -> Checks:
        for s in RATIO_ORDERS:
            truth = wrong / (2.0 * math.cos(math.pi * (1.0 + s + shifted) / 3.0))
            yield check_mean(f"E rho^{s:g}", np.exp(s * ln), truth)

    return checks(), {
        "moments 1 % larger": checks(wrong=1.01),
        "orders 0.02 larger": checks(shifted=0.02),
    }


def mean_drift(epsilon: float, paths: int, bounces: int, seed: int) -> tuple[float, float]:
    """Mean change of ln speed per bounce, and its standard error."""
    whole = log_speeds(epsilon, paths, bounces, seed)[:, -1] / bounces
    return whole.mean(), whole.std() / math.sqrt(paths)


def critical_restitution(seed: int, workers: int) -> Found:
    """Check the drift of ln speed per bounce below and above the critical restitution, and where it
    is zero."""
    d0, s0 = mean_drift(BELOW_CRITICAL, EXIT_PATHS, NOISY_BOUNCES, seed)
    d1, s1 = mean_drift(ABOVE_CRITICAL, EXIT_PATHS, NOISY_BOUNCES, seed + 1)
    span = math.log(ABOVE_CRITICAL / BELOW_CRITICAL)
    share = -d0 / (d1 - d0)  # linear interpolation in ln epsilon to zero drift
    zero = BELOW_CRITICAL * math.exp(span * share) if d0 < 0.0 < d1 else math.nan
    se = zero * span / (d1 - d0) * math.hypot((1.0 - share) * s0, share * s1)

    def checks(power: float = 1.0, mean: float = MEAN) -> Checks:
        for epsilon, drift, error in ((BELOW_CRITICAL, d0, s0), (ABOVE_CRITICAL, d1, s1)):
            name = f"drift per bounce at epsilon {epsilon:g}"
            yield Check(name, drift, power * math.log(epsilon) + mean, error)
        yield Check("critical restitution", zero, math.exp(-mean / power), se)

    return checks(), {
        "mean 3 % larger": checks(mean=1.03 * MEAN),
        "epsilon squared": checks(power=2.0),
    }


GAUSSIAN_PATHS = 100_000
FREE_FLIGHT = 3.3  # time of the flight without walls
# error of a simulated moment by the step: h^4 / 720 at the default step of exact flights, and
# rounding
STEP_ERROR = 1e-6
START = Start(0.3, 0.1, -0.4, -0.2, 0.5)
SCENE = Scene(
    alpha=1.5,
    epsilon=0.9,
    beta1=0.083,
    beta2=0.9,
    gamma1=0.057,
    gamma2=0.029,
    mu=0.6,
    sigma=0.4,
    # which no path crosses
    gap1=1e6,
    gap2=1e6,
    start=START,
)
"""Two stages that are driven by the same noise with different modulations."""

# damping, noise and half width of the box
BETA = 0.5
UNIT_SIGMA = 1.0
BOX = 0.5
NOISY_IMPACTS = 64
# by then X has an sd of 4 boxes, and the folded density is uniform up to exp(-80)
FOLDED_TIMES = (8.0, 8.8, 9.6)
LOSSY = 0.97  # restitution of the negative control


def _kurtosis(name: str, found: float, truth: float = 0.0) -> Check:
    """Check the excess kurtosis of a Gaussian quantity."""
    return Check(f"kurtosis of {name}", found, truth, math.sqrt(24.0 / GAUSSIAN_PATHS))


def _follow(
    scene: Scene, times: Sequence[float], impacts: int, seeds: list[int], workers: int
) -> Ensemble:
    """Simulate paths by exact flights, with their moments at fixed times."""
    return simulate(
        scene,
        paths=GAUSSIAN_PATHS,
        impacts=impacts,
        rng=np.random.SeedSequence(seeds),
        workers=workers,
        sampling=Sampling(horizon=times[-1] - scene.start.tau + 0.1),
        record=Record(times=times),
    )


def _central(run: Ensemble, quantity: str, power: int) -> Floats:
    """Central moments of a quantity at the fixed times, shape (times,)."""
    wheels = run.scene.stages
    i = state_names(wheels).index(quantity)
    at = state_pairs(wheels).index((i, i))
    return np.asarray(run.result.sums["fixed"].moment(power, 0)[:, at])


def free_flight(seed: int, workers: int) -> Found:
    """Check the first four moments of `montecarlo.simulate` against the flow and its covariance."""
    run = _follow(SCENE, [START.tau + FREE_FLIGHT], 1, [seed, 7], workers)
    row = run.at_times().iloc[0]
    t = run.fixed_times[0] - START.tau
    names = state_names(SCENE.stages)

    def checks(scene: Scene = SCENE) -> Checks:
        mean = flow(scene.constants, START.tau, scene.start_state, t)
        covariance = noise_covariance(scene.constants, START.tau, t)
        for q, truth in zip(names, mean.tolist(), strict=True):
            yield check_moment(row, q, f"E {q}", truth, STEP_ERROR)
        for i, j in state_pairs(SCENE.stages):
            column = f"cov_{names[i]}_{names[j]}"
            truth = covariance[i, j]
            yield check_moment(row, column, column.replace("_", " "), truth, STEP_ERROR)

    def shape(skewness: float, kurtosis: float) -> Checks:
        for q in names:
            m2, m3, m4 = (_central(run, q, power)[0] for power in (2, 3, 4))
            se = math.sqrt(6.0 / GAUSSIAN_PATHS)
            yield Check(f"skewness of {q}", m3 / m2**1.5, skewness, se)
            yield _kurtosis(q, m4 / m2**2 - 3.0, kurtosis)

    return [*checks(), *shape(0.0, 0.0)], {
        "2 % more noise": checks(SCENE.with_sigma(1.02 * SCENE.sigma)),
        "a second stage that the noise does not reach": checks(replace(SCENE, beta2=SCENE.beta1)),
        "skewness 0.05": shape(0.05, 0.0),
        "kurtosis 0.1": shape(0.0, 0.1),
    }


def speed_variance(tau: float, beta: float, sigma: float) -> float:
    """Compute the periodic solution of ``V' = -2 beta V + sigma^2 m^2`` with ``m = -sin tau + beta
    cos tau``.

    It follows from ``m^2 = (1 + beta^2) / 2 + a cos 2 tau + b sin 2 tau``.
    """
    a = -0.5 * (1.0 - beta**2)
    b = -beta
    wave = ((beta * a - b) * math.cos(2.0 * tau) + (a + beta * b) * math.sin(2.0 * tau)) / (
        2.0 * (beta**2 + 1.0)
    )
    return sigma**2 * ((1.0 + beta**2) / (4.0 * beta) + wave)


def elastic_box(seed: int, workers: int) -> Found:
    """Check that displacement is uniform and velocity Gaussian with a closed-form variance, at
    three fixed times."""
    scene = bare(epsilon=1.0, beta1=BETA, gap1=BOX, sigma=UNIT_SIGMA, start=Start())
    run, lossy = (
        _follow(replace(scene, epsilon=e), FOLDED_TIMES, NOISY_IMPACTS, [seed, 5], workers)
        for e in (1.0, LOSSY)
    )

    def checks(run: Ensemble = run, sigma: float = UNIT_SIGMA, phase: float = 0.0) -> Checks:
        followed = run.result.sums["fixed"].n[:, state_pairs(run.scene.stages).index((1, 1))]
        yield Check("paths followed to the end", followed.min(), GAUSSIAN_PATHS)
        kurtosis = _central(run, "y1", 4) / _central(run, "y1", 2) ** 2 - 3.0
        at_start = speed_variance(phase, BETA, sigma)
        rows = run.at_times().to_dict("records")
        for time, row, excess in zip(run.fixed_times.tolist(), rows, kurtosis, strict=True):
            decay = math.exp(-2.0 * BETA * time)
            variance = speed_variance(time + phase, BETA, sigma) - decay * at_start
            moments = {
                "x1": ("E x", 0.0),
                "cov_x1_x1": ("E x^2", BOX**2 / 3.0),
                "cov_x1_y1": ("E x y", 0.0),
                "y1": ("E y", 0.0),
                "cov_y1_y1": ("E y^2", variance),
            }
            for column, (name, truth) in moments.items():
                yield check_moment(row, column, f"{name} at {time:.2f}", truth)
            yield _kurtosis(f"y at {time:.2f}", excess)

    return checks(), {
        f"restitution {LOSSY:g}": checks(lossy),
        "2 % more noise": checks(sigma=1.02 * UNIT_SIGMA),
        "modulation 0.1 late": checks(phase=-0.1),
    }
