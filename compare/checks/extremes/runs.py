"""Runs at extreme values: exact invariances (units, whole periods), a noisy particle, sticking,
tolerances."""

import math
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from rattle import closure, montecarlo
from rattle.closure import CLOSURES
from rattle.compare.checks.check import Check, bare, extreme, farthest
from rattle.compare.checks.extremes import truth
from rattle.compare.checks.published import noise
from rattle.compare.validation import validate as validation
from rattle.montecarlo import SCHEMES, Record, Sampling
from rattle.montecarlo.coupling.paths import LongPath
from rattle.scene import DAT21, Scene, Start, Tolerance, long_orbit

EXTREME_IMPACTS = 3
# powers of two as factors on the lengths of DAT21: half gaps of 7e-9, 6e-5 and 8e3
LENGTH_POWERS = (-26, -13, 14)
START_TIMES = (1e4, 1e8, 1e12, -1e12)
EXTREME_SIGMAS = (0.0, 1e-30, 1e-8, 1e4)
LENGTHS = ("x1", "y1", "x2", "y2")
# impacts of a long run
LONG_RUN_IMPACTS = 10_000_000
STRETCH_IMPACTS = 500_000
LONG_RUN_PERIODS = 1_000_000


def _scene(tau: float = 0.0) -> Scene:
    start = Start(tau, 0.5, 2.0, 0.5, 2.0, mesh=1)
    return Scene.from_gears(DAT21, sigma=0.1, start=start)


def _tables(scene: Scene) -> list[pd.DataFrame]:
    """Numbers of every closure and every scheme at the impacts, and of the long orbit and the long
    noisy path."""
    loose = replace(
        scene, tolerance=Tolerance(scene.gap1 / 64.0, scene.gap2 / 64.0, draw="contact")
    )
    chosen: dict[str, Any] = {"paths": 64, "impacts": EXTREME_IMPACTS, "rng": 3}
    results: list[Any] = [
        closure.mean_map(scene, impacts=EXTREME_IMPACTS, closure=name) for name in CLOSURES
    ]
    results += [
        montecarlo.simulate(scene, scheme=s, record=Record(step_bias=False), **chosen)
        for s in SCHEMES
    ]
    results.append(closure.mean_map(loose, impacts=EXTREME_IMPACTS, closure="saltation"))
    results.append(montecarlo.simulate(loose, scheme="exact-flight", **chosen))
    path, _ = LongPath(scene, seed=3).stretch(500)
    stretches = (long_orbit.LongOrbit(scene).stretch(50), path)
    columns = ["phase", "flight", *(f"growth{i}" for i in range(4)), *LENGTHS]
    return [result.phase_reduced.section.select_dtypes("number") for result in results] + [
        pd.DataFrame(np.column_stack([s.phase, s.flight, s.growth, s.before]), columns=columns)
        for s in stretches
    ]


def _verdicts(scene: Scene) -> np.ndarray:
    """The verdict on every moment of every closure."""
    found = validation.validate(scene, impacts=2, paths=1024, rng=1, scheme="exact-flight")
    return found.table["verdict"].to_numpy(str)


@extreme(allowed=0.0)
def unit_of_length() -> Iterator[float]:
    """All lengths, speeds, accelerations and the noise times a power of two: every table scales bit
    for bit."""
    tables = _tables(_scene())
    verdicts = _verdicts(_scene())
    for power in LENGTH_POWERS:
        factor = 2.0**power
        scene = _scene().scaled(factor)
        for found, table in zip(_tables(scene), tables, strict=True):
            lengths = [
                str(name).removeprefix("se_").removeprefix("sd_") in LENGTHS for name in table
            ]
            exact = table.to_numpy(float) * np.where(lengths, factor, 1.0)
            yield farthest(found, exact, np.abs(exact))
        yield float((_verdicts(scene) != verdicts).sum())


@extreme(allowed=1e-11)
def whole_periods() -> Iterator[float]:
    """A start so late that its absolute time lacks the digits of a flight, compared with the same
    phase near 0."""
    for tau in START_TIMES:
        for found, table in zip(
            _tables(_scene(tau)), _tables(_scene(truth.phase(tau))), strict=True
        ):
            yield farthest(found, table, np.maximum(table.abs(), 1.0))


@extreme(allowed=1e-11)
def proportional_sds() -> Iterator[float]:
    """Sds of the linear closures are proportional to the noise intensity."""
    for name in ("corrected", "saltation"):
        one, *others = (
            closure.mean_map(_scene().with_sigma(sigma), impacts=6, closure=name).section.filter(
                like="sd_"
            )
            for sigma in (1.0, *EXTREME_SIGMAS)
        )
        for sigma, table in zip(EXTREME_SIGMAS, others, strict=True):
            exact = sigma * one.to_numpy()
            yield farthest(table, exact, np.maximum(exact, 1e-13 * sigma))


@extreme()
def phases() -> Iterator[float]:
    """The phase of a late start."""
    starts = [s * 10.0**k for k in range(1, 12) for s in (1.0, -1.0, 3.7, 10.0)]
    exact = np.array([truth.phase(t) for t in starts])
    yield farthest([_scene(t).phase for t in starts], exact, np.abs(exact))


@extreme(allowed=0.5)
def absolute_times() -> Iterator[float]:
    """Absolute times are the local ones plus that of the start, rounded once; verdicts do not
    depend on the start."""
    for tau in START_TIMES:
        late = _scene(tau)
        m = closure.mean_map(late, impacts=EXTREME_IMPACTS)
        since = m.phase_reduced.section["tau"].to_numpy() - late.phase
        exact = [float(Fraction(tau) + Fraction(s)) for s in since]
        yield farthest(m.section["tau"], exact, np.spacing(abs(tau)))
        scenes = (late, _scene(truth.phase(tau)))
        a, b = (validation.validate(s, impacts=2, paths=4096, rng=1, dt=0.01).table for s in scenes)
        yield float((a["verdict"] != b["verdict"]).sum())
        # at a fixed time `branching` takes back the noise of the rest of the flight, which cancels
        # most of it
        scale = np.where((a["closure"] == "branching") & (a["kind"] == "fixed time"), 1e-7, 1e-11)[
            :, None
        ]
        yield farthest(a[["error", "low", "high"]], b[["error", "low", "high"]], scale)


@extreme(allowed=1e-9)
def energy() -> Iterator[float]:
    """Elastic impacts at both meshes without excitation, damping or drag conserve energy."""
    speed1 = 1.3
    speed2 = -0.7
    mu = 0.6
    start = Start(0.0, 0.1, speed1, -0.2, speed2)
    orbit = long_orbit.LongOrbit(bare(epsilon=1.0, mu=mu, gap2=0.7, start=start, stages=2))
    heavy = mu / (1.0 - mu)  # mass of wheel 2 over that of wheel 1
    most = 0.5 * (speed1**2 + heavy * (speed2 - speed1) ** 2)
    for _ in range(LONG_RUN_IMPACTS // STRETCH_IMPACTS):
        s = orbit.stretch(STRETCH_IMPACTS, tangent=False)
        y1 = s.before[:, 1]
        y2 = s.before[:, 3]
        yield farthest(0.5 * (y1**2 + heavy * (y2 - y1) ** 2), most, most)
        yield 0.0 if len(s.flight) == STRETCH_IMPACTS else math.inf


@extreme(allowed=1e-6)
def elastic_flights() -> Iterator[float]:
    """Elastic impacts at one mesh: every flight takes gap over speed, and the phase is the sum of
    the flights."""
    speed = 1.7
    gap = 0.5
    start = Start(0.0, gap, speed, mesh=1)
    orbit = long_orbit.LongOrbit(bare(epsilon=1.0, gap1=gap, start=start))
    flight = 2.0 * gap / speed
    for k in range(LONG_RUN_IMPACTS // STRETCH_IMPACTS):
        s = orbit.stretch(STRETCH_IMPACTS, tangent=False)
        yield farthest(s.flight, flight, flight)
        yield farthest(np.abs(s.before[:, :2]), [gap, speed], [gap, speed])
        yield abs(math.remainder((k + 1) * STRETCH_IMPACTS * flight - s.phase[-1], 2.0 * math.pi))


@extreme(allowed=1e-12)
def periodic_motion() -> Iterator[float]:
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
    for _ in range(LONG_RUN_PERIODS // STRETCH_IMPACTS):
        s = orbit.stretch(STRETCH_IMPACTS, tangent=False)
        yield float(np.abs(np.angle(np.exp(1j * (s.phase - phase)))).max())
        yield farthest(s.before[:, 1], -y0 / epsilon, 1.0)
        yield farthest(s.flight, 2.0 * math.pi)
        yield 0.0 if len(s.flight) == STRETCH_IMPACTS else math.inf


EXTREME_PATHS = 3_000
Z = 4.5
"""Admissible standard errors in a row; 40 checks of a correct program exceed them with a
probability of 3e-4."""

# sigma, half gap
EXITS = ((1e-3, 1e-8), (1e-3, 1e-6), (1.0, 1e-3), (1e4, 1e-8), (1e4, 1e-3), (1e4, 10.0))
# relative bias of an exit time, by a step of a thousandth of it and by the modulation of the noise
EXIT_BIAS = 2e-3


def _run(scene: Scene, horizon: float, scheme: str, **settings: Any) -> montecarlo.Ensemble:
    return montecarlo.simulate(scene, sampling=Sampling(horizon=horizon), scheme=scheme, **settings)


def _reach(run: montecarlo.Ensemble) -> float:
    """Largest distance of an impact from the middle of its gap."""
    assert run.raw is not None
    return float(np.nan_to_num(np.abs(run.raw[:, :, [2, 4]])).max())


@extreme(allowed=Z)
def exit_times() -> Iterator[float]:
    """Mean exit times of a randomly accelerated particle from the middle and from a tenth of a
    gap."""
    for n, (sigma, half) in enumerate(EXITS):
        for share in (0.1, 0.5):
            truth = noise.mean_exit_time(2.0 * half * share, 2.0 * half, sigma)
            scene = noise.particle(share, half, sigma)
            for scheme, step in (("euler-maruyama-located", 1e-3), ("exact-flight", 0.3)):
                dt = min(step * truth, montecarlo.largest_step(scene, scheme)[0])
                chosen = {
                    "paths": 4096,
                    "impacts": 1,
                    "dt": dt,
                    "rng": n,
                    "record": Record(step_bias=False),
                }
                run = _run(scene, 40.0 * truth, scheme, **chosen)
                mean, se = (float(run.columns[name][0]) for name in ("flight", "se_flight"))
                yield (
                    Check("", mean, truth, se, EXIT_BIAS * truth).z
                    if run.unfinished == 0
                    else math.inf
                )


@extreme(allowed=Z)
def collapse_drift() -> Iterator[float]:
    """Drift of ln speed per bounce, below and above the restitution at which a noisy particle
    collapses."""
    for n, epsilon in enumerate((1e-9, 0.1, math.exp(-noise.MEAN), 1.0)):
        drift, se = noise.mean_drift(epsilon, EXTREME_PATHS, 6, n)
        yield abs(drift - math.log(epsilon) - noise.MEAN) / se


@extreme(allowed=1e-9)
def stay_between_walls() -> Iterator[float]:
    """Paths that collapse onto a wall, or stick to it, stay between the walls and reach the end."""
    for epsilon, sigma, scheme in product((0.0, 0.05, 0.163, 1.0), (1e-3, 1.0, 1e3), SCHEMES):
        scene = Scene.from_gears(replace(DAT21, epsilon=epsilon), sigma=sigma)
        dt = min(5e-3, 0.1 / (2.0 + sigma))
        fixed = dt * np.array([64.0, 128.0, 256.0])
        run = _run(
            scene,
            256.0 * dt,
            scheme,
            paths=32,
            impacts=4,
            dt=dt,
            record=Record(times=fixed, raw=True),
        )
        means = run.at_times()[["x1", "x2"]].abs().to_numpy()
        over = max(float(means.max()), _reach(run)) - 0.5
        beyond = SCHEMES[scheme].detects_at_end
        unit = 0.5 + (10.0 + 5.0 * sigma * math.sqrt(dt)) * dt * 1e9 * beyond
        yield max(over, 0.0) / unit if len(means) == len(fixed) else math.inf


@extreme(allowed=0.02)
def sticking_paths() -> Iterator[float]:
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
                record = Record(times=[2.0 * closed])
                run = _run(
                    scene, 2.5 * closed, scheme, paths=1, impacts=10_000, dt=dt, record=record
                )
                row = run.at_times().iloc[0]
                # largest speed of the plain scheme, which detects a wall at the end of a step
                bounce = 2.0 * drag * dt
                yield farthest(row["x1"], gap, gap + drag * dt * dt)
                yield max(abs(float(row["y1"])) / bounce - 1.0, 0.0)
            orbit = closure.follow(scene, 2000)
            ends = "sticks" in orbit.stopped or bool((np.diff(orbit.tau) > 0.0).all())
            yield 0.0 if ends else math.inf
            for name in ("corrected", "saltation"):
                m = closure.mean_map(scene.with_sigma(1e-3 * gap), impacts=200, closure=name)
                yield 0.0 if m.stopped or m.trace.found == 200 else math.inf


@extreme(allowed=0.0)
def large_tolerances() -> Iterator[float]:
    """Tolerances as large as the gap: a fixed one equals a wider gap; with random ones no path is
    beyond its walls."""
    for gap in (1e-8, 0.5, 1e4):
        plain = Scene.from_gears(DAT21, sigma=0.1).scaled(2.0 * gap)
        most = gap * (1.0 - 2.0**-40)
        fixed = replace(plain, tolerance=Tolerance(most, most, distribution="fixed"))
        start = replace(plain.start, x1=gap + most, x2=gap + most)
        wide = replace(plain, gap1=gap + most, gap2=gap + most, start=start)
        chosen: dict[str, Any] = {"paths": 32, "impacts": 3, "scheme": "exact-flight", "rng": 1}
        runs: list[Any] = [
            partial(closure.mean_map, impacts=3, closure=c) for c in CLOSURES if c != "branching"
        ]
        runs += [
            partial(montecarlo.simulate, sampling=Sampling(control=c), **chosen)
            for c in (False, True)
        ]
        for compute in runs:
            a, b = (compute(s).section.select_dtypes("number") for s in (fixed, wide))
            yield farthest(a, b, gap)
        for distribution, draw in product(("uniform", "normal"), ("path", "contact")):
            tolerance = Tolerance(most, most, distribution=distribution, draw=draw)
            loose = replace(plain, tolerance=tolerance, start=Start(0.0, 0.0, gap))
            run = _run(
                loose, 20.0, "exact-flight", paths=64, impacts=4, rng=2, record=Record(raw=True)
            )
            yield max(_reach(run) / (gap + most) - 1.0, 0.0)
