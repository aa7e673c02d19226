"""Small runs through all that is compiled: few paths, few impacts, every kind of scene.

As a program it prints the numbers of each case, or of those named, as hexadecimal floats; with
NUMBA_DISABLE_JIT=1 the interpreter makes them, from the same source.
"""

import json
import math
import sys
from dataclasses import replace
from functools import partial
from unittest import mock

import numpy as np
from scenes import OSCILLATOR, dat21, tree
from settings import EULER, EXACT, LOCATED, USEFUL_STEP

from rattle import Order, Record, Sampling, Scene, Start, Tolerance, follow, mean_map, simulate
from rattle.closure.branching.advance import Level
from rattle.montecarlo import SCHEMES, largest_step
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
DRIVEN_STAGE = Scene(
    alpha=3.0,
    epsilon=0.1,
    beta1=0.1,
    gamma1=2.0,
    stages=1,
    sigma=2.0,
    start=Start(0.3, 0.5, 2.0, mesh=1),
)
MEMORY = replace(DAT21_PAIR, drive=(Order(1), Order(3, 0.2, 0.4)), correlation_time=0.5)
NORMAL_WALLS = Tolerance(0.04, 0.02, distribution="normal", draw="contact")
ALL_KINDS = {
    "tree": tree((0, 1, 1, 2), 7, alpha=0.6, gamma=1.0, epsilon=(0.1, 0.4)),
    "one stage": LONE,
    "two stages": DAT21_PAIR,
    "far": replace(DAT21_PAIR, gap1=1e6, gap2=1e6, start=Start(0.0, 0.0, 1.0, 0.0, 1.0)),
    "without noise": replace(DAT21_PAIR, sigma=0.0),
    "undamped": Scene(alpha=0.5, epsilon=1.0, beta1=0.0, gamma1=0.0, mu=0.3, sigma=0.1),
    "sticking": STICKING_PAIR,
    "sticking and shaken": replace(STICKING_PAIR, sigma=1e-3, noise={1: 1.0, 2: 1.0}),
    "driven": DRIVEN_STAGE,
    "body": OSCILLATOR.with_sigma(0.3),
    "shaken": replace(DAT21_PAIR, noise={"drive": 1.0, 1: 0.5, 2: 2.0}),
    "in flight": replace(DAT21_PAIR, start=Start(0.2, 0.1, 1.0, 0.2, -1.0)),
    "orders": replace(MEMORY, correlation_time=0.0),
    "orders and memory": MEMORY,
    "tolerances": replace(DAT21_PAIR, tolerance=Tolerance(0.01, 0.02)),
    "uniform walls": replace(LONE, tolerance=Tolerance(0.04, 0.0)),
    "uniform walls drawn anew": replace(
        DAT21_PAIR, tolerance=Tolerance(0.04, 0.02, draw="contact")
    ),
    "normal walls": replace(DAT21_PAIR, tolerance=NORMAL_WALLS),
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


def predicted(closure, scene, impacts=4, order=4):
    """All numbers of a closure, at its impacts and between them."""
    m = mean_map(scene, impacts=impacts, closure=closure, order=order)
    t = m.trace
    yield m.section.drop(columns="realizable").to_numpy(float)
    yield from (a for a in (t.mean, t.sd, t.skew, t.raw, t.agreement, t.discarded) if a is not None)
    if t.found > 1:
        end = t.tau[t.found] if t.until is None else t.until
        yield m.at_times(np.linspace(t.tau[0], end, 7)[1:-1]).to_numpy(float)
        if closure != "branching" and t.raw[1, 0, 2, 0] > 0.0 and t.raw[1, 0, 0, 2] > 0.0:
            yield m.density(1, "y1", np.linspace(-3.0, 3.0, 5))


def in_few_components(scene):
    """The branching closure, its mixture kept small."""
    levels = Level(3, 6, 1e-4, 1e-6), Level(4, 8, 1e-4, 1e-6)
    with mock.patch("rattle.closure.branching.RESOLUTIONS", levels):
        yield from predicted("branching", scene, 2)


def simulated(scheme, scene, paths=2, impacts=3, **sampling):
    """Every impact of a few paths, their moments, states at fixed times and the bias of the
    step."""
    biased = SCHEMES[scheme].has_step_bias
    coarsest = 4.0 if biased else 1.0
    longest = largest_step(scene, scheme)[0] / coarsest
    dt = min(2.0 * USEFUL_STEP[scheme] if biased else USEFUL_STEP[scheme], longest)
    times = scene.start.tau + dt * np.array([16.0, 64.0])
    record = Record(raw=True, energy=True, times=times, step_bias=biased)
    settings = {"dt": dt, "scheme": scheme, "rng": 5, "sampling": Sampling(**sampling)}
    run = simulate(scene, paths=paths, impacts=impacts, record=record, **settings)
    yield run.raw
    yield run.section.to_numpy(float)
    yield run.at_times().to_numpy(float)
    if biased:
        yield run.step_bias.select_dtypes("number").to_numpy(float)


def stuck(scheme, scene):
    """A path whose impacts accumulate."""
    return simulated(scheme, scene, 1, 80, horizon=8.0)


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
    run = simulate(DAT21_PAIR, paths=9, impacts=1, dt=USEFUL_STEP[EXACT], rng=5, record=record)
    sums = run.result.sums["section"]
    yield from (sums.n, sums.mean, sums.sums, sums.merge(sums).sums)


def bench():
    """Loops of the bench."""
    z = np.zeros((4, 8))
    _normals(key_of(np.random.SeedSequence(1)), np.arange(8, dtype=np.uint64), z, 2)
    yield z.copy()
    c = DAT21_PAIR.constants
    state = np.ones((4, 8))
    forcing = np.zeros((2, 2))
    step_forcing(c, 0.1, 0.01, forcing)
    _steps(c, forcing, state, np.zeros((2, 8)), z[0], np.zeros(8, np.bool_), 2)
    yield state
    rng = np.random.Generator(np.random.SFC64(1))
    yield [_scalar_normals(rng, 20), _skill_loop(c, rng, 3, np.ones((20, 2, 2)), 0.1)]


OF_SCENES = {
    "orbit": (orbits, "far, driven, sticking, undamped, in flight, tree, body"),
    "published": (partial(predicted, "published"), "undamped, driven"),
    "corrected": (partial(predicted, "corrected"), "one stage, driven, sticking"),
    "saltation": (
        partial(predicted, "saltation"),
        "tolerances, orders, orders and memory, body",
    ),
    "saltation of order 2": (partial(predicted, "saltation", order=2), "two stages"),
    "branching": (in_few_components, "one stage, uniform walls drawn anew"),
    "long run": (long_run_sums, "two stages, one stage, body"),
    "long path": (on_shared_noise, "one stage, without noise"),
    EXACT: (
        partial(simulated, EXACT),
        "without noise, sticking, driven, body, shaken, uniform walls, normal walls,"
        " orders and memory",
    ),
    LOCATED: (partial(simulated, LOCATED), "in flight, body, shaken, orders and memory"),
    EULER: (partial(simulated, EULER), "two stages"),
    f"{EXACT}, stuck": (partial(stuck, EXACT), "sticking, sticking and shaken"),
    f"{LOCATED}, stuck": (partial(stuck, LOCATED), "sticking"),
    f"{EXACT} with a control": (partial(simulated, EXACT, control=True), "two stages"),
    f"{EULER}, two-point": (partial(simulated, EULER, increments="two-point"), "two stages"),
}
"""What makes numbers of a scene, and of which: the fewest that reach every line that all scenes
with all closures and schemes reach."""
CASES = {
    "bench": bench,
    "sums": merged,
    "rare branches": rare_branches,
    f"{EXACT}, kernel alone": kernel_alone,
} | {
    f"{kind}, {name}": partial(numbers, ALL_KINDS[name])
    for kind, (numbers, names) in OF_SCENES.items()
    for name in names.split(", ")
}


def parts(case):
    """The numbers of a case."""
    return [np.asarray(part, dtype=float).ravel().tolist() for part in CASES[case]()]


if __name__ == "__main__":
    json.dump(
        {case: [[x.hex() for x in part] for part in parts(case)] for case in sys.argv[1:] or CASES},
        sys.stdout,
    )
