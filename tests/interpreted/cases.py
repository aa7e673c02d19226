"""Small runs through all that is compiled: few paths, few impacts, every kind of scene.

As a program it prints the numbers of each case, or of those named, as hexadecimal floats; with
NUMBA_DISABLE_JIT=1 the interpreter makes them, from the same source.
"""

import json
import math
import sys
from dataclasses import replace
from unittest import mock

import numpy as np
from scenes import OSCILLATOR, dat21, tree
from settings import USEFUL_STEP

from rattle import Order, Record, Sampling, Scene, Start, Tolerance, follow, mean_map, simulate
from rattle.closure.branching.advance import Level
from rattle.montecarlo import SCHEMES
from rattle.montecarlo.bench import _normals, _scalar_normals, _skill_loop, _steps
from rattle.montecarlo.branches.search import search_of
from rattle.montecarlo.coupling.paths import LongPath, after_impact, growths
from rattle.montecarlo.kernel.block import run
from rattle.montecarlo.kernel.mixture import mixture_of
from rattle.montecarlo.long_run.sums import new_sums, no_scales, scales_of_pilot
from rattle.montecarlo.long_run.walk import Walk
from rattle.montecarlo.noise.philox import key_of
from rattle.montecarlo.schemes.euler import step_forcing
from rattle.montecarlo.settings import plan_of
from rattle.scene.long_orbit import LongOrbit, velocities

DAT21_PAIR = dat21(0.3)
LONE = dat21(0.3, stages=1)
UNDAMPED = Scene(
    alpha=0.5, epsilon=1.0, beta1=0.0, gamma1=0.0, beta2=0.0, gamma2=0.0, mu=0.3, sigma=0.1
)
STICKING_PAIR = Scene(
    alpha=0.0,
    epsilon=0.4,
    beta1=0.0,
    gamma1=1.0,
    gamma2=2.0,
    mu=0.5,
    start=Start(0.0, 0.49, 0.2, -0.49, -0.2),
)
"""Both stages are accelerated into their flanks, where impacts accumulate."""
NOISY_STICKING = replace(STICKING_PAIR, sigma=1e-3, noise={1: 1.0, 2: 1.0})
"""The same, while each wheel has a noise of its own."""
DRIVEN_STAGE = Scene(
    alpha=3.0,
    epsilon=0.1,
    beta1=0.1,
    gamma1=2.0,
    stages=1,
    sigma=2.0,
    start=Start(0.3, 0.5, 2.0, mesh=1),
)
BODY = OSCILLATOR.with_sigma(0.3)
MEMORY = replace(DAT21_PAIR, drive=(Order(1), Order(3, 0.2, 0.4)), correlation_time=0.5)
FAR = replace(DAT21_PAIR, gap1=1e6, gap2=1e6, start=Start(0.0, 0.0, 1.0, 0.0, 1.0))
ALL_KINDS = {
    "tree": tree((0, 1, 1, 2), 7, alpha=0.6, gamma=1.0, epsilon=(0.1, 0.4)),
    "two stages": DAT21_PAIR,
    "without noise": replace(DAT21_PAIR, sigma=0.0),
    "undamped": UNDAMPED,
    "sticking": STICKING_PAIR,
    "driven": DRIVEN_STAGE,
    "body": BODY,
    "shaken": replace(DAT21_PAIR, noise={"drive": 1.0, 1: 0.5, 2: 2.0}),
    "in flight": replace(DAT21_PAIR, start=Start(0.2, 0.1, 1.0, 0.2, -1.0)),
}


def orbits(scene):
    """The orbit, one after another, and the growth of its neighbours."""
    orbit = follow(scene, 12)
    yield from (orbit.tau, orbit.mesh, orbit.side, orbit.before, orbit.after)
    for tangent in (True, False):
        run = LongOrbit(scene, start=1)
        s = run.stretch(40, tangent)
        yield from (s.flight, s.phase, s.code, s.before, s.growth, run.frame)
    if len(s.flight) > 2:
        yield velocities(scene, s, 0.1)


def predicted(scene, closure, impacts, order=4):
    """All numbers of a closure, at its impacts and between them."""
    m = mean_map(scene, impacts=impacts, closure=closure, order=order)
    t = m.trace
    yield m.section.drop(columns="realizable").to_numpy(float)
    yield from (a for a in (t.mean, t.sd, t.skew, t.raw, t.agreement, t.discarded) if a is not None)
    if t.found > 1:
        yield m.at_times(
            np.linspace(t.tau[0], t.tau[t.found] if t.until is None else t.until, 7)[1:-1]
        ).to_numpy(float)
        if closure != "branching" and t.raw[1, 0, 2, 0] > 0.0 and t.raw[1, 0, 0, 2] > 0.0:
            yield m.density(1, "y1", np.linspace(-3.0, 3.0, 5))


def in_few_components(scene):
    """The branching closure, its mixture kept small."""
    with mock.patch.multiple(
        "rattle.closure.branching", RESOLUTIONS=(Level(3, 6, 1e-4, 1e-6), Level(4, 8, 1e-4, 1e-6))
    ):
        yield from predicted(scene, "branching", 2)


def simulated(scene, scheme, paths=3, impacts=3, **settings):
    """Every impact of a few paths, their moments, and what stands beside them."""
    recorded = {name: settings.pop(name) for name in ("times", "step_bias") if name in settings}
    record = Record(raw=True, energy=True, **{"step_bias": False} | recorded)
    run = simulate(
        scene, paths=paths, impacts=impacts, scheme=scheme, rng=5, record=record, **settings
    )
    yield run.raw
    yield run.section.to_numpy(float)
    if recorded.get("times"):
        yield run.at_times().to_numpy(float)
    if recorded.get("step_bias"):
        yield run.step_bias.select_dtypes("number").to_numpy(float)


def kernel_alone():
    """Every impact of a few paths and their sums, without the search for rare branches."""
    record = Record(raw=True)
    plan = plan_of(DRIVEN_STAGE, 3, 3, 0.03, "exact-flight", 5, record=record)
    result, rows = run(plan, 0)
    sums = result.sums["section"]
    yield from (rows, sums.mean, sums.sums)


def rare_branches():
    """The design point of a branch at the first impact, and a few paths drawn near it."""
    scene = dat21(0.1)
    shift = search_of(scene, 1, math.pi / 96).until(1.0).within(24)[0].shift
    plan = plan_of(scene, paths=40, impacts=2, dt=math.pi / 96, scheme="exact-flight", rng=5)
    with mock.patch("rattle.montecarlo.kernel.block.BLOCK", 40):
        mixture = mixture_of([shift], [0.3], np.zeros((2, 6)), 40)
        result, _ = run(plan._replace(mixture=mixture), 0)
    yield from (shift, result.sums["weighted"].sums, result.sums["weighted"].products, result.codes)


def on_shared_noise(scene):
    """A long path with the growth of its neighbours, and pairs of paths with the same noise."""
    path = LongPath(scene, seed=2)
    for tangent in (True, False):
        s, velocity = path.stretch(200, tangent, velocities=tangent)
        yield from (s.flight, s.phase, s.code, s.before, s.growth, velocity, path.frame)
    if scene.sigma > 0.0:
        yield from after_impact(scene, np.array([1e-5, 1e-3]), 3, seed=4, settle=10)
    yield from growths(scene, 1e-3, 4, seed=3, patience=3.0, settle=5)


def long_run_sums(scene):
    """All sums of two paths of a long run over a period, with the scales of the period before."""
    walk = Walk(scene, np.random.SeedSequence(3), 0, 2)
    seen = []
    walk.follow(new_sums(2, 1, no_scales(scene.stages, 0.1), False), seen=seen)
    kept = new_sums(2, 1, scales_of_pilot(scene.stages, np.concatenate(seen), 0.1))
    walk.follow(kept)
    yield from (kept.main, kept.power, kept.products, kept.histogram, kept.section)


def merged():
    """Sums of nine paths, merged with themselves."""
    record = Record(energy=True)
    run = simulate(
        DAT21_PAIR, paths=9, impacts=1, dt=USEFUL_STEP["exact-flight"], rng=5, record=record
    )
    sums = run.result.sums["section"]
    yield from (sums.n, sums.mean, sums.sums, sums.merge(sums).sums)


def bench():
    """Loops of the bench."""
    z = np.zeros((4, 8))
    paths = np.arange(8, dtype=np.uint64)
    _normals(key_of(np.random.SeedSequence(1)), paths, z, 2)
    yield z.copy()
    state = np.ones((4, 8))
    forcing = np.zeros((2, 2))
    step_forcing(DAT21_PAIR.constants, 0.1, 0.01, forcing)
    _steps(DAT21_PAIR.constants, forcing, state, np.zeros((2, 8)), z[0], np.zeros(8, np.bool_), 2)
    yield state
    rng = np.random.Generator(np.random.SFC64(1))
    yield [
        _scalar_normals(rng, 20),
        _skill_loop(DAT21_PAIR.constants, rng, 3, np.ones((20, 2, 2)), 0.1),
    ]


UNIFORM_TOLERANCE = replace(LONE, tolerance=Tolerance(0.04, 0.0))
NORMAL_TOLERANCE = replace(
    DAT21_PAIR, tolerance=Tolerance(0.04, 0.02, distribution="normal", draw="contact")
)
WHITE_ORDERS = replace(MEMORY, correlation_time=0.0)
SAMPLED = {
    "exact-flight": ("without noise", "sticking", "driven", "body", "shaken"),
    "euler-maruyama-located": ("in flight", "body", "shaken"),
    "euler-maruyama": ("two stages",),
}
"""Scenes by the scheme that samples them."""

CASES = {
    "bench": bench,
    "sums": merged,
    "rare branches": rare_branches,
    "exact-flight, kernel alone": kernel_alone,
    "orbit, far": lambda: orbits(FAR),
    "published, undamped": lambda: predicted(UNDAMPED, "published", 6),
    "published, driven": lambda: predicted(DRIVEN_STAGE, "published", 6),
    "corrected, one stage": lambda: predicted(LONE, "corrected", 6),
    "corrected, driven": lambda: predicted(DRIVEN_STAGE, "corrected", 6),
    "corrected, sticking": lambda: predicted(STICKING_PAIR, "corrected", 6),
    "saltation, tolerances": lambda: predicted(
        replace(DAT21_PAIR, tolerance=Tolerance(0.01, 0.02)), "saltation", 6
    ),
    "saltation, order 2": lambda: predicted(DAT21_PAIR, "saltation", 3, 2),
    "saltation, orders": lambda: predicted(WHITE_ORDERS, "saltation", 4),
    "saltation, orders and memory": lambda: predicted(MEMORY, "saltation", 4),
    "saltation, body": lambda: predicted(BODY, "saltation", 4),
    "branching, one stage": lambda: in_few_components(LONE),
    "branching, flanks drawn anew": lambda: in_few_components(
        replace(DAT21_PAIR, tolerance=Tolerance(0.04, 0.02, draw="contact"))
    ),
    "exact-flight, uniform walls": lambda: simulated(
        UNIFORM_TOLERANCE, "exact-flight", dt=USEFUL_STEP["exact-flight"]
    ),
    "exact-flight, normal walls": lambda: simulated(
        NORMAL_TOLERANCE, "exact-flight", dt=USEFUL_STEP["exact-flight"]
    ),
    "exact-flight, control": lambda: simulated(
        replace(DAT21_PAIR, sigma=0.02), "exact-flight", sampling=Sampling(control=True)
    ),
    "euler-maruyama, two-point": lambda: simulated(
        DAT21_PAIR, "euler-maruyama", dt=5e-3, sampling=Sampling(increments="two-point")
    ),
    "exact-flight, shaken where pressed": lambda: simulated(
        NOISY_STICKING,
        "exact-flight",
        1,
        60,
        dt=USEFUL_STEP["exact-flight"],
        sampling=Sampling(horizon=6.0),
    ),
    "long run, two stages": lambda: long_run_sums(DAT21_PAIR),
    "long run, one stage": lambda: long_run_sums(LONE),
    "long run, body": lambda: long_run_sums(BODY),
    "long path, one stage": lambda: on_shared_noise(LONE),
    "long path, without noise": lambda: on_shared_noise(ALL_KINDS["without noise"]),
}
"""The fewest that reach every line that all scenes with all closures and schemes reach."""
CASES |= {
    f"orbit, {name}": lambda name=name: orbits(ALL_KINDS[name])
    for name in ("driven", "sticking", "undamped", "in flight", "tree", "body")
}


def sampled(scheme, name):
    """A few paths, their states at fixed times and the bias of the step."""
    biased = SCHEMES[scheme].has_step_bias
    dt = USEFUL_STEP[scheme] * (2.0 if biased else 1.0)
    settings = {"times": [0.3 + 16 * dt, 0.3 + 64 * dt], "step_bias": biased}
    return simulated(ALL_KINDS[name], scheme, paths=2, impacts=2, dt=dt, **settings)


for scheme, names in SAMPLED.items():
    CASES |= {f"{scheme}, {name}": lambda k=scheme, n=name: sampled(k, n) for name in names}
for scheme in ("exact-flight", "euler-maruyama-located"):
    CASES[f"{scheme}, sticking paths"] = lambda k=scheme: simulated(
        STICKING_PAIR, k, 1, 200, dt=USEFUL_STEP[k], sampling=Sampling(horizon=20.0)
    )
    CASES[f"{scheme}, orders and memory"] = lambda k=scheme: simulated(
        MEMORY, k, dt=0.5 * USEFUL_STEP[k]
    )


def parts(case):
    """The numbers of a case."""
    return [np.asarray(part, dtype=float).ravel().tolist() for part in CASES[case]()]


if __name__ == "__main__":
    json.dump(
        {case: [[x.hex() for x in part] for part in parts(case)] for case in sys.argv[1:] or CASES},
        sys.stdout,
    )
