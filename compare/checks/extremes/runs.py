"""Runs at extreme values: exact invariances (units, whole periods), a noisy particle, sticking,
tolerances.  Each function yields errors, whose size and admissible worst stand in the texts."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import product
from typing import Any, TypeAlias

import mpmath as mp
import numpy as np
import pandas as pd

from rattle import closure, montecarlo
from rattle.closure import CLOSURES
from rattle.compare.checks.check import bare, farthest
from rattle.compare.checks.published import noise
from rattle.compare.validation import validate as validation
from rattle.montecarlo import SCHEMES, Record, Sampling
from rattle.montecarlo.coupling.paths import LongPath
from rattle.montecarlo.statistics.intervals import widest
from rattle.scene import (
    DAT21,
    Scene,
    Start,
    Tolerance,
    flight,
    impact,
    long_orbit,
    orbit,
    state_names,
)
from rattle.scene.tangent import Stretch

Errors: TypeAlias = Iterator[float]

EXTREME_IMPACTS = 3
# powers of two as factors on the lengths of DAT21: half gaps of 7e-9, 6e-5 and 8e3
LENGTH_POWERS = (-26, -13, 14)
START_TIMES = (1e4, 1e8, 1e12, -1e12)
EXTREME_SIGMAS = (0.0, 1e-30, 1e-8, 1e4)
STATE = LENGTHS = state_names(2)
# impacts of a long run
LONG_RUN_IMPACTS = 10_000_000
STRETCH_IMPACTS = 500_000
LONG_RUN_PERIODS = 1_000_000


def _scene(tau: float = 0.0) -> Scene:
    start = Start(tau, 0.5, 2.0, 0.5, 2.0, mesh=1)
    return Scene.from_gears(DAT21, sigma=0.1, start=start)


def _exact_phase(tau: float) -> float:
    """The phase of a time in [-pi, pi], with 400 digits of pi."""
    with mp.workdps(400):
        turn = 2 * mp.pi
        return float(mp.mpf(tau) - turn * mp.nint(mp.mpf(tau) / turn))


def _tables(scene: Scene) -> list[pd.DataFrame]:
    """Numbers of every closure and every scheme at the impacts, and of the long orbit and the long
    noisy path."""
    loose = replace(
        scene, tolerance=Tolerance(scene.gap1 / 64.0, scene.gap2 / 64.0, draw="contact")
    )
    sample = partial(montecarlo.simulate, paths=64, impacts=EXTREME_IMPACTS, rng=3)
    predict = partial(closure.mean_map, impacts=EXTREME_IMPACTS)
    results: list[Any] = [predict(scene, closure=name) for name in CLOSURES]
    results += [sample(scene, scheme=s, record=Record(step_bias=False)) for s in SCHEMES]
    results.append(predict(loose, closure="saltation"))
    results.append(sample(loose))
    tables = [result.phase_reduced.section.select_dtypes("number") for result in results]
    path, _ = LongPath(scene, seed=3).stretch(500)
    columns = ["phase", "flight", *(f"growth{i}" for i in range(4)), *LENGTHS]
    for s in (long_orbit.LongOrbit(scene).stretch(50), path):
        numbers = np.column_stack([s.phase, s.flight, s.growth, s.before])
        tables.append(pd.DataFrame(numbers, columns=columns))
    return tables


def _verdicts(scene: Scene) -> np.ndarray:
    """The verdict on every moment of every closure."""
    judged = validation.validate(scene, impacts=2, paths=1024, rng=1)
    return judged.table["verdict"].to_numpy(str)


def unit_of_length() -> Errors:
    """All lengths, speeds, accelerations and the noise times a power of two: every table scales bit
    for bit."""
    tables = _tables(_scene())
    verdicts = _verdicts(_scene())
    for power in LENGTH_POWERS:
        factor = 2.0**power
        scene = _scene().scaled(factor)
        for scaled, table in zip(_tables(scene), tables, strict=True):
            lengths = [
                str(name).removeprefix("se_").removeprefix("sd_") in LENGTHS for name in table
            ]
            exact = table.to_numpy(float) * np.where(lengths, factor, 1.0)
            yield farthest(scaled, exact, np.abs(exact))
        yield float((_verdicts(scene) != verdicts).sum())


def whole_periods() -> Errors:
    """A start so late that its absolute time lacks the digits of a flight, compared with the same
    phase near 0."""
    for tau in START_TIMES:
        near_zero = _tables(_scene(_exact_phase(tau)))
        for later, table in zip(_tables(_scene(tau)), near_zero, strict=True):
            yield farthest(later, table, np.maximum(table.abs(), 1.0))


def proportional_sds() -> Errors:
    """Sds of the linear closures are proportional to the noise intensity."""
    for name in ("corrected", "saltation"):

        def sds(sigma: float, name: str = name) -> np.ndarray:
            predicted = closure.mean_map(_scene().with_sigma(sigma), impacts=6, closure=name)
            return predicted.section.filter(like="sd_").to_numpy()

        for sigma in EXTREME_SIGMAS:
            exact = sigma * sds(1.0)
            yield farthest(sds(sigma), exact, np.maximum(exact, 1e-13 * sigma))


def phases() -> Errors:
    """The phase of a late start."""
    starts = [s * 10.0**k for k in range(1, 12) for s in (1.0, -1.0, 3.7, 10.0)]
    exact = np.array([_exact_phase(t) for t in starts])
    yield farthest([_scene(t).phase for t in starts], exact, np.abs(exact))


def absolute_times() -> Errors:
    """Absolute times are the local ones plus that of the start, rounded once; verdicts do not
    depend on the start."""
    for tau in START_TIMES:
        late = _scene(tau)
        m = closure.mean_map(late, impacts=EXTREME_IMPACTS)
        since = m.phase_reduced.section["tau"].to_numpy() - late.phase
        exact = [float(Fraction(tau) + Fraction(s)) for s in since]
        yield farthest(m.section["tau"], exact, np.spacing(abs(tau)))
        scenes = late, _scene(_exact_phase(tau))
        a, b = (validation.validate(s, impacts=2, paths=4096, rng=1, dt=0.01).table for s in scenes)
        yield float((a["verdict"] != b["verdict"]).sum())
        # at a fixed time `branching` takes back the noise of the rest of the flight, which cancels
        # most of it
        cancels = (a["closure"] == "branching") & (a["kind"] == "fixed time")
        scale = np.where(cancels, 1e-7, 1e-11)[:, None]
        errors = ["error", "low", "high"]
        yield farthest(a[errors], b[errors], scale)


def _stretches(orbit: long_orbit.LongOrbit, impacts: int) -> Iterator[Stretch]:
    """A long orbit in stretches of `STRETCH_IMPACTS`."""
    for _ in range(impacts // STRETCH_IMPACTS):
        yield orbit.stretch(STRETCH_IMPACTS, tangent=False)


def energy() -> Errors:
    """Elastic impacts at both meshes without excitation, damping or drag conserve energy."""
    start = Start(0.0, 0.1, 1.3, -0.2, -0.7)
    mu = 0.6
    heavy = mu / (1.0 - mu)  # mass of wheel 2 over that of wheel 1

    def energy_of(y1: Any, y2: Any) -> Any:
        return 0.5 * (y1**2 + heavy * (y2 - y1) ** 2)

    exact = energy_of(start.y1, start.y2)
    orbit = long_orbit.LongOrbit(bare(epsilon=1.0, mu=mu, gap2=0.7, start=start, stages=2))
    for s in _stretches(orbit, LONG_RUN_IMPACTS):
        yield farthest(energy_of(s.before[:, 1], s.before[:, 3]), exact, exact)
        yield 0.0 if len(s.flight) == STRETCH_IMPACTS else math.inf


def elastic_flights() -> Errors:
    """Elastic impacts at one mesh: every flight takes gap over speed, and the phase is the sum of
    the flights."""
    speed = 1.7
    gap = 0.5
    start = Start(0.0, gap, speed, mesh=1)
    orbit = long_orbit.LongOrbit(bare(epsilon=1.0, gap1=gap, start=start))
    flight = 2.0 * gap / speed
    for k, s in enumerate(_stretches(orbit, LONG_RUN_IMPACTS), start=1):
        yield farthest(s.flight, flight, flight)
        yield farthest(np.abs(s.before[:, :2]), [gap, speed], [gap, speed])
        yield abs(math.remainder(k * STRETCH_IMPACTS * flight - s.phase[-1], 2.0 * math.pi))


def periodic_motion() -> Errors:
    """A periodic motion with one impact per period of the excitation, whose phase and speed are
    known in closed form.

    ``x'' = gamma - alpha sin tau`` returns to the wall after 2 pi if ``y0 + pi gamma = alpha cos
    tau0``, with a velocity larger by ``2 pi gamma``; the impact restores y0 if ``y0 = -2 pi gamma
    epsilon / (1 + epsilon)``.
    """
    alpha = 1.0
    epsilon = 0.5
    gamma = 0.3
    gap = 10.0
    y0 = -2.0 * math.pi * gamma * epsilon / (1.0 + epsilon)
    phase = math.acos((y0 + math.pi * gamma) / alpha)
    start = Start(phase, gap, -y0 / epsilon, mesh=1)
    scene = bare(alpha=alpha, epsilon=epsilon, gamma1=gamma, gap1=gap, start=start)
    orbit = long_orbit.LongOrbit(scene)
    for s in _stretches(orbit, LONG_RUN_PERIODS):
        yield np.abs(np.angle(np.exp(1j * (s.phase - phase)))).max()
        yield farthest(s.before[:, 1], -y0 / epsilon, 1.0)
        yield farthest(s.flight, 2.0 * math.pi)
        yield 0.0 if len(s.flight) == STRETCH_IMPACTS else math.inf


EXTREME_PATHS = 3_000

# sigma, half gap
EXITS = ((1e-3, 1e-8), (1e-3, 1e-6), (1.0, 1e-3), (1e4, 1e-8), (1e4, 1e-3), (1e4, 10.0))
# relative bias of an exit time, by a step of a thousandth of it and by the modulation of the noise
EXIT_BIAS = 2e-3


def _reach(run: montecarlo.Ensemble) -> float:
    """Largest distance of an impact from the middle of its gap."""
    assert run.raw is not None
    return float(np.nan_to_num(np.abs(run.raw[:, :, [2, 4]])).max())


# time of a flight from tau = 0, where the noise has no modulation yet: the most demanding flight
EXTREME_FLIGHT = 0.2
FREE_DAMPINGS = (0.0, 1e-3, 0.1, 1.0, 10.0, 100.0, 1e3)
FREE_STEPS = (1 / 8, 1.0)  # in units of the longest admissible one


def free_covariance() -> Errors:
    """Sds of exact flights without walls, from a phase at which the noise is not modulated yet;
    with the half widths of their intervals."""
    gears = Scene.from_gears(DAT21, sigma=0.3)
    open_space = replace(gears, gears=None, gap1=1e6, gap2=1e6, start=Start(0.0, 0.0, 0.0))
    z = widest(len(FREE_DAMPINGS) * len(FREE_STEPS) * len(STATE))
    for beta, share in product(FREE_DAMPINGS, FREE_STEPS):
        scene = replace(open_space, beta1=beta, beta2=beta * gears.beta2 / gears.beta1)
        longest, _ = montecarlo.largest_step(scene, "exact-flight")
        run = montecarlo.simulate(
            scene,
            paths=EXTREME_PATHS,
            impacts=1,
            dt=EXTREME_FLIGHT / math.ceil(EXTREME_FLIGHT / (share * longest)),
            sampling=Sampling(horizon=1.5 * EXTREME_FLIGHT),
            record=Record(times=[EXTREME_FLIGHT]),
        )
        row = run.at_times().iloc[0]
        variances = flight.noise_covariance(scene.constants, 0.0, EXTREME_FLIGHT).diagonal()
        for q, variance in zip(STATE, variances, strict=True):
            # what does not vary has no relative error
            if variance > 1e-12 * variances.max():
                error = math.sqrt(row[f"cov_{q}_{q}"] / variance) - 1.0
                yield abs(error) + z * row[f"se_cov_{q}_{q}"] / (2.0 * variance)


def exit_times() -> Errors:
    """Mean exit times of a randomly accelerated particle from the middle and from a tenth of a
    gap."""
    schemes = (("euler-maruyama-located", 1e-3), ("exact-flight", 0.3))
    for (n, (sigma, half)), share, (scheme, step) in product(enumerate(EXITS), (0.1, 0.5), schemes):
        exact = noise.mean_exit_time(2.0 * half * share, 2.0 * half, sigma)
        longest, _ = montecarlo.largest_step(noise.particle(share, half, sigma), scheme)
        dt = min(step * exact, longest)
        check = noise.check_exit(
            scheme, share, half, sigma, dt=dt, left=EXIT_BIAS, paths=4096, rng=n
        )
        yield check.z


def collapse_drift() -> Errors:
    """Drift of ln speed per bounce, below and above the restitution at which a noisy particle
    collapses."""
    for n, epsilon in enumerate((1e-9, 0.1, math.exp(-noise.MEAN), 1.0)):
        drift, se = noise.mean_drift(epsilon, EXTREME_PATHS, 6, n)
        yield abs(drift - math.log(epsilon) - noise.MEAN) / se


def stay_between_walls() -> Errors:
    """Paths that collapse onto a wall, or stick to it, stay between the walls and reach the end."""
    for epsilon, sigma, scheme in product((0.0, 0.05, 0.163, 1.0), (1e-3, 1.0, 1e3), SCHEMES):
        scene = Scene.from_gears(replace(DAT21, epsilon=epsilon), sigma=sigma)
        dt = min(5e-3, 0.1 / (2.0 + sigma))
        fixed = dt * np.array([64.0, 128.0, 256.0])
        run = montecarlo.simulate(
            scene,
            paths=32,
            impacts=4,
            dt=dt,
            scheme=scheme,
            sampling=Sampling(horizon=256.0 * dt),
            record=Record(times=fixed, raw=True),
        )
        means = run.at_times()[["x1", "x2"]].abs().to_numpy()
        over = max(means.max(), _reach(run)) - 0.5
        beyond = SCHEMES[scheme].detects_at_end
        unit = 0.5 + (10.0 + 5.0 * sigma * math.sqrt(dt)) * dt * 1e9 * beyond
        yield max(over, 0.0) / unit if len(means) == len(fixed) else math.inf


def sticking_paths() -> Errors:
    """Under drag a path completes its chatter at the time of the bouncing ball, and sticks from
    then on."""
    for gap in (1e-8, 0.5, 1e4):
        # drag in half gaps per unit of time squared
        for pull in (p for p in (1.0, 1e2, 1e4) if p * gap <= 1e6):
            drag = pull * gap
            epsilon = 0.5
            fall = math.sqrt(4.0 / pull)  # time to fall through the whole gap from zero velocity
            closed = fall * (1.0 + 2.0 * epsilon / (1.0 - epsilon))
            start = Start(0.0, -gap, math.ulp(0.0) + 1e-12 * gap / fall)
            scene = bare(epsilon=epsilon, gamma1=drag, gap1=gap, start=start)
            for scheme in SCHEMES:
                dt = min(fall / 256.0, 0.05)
                run = montecarlo.simulate(
                    scene,
                    paths=1,
                    impacts=10_000,
                    dt=dt,
                    scheme=scheme,
                    sampling=Sampling(horizon=2.5 * closed),
                    record=Record(times=[2.0 * closed]),
                )
                row = run.at_times().iloc[0]
                # largest speed of the plain scheme, which detects a wall at the end of a step
                bounce = 2.0 * drag * dt
                yield farthest(row["x1"], gap, gap + drag * dt * dt)
                yield max(abs(row["y1"]) / bounce - 1.0, 0.0)
            for name in ("corrected", "saltation"):
                m = closure.mean_map(scene.with_sigma(1e-3 * gap), impacts=200, closure=name)
                yield 0.0 if m.stopped or m.trace.found == 200 else math.inf


def large_tolerances() -> Errors:
    """Tolerances as large as the gap: a fixed one equals a wider gap; with random ones no path is
    beyond its walls."""
    for gap in (1e-8, 0.5, 1e4):
        plain = Scene.from_gears(DAT21, sigma=0.1).scaled(2.0 * gap)
        most = gap * (1.0 - 2.0**-40)
        fixed = replace(plain, tolerance=Tolerance(most, most, distribution="fixed"))
        start = replace(plain.start, x1=gap + most, x2=gap + most)
        wide = replace(plain, gap1=gap + most, gap2=gap + most, start=start)
        sample = partial(montecarlo.simulate, paths=32, impacts=3, rng=1)
        runs: list[Callable[[Scene], Any]] = [
            partial(closure.mean_map, impacts=3, closure=c) for c in CLOSURES if c != "branching"
        ]
        runs += [partial(sample, sampling=Sampling(control=control)) for control in (False, True)]
        for compute in runs:
            a, b = (compute(s).section.select_dtypes("number") for s in (fixed, wide))
            yield farthest(a, b, gap)
        for distribution, draw in product(("uniform", "normal"), ("path", "contact")):
            tolerance = Tolerance(most, most, distribution=distribution, draw=draw)
            loose = replace(plain, tolerance=tolerance, start=Start(0.0, 0.0, gap))
            run = montecarlo.simulate(
                loose,
                paths=64,
                impacts=4,
                rng=2,
                sampling=Sampling(horizon=20.0),
                record=Record(raw=True),
            )
            yield max(_reach(run) / (gap + most) - 1.0, 0.0)


PULLS = (0.01, 1.0, 100.0)  # accelerations by drag, in half gaps per unit of time squared


def grazing() -> Errors:
    """A parabolic flight ``y t + drag t^2 / 2`` whose apex passes or misses a wall by a small
    fraction of the gap."""
    shares = np.outer(np.geomspace(1e-12, 1e-1, 7), [1.0, -1.0]).ravel().tolist()
    for gap, share, pull in product((1e-8, 0.5, 1e4), shares, PULLS):
        # from 0 towards the lower wall
        drag = pull * gap
        y = -math.sqrt(2.0 * drag * gap * (1.0 + share))
        c = bare(beta2=0.0, gamma1=drag, gap1=gap).constants
        t, mesh, side, _ = impact.next_impact(c, 0.0, np.array([0.0, y]), 1e4)
        square = Fraction(y) ** 2
        fall = 2 * Fraction(drag) * Fraction(gap)
        exact_side = -1 if square > fall else 1
        speed = math.sqrt(square + exact_side * fall)  # at the wall
        exact = (exact_side * speed - y) / drag
        # the wall is known to rounding, so the time to rounding of gap / speed
        met = (mesh, side) == (1, exact_side)
        yield farthest(t, exact, exact + gap / speed) if met else math.inf


def simultaneous() -> Errors:
    """Simultaneous impacts at both meshes: mesh 1 comes first, then mesh 2 with the velocity left
    by it."""
    for gap in (2.0**-27, 0.5, 2.0**13):
        start = Start(0.0, 0.0, 2.0 * gap, 0.0, -3.0 * gap)
        scene = bare(mu=0.25, gap1=gap, gap2=1.5 * gap, start=start, stages=2)
        # at tau = 1/2: mesh 1 at +gap1 and mesh 2 at -gap2; the impact at mesh 1 leaves y = (-gap,
        # -6 gap)
        exact: dict[str, list[float]] = {"tau": [0.5, 0.5], "mesh": [1, 2], "side": [1, -1]}
        # in gaps
        lengths = {"x1": [1.0, 1.0], "y1": [2.0, -1.0], "x2": [-1.5, -1.5], "y2": [-3.0, -6.0]}
        sides: list[pd.DataFrame] = [orbit.follow(scene, 2).table[1:]]
        for scheme in ("euler-maruyama-located", "exact-flight"):
            run = montecarlo.simulate(scene, paths=1, impacts=2, scheme=scheme, dt=2.0**-7)
            sides.append(run.section)
        for side in sides:
            yield from (farthest(side[name], exact[name]) for name in exact)
            yield from (farthest(side[name] / gap, lengths[name]) for name in lengths)


def chatter_time() -> Errors:
    """A ball that falls from the middle of the gap completes its chatter after ``(1 + eps) / (1 -
    eps)`` fall times."""
    for gap, pull, epsilon in product(
        (2.0**-26, 0.5, 2.0**13), PULLS, (0.0, 1e-12, 0.1, 0.5, 0.9, 0.99)
    ):
        scene = bare(epsilon=epsilon, gamma1=pull * gap, gap1=gap, start=Start())
        exact = math.sqrt(2.0 / pull) * (1.0 + epsilon) / (1.0 - epsilon)
        phases = [(p.closed, p.opened) for p in orbit.follow(scene, 5000).sticking]
        yield farthest(np.ravel(phases), [exact, math.inf], exact) if phases else math.inf


def sticking_end() -> Errors:
    """A mesh that drag keeps closed opens when the driver's acceleration exceeds the drag."""
    shares = (0.3, 0.9, 0.999)  # drag over the largest acceleration of the driver
    for size, share, beta in product((2.0**-26, 1.0, 2.0**13), shares, (0.0, 1e-6, 1e-3, 1.0)):
        start = Start(0.0, 0.5 * size, 0.1 * size, 0.0, 0.0, mesh=1)
        drag = share * math.hypot(1.0, beta) * size  # the driver's is |beta cos tau - sin tau|
        scene = Scene(
            alpha=size, epsilon=0.2, beta1=beta, gamma1=drag, gap1=0.5 * size, stages=1, start=start
        )
        # the decreasing zero of share + sin(atan beta - tau)
        exact = math.asin(share) + math.atan(beta)
        phases = [p for p in orbit.follow(scene, 60).sticking if p.opened - p.closed > 0.1]
        yield math.inf if not phases else 0.0
        yield from (abs(math.remainder(p.opened - exact, 2.0 * math.pi)) for p in phases)
