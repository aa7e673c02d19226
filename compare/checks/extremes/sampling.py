"""Samplers at extreme values: published results of a noisy particle, sticking meshes, tolerances as large as gaps."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from rattle import closure, montecarlo
from rattle.compare.checks.check import Check, extreme, farthest
from rattle.compare.checks.published import returns
from rattle.compare.checks.published.exits import mean_exit_time, particle
from rattle.compare.checks.published.returns import MEAN
from rattle.montecarlo import SCHEMES, Record
from rattle.montecarlo.kernel.kernel import PLAIN
from rattle.montecarlo.settings.sampling import Sampling
from rattle.scene import DAT21, Scene, Start, Tolerance

PATHS = 3_000
Z = 4.5
"""Admissible standard errors in a row; 40 checks of a correct program exceed them with a probability of 3e-4."""

EXITS = ((1e-3, 1e-8), (1e-3, 1e-6), (1.0, 1e-3), (1e4, 1e-8), (1e4, 1e-3), (1e4, 10.0))  # sigma, half gap
EXIT_BIAS = 2e-3  # relative bias of an exit time, by a step of a thousandth of it and by the modulation of the noise


def _run(scene: Scene, horizon: float, scheme: str, **settings: Any) -> montecarlo.Ensemble:
    return montecarlo.simulate(scene, sampling=Sampling(horizon=horizon), scheme=scheme, **settings)


def _reach(run: montecarlo.Ensemble) -> float:
    """Largest distance of an impact from the middle of its gap."""
    assert run.raw is not None
    return float(np.nan_to_num(np.abs(run.raw[:, :, [2, 4]])).max())


@extreme(allowed=Z)
def exit_times() -> Iterator[float]:
    """Mean exit times of a randomly accelerated particle from the middle and from a tenth of a gap."""
    for n, (sigma, half) in enumerate(EXITS):
        for share in (0.1, 0.5):
            truth = mean_exit_time(2.0 * half * share, 2.0 * half, sigma)
            scene = particle(share, half, sigma)
            for scheme, step in (("euler-maruyama-located", 1e-3), ("exact-flight", 0.3)):
                dt = min(step * truth, montecarlo.largest_step(scene, scheme)[0])
                chosen = {"paths": 4096, "impacts": 1, "dt": dt, "rng": n, "record": Record(step_bias=False)}
                run = _run(scene, 40.0 * truth, scheme, **chosen)
                mean, se = (float(run.columns[name][0]) for name in ("flight", "se_flight"))
                yield Check("", mean, truth, se, EXIT_BIAS * truth).z if run.unfinished == 0 else math.inf


@extreme(allowed=Z)
def collapse_drift() -> Iterator[float]:
    """Drift of ln speed per bounce, below and above the restitution at which a noisy particle collapses."""
    for n, epsilon in enumerate((1e-9, 0.1, math.exp(-MEAN), 1.0)):
        drift, se = returns.mean_drift(epsilon, PATHS, 6, n)
        yield abs(drift - math.log(epsilon) - MEAN) / se


@extreme(allowed=1e-9)
def stay_between_walls() -> Iterator[float]:
    """Paths that collapse onto a wall, or stick to it, stay between the walls and reach the end."""
    for epsilon in (0.0, 0.05, 0.163, 1.0):
        for sigma in (1e-3, 1.0, 1e3):
            scene = Scene.from_gears(replace(DAT21, epsilon=epsilon), sigma=sigma)
            for scheme in SCHEMES:
                dt = min(5e-3, 0.1 / (2.0 + sigma))
                fixed = dt * np.array([64.0, 128.0, 256.0])
                record = Record(times=fixed, raw=True)
                run = _run(scene, 256.0 * dt, scheme, paths=32, impacts=4, dt=dt, record=record)
                means = run.at_times()[["x1", "x2"]].abs().to_numpy()
                over = max(float(means.max()), _reach(run)) - 0.5
                plain = SCHEMES[scheme].code == PLAIN  # detects impacts only at the ends of its steps
                unit = 0.5 + (10.0 + 5.0 * sigma * math.sqrt(dt)) * dt * 1e9 * plain
                yield max(over, 0.0) / unit if len(means) == len(fixed) else math.inf


@extreme(allowed=0.02)
def sticking_paths() -> Iterator[float]:
    """Under drag a path completes its chatter at the time of the bouncing ball, and sticks from then on."""
    for gap in (1e-8, 0.5, 1e4):
        for pull in (p for p in (1.0, 1e2, 1e4) if p * gap <= 1e6):  # drag in half gaps per unit of time squared
            drag, epsilon = pull * gap, 0.5
            fall = math.sqrt(4.0 / pull)  # time to fall through the whole gap from zero velocity
            closed = fall * (1.0 + 2.0 * epsilon / (1.0 - epsilon))
            start = Start(0.0, -gap, math.ulp(0.0) + 1e-12 * gap / fall)
            scene = Scene(alpha=0.0, epsilon=epsilon, beta1=0.0, gamma1=drag, gap1=gap, start=start, stages=1)
            for scheme in SCHEMES:
                dt = min(fall / 256.0, 0.05)
                record = Record(times=[2.0 * closed])
                run = _run(scene, 2.5 * closed, scheme, paths=1, impacts=10_000, dt=dt, record=record)
                row = run.at_times().iloc[0]
                bounce = 2.0 * drag * dt  # largest speed of the plain scheme, which detects a wall at the end of a step
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
    """Tolerances as large as the gap: a fixed one equals a wider gap; with random ones no path is beyond its walls."""
    for gap in (1e-8, 0.5, 1e4):
        plain = Scene.from_gears(DAT21, sigma=0.1).scaled(2.0 * gap)
        most = gap * (1.0 - 2.0**-40)
        fixed = replace(plain, tolerance=Tolerance(most, most, distribution="fixed"))
        start = replace(plain.start, x1=gap + most, x2=gap + most)
        wide = replace(plain, gap1=gap + most, gap2=gap + most, start=start)
        chosen: dict[str, Any] = {"paths": 32, "impacts": 3, "scheme": "exact-flight", "rng": 1}
        pairs = [
            [closure.mean_map(s, impacts=3, closure=name).section for s in (fixed, wide)]
            for name in ("published", "corrected", "saltation")
        ]
        for sampling in (Sampling(control=False), Sampling(control=True)):
            pairs.append([montecarlo.simulate(s, sampling=sampling, **chosen).section for s in (fixed, wide)])
        for a, b in pairs:
            yield farthest(a.select_dtypes("number"), b.select_dtypes("number"), gap)
        for distribution in ("uniform", "normal"):
            for draw in ("path", "contact"):
                tolerance = Tolerance(most, most, distribution=distribution, draw=draw)
                loose = replace(plain, tolerance=tolerance, start=Start(0.0, 0.0, gap))
                run = _run(loose, 20.0, "exact-flight", paths=64, impacts=4, rng=2, record=Record(raw=True))
                yield max(_reach(run) / (gap + most) - 1.0, 0.0)
