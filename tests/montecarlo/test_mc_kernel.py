"""The compiled kernel against the plain-Python oracle, on the kernel's own random numbers, path by path."""

import numpy as np
import pytest
from mc_checks import dat21
from naive import FAULTS, LOCATED_FAULTS, Path

from montecarlo import largest_step, simulate
from montecarlo.block import Plan, sample
from montecarlo.noise import streams
from scene import Scene, Start, Tolerance

CHUNK = 64  # steps after which the kernel hands the lanes of finished paths on
IMPACTS = 12
SCHEMES = {"euler-maruyama": False, "euler-maruyama-located": True}

# tiny gaps, a light wheel thrown about by a heavy one, the longest step: several impacts in a step, at both meshes
TIGHT = Scene(
    alpha=0.9, epsilon=0.95, beta1=0.08, beta2=0.5, gamma1=0.057, gamma2=0.2, mu=0.9, gap1=0.05, gap2=0.05, sigma=1.0,
    start=Start(0.3, 0.05, 2.0, 0.0, -2.0, mesh=1),
)  # fmt: skip
# strong unequal damping, so that both stages feel the noise and each other
ROUGH = Scene(
    alpha=1.5, epsilon=0.8, beta1=0.1, beta2=1.5, gamma1=0.2, gamma2=0.5, mu=0.4, gap1=0.5, gap2=0.3, sigma=0.8,
    start=Start(0.2, 0.5, 2.0, 0.3, 2.0, mesh=1),
)  # fmt: skip
CASES = {
    "DAT21": (dat21(0.5), 5e-3),
    "rough": (ROUGH, 5e-3),
    "tight": (TIGHT, 0.99 * largest_step(TIGHT)[0]),
    "single": (dat21(0.7, stages=1), 1e-2),
}


def lanes_of(scene, dt, located, seed, paths, impacts=IMPACTS, fault=None):
    """Oracle paths fed as the kernel feeds its lanes: in lane order, a finished path's lane going to the last one."""
    stream = streams(np.random.SeedSequence(seed), 0)
    every = [Path.start(scene, dt, located, fault) for _ in range(paths)]
    lanes, n = list(every), 0
    while lanes and n < 100_000:
        for _ in range(CHUNK):
            normals = [stream.steps.standard_normal() if scene.sigma > 0.0 else 0.0 for _ in lanes]
            for path, z in zip(lanes, normals, strict=True):
                path.step(z, stream.bridges[0].standard_normal)
            n += 1
        p = 0
        while p < len(lanes):
            if len(lanes[p].impacts) >= impacts:
                last = lanes.pop()
                if p < len(lanes):
                    lanes[p] = last
            else:
                p += 1
        if fault is not None and n > 20_000:
            break
    return every


def furthest(scene, dt, scheme, seeds, paths=1, fault=None, impacts=IMPACTS):
    """Largest difference of an impact's time and state between kernel and oracle over what rounding allows.

    Rounding grows at each impact (measured: to 4e-15 at the first, ten-fold at each in the worst of 200 paths with
    located impacts); infinite if a mesh or side differs.
    """
    allowed = 1e-13 * 8.0 ** np.arange(1, impacts + 1)
    worst = 0.0
    for seed in seeds:
        run = simulate(scene, paths=paths, impacts=impacts, dt=dt, scheme=scheme, rng=seed, keep_paths=True)
        oracle = lanes_of(scene, dt, SCHEMES[scheme], seed, paths, impacts, fault)
        for p, path in enumerate(oracle):
            found = np.array(path.impacts[:impacts])
            kept = run.raw[p][:, [0, 2, 3, 4, 5, 6]]
            if found.shape != kept.shape or (found[:, 5] != kept[:, 5]).any():
                return np.inf
            columns = slice(0, 5 if scene.stages == 2 else 3)
            worst = max(worst, (np.abs(found - kept)[:, columns].max(axis=1) / allowed).max())
    return worst


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("case", CASES)
def test_kernel_follows_oracle(case, scheme):
    scene, dt = CASES[case]
    assert furthest(scene, dt, scheme, range(50)) < 1.0


@pytest.mark.parametrize("scheme", SCHEMES)
def test_kernel_follows_oracle_as_lanes_change_hands(scheme):
    assert furthest(dat21(0.5), 5e-3, scheme, range(2), paths=21) < 1.0


def test_tight_case_has_several_impacts_in_one_step_at_both_meshes():
    scene, dt = CASES["tight"]
    steps = [codes for seed in range(12) for path in lanes_of(scene, dt, True, seed, 1) for codes in path.per_step]
    assert max(len(codes) for codes in steps) >= 3
    assert any({1, 2} <= {abs(code) for code in codes} for codes in steps)


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_planted_fault_is_seen(scheme, fault):
    scene, dt = CASES["rough"]
    assert furthest(scene, dt, scheme, range(2), fault=fault) > 1e6


@pytest.mark.parametrize("fault", LOCATED_FAULTS)
def test_planted_fault_of_location_is_seen(fault):
    scene, dt = CASES["tight"]
    assert furthest(scene, dt, "euler-maruyama-located", range(4), fault=fault) > 1e6


def coarse_levels_differ(scheme, root=0.5, shift=0):
    """Largest difference at 2^l dt between the levels of a run with step bias and the oracle on summed increments."""
    scene, dt, impacts, worst = dat21(0.3), 5e-3, 4, 0.0
    for seed in range(4):
        entropy = np.random.SeedSequence(seed)
        plan = Plan(scene, 1, impacts, dt, SCHEMES[scheme], entropy, 4000, np.empty(0, np.int64), {}, 3)
        rows = sample(plan, 0).rows
        stream = streams(entropy, 0)
        z = stream.steps.standard_normal(4096)
        for level in range(3):
            m = 2**level
            path = Path.start(scene, m * dt, SCHEMES[scheme])
            for total in z.reshape(-1, m).sum(axis=1) / m**root:
                if len(path.impacts) >= impacts:
                    break
                path.step(total, stream.bridges[(level + shift) % 3].standard_normal)
            worst = max(worst, np.abs(np.array(path.impacts[:impacts]) - rows[level, 0]).max())
    return worst


@pytest.mark.parametrize("scheme", SCHEMES)
def test_coarse_levels_run_on_sums_of_the_same_increments(scheme):
    assert coarse_levels_differ(scheme) < 1e-9
    assert coarse_levels_differ(scheme, root=1.0) > 1e-4  # planted: a sum of m increments divided by m


def test_each_level_splits_increments_with_bridges_of_its_own():
    assert coarse_levels_differ("euler-maruyama-located", shift=1) > 1e-4


def tolerant_differ(scheme, draw, fault=None):
    """Largest difference between kernel and oracle where walls are drawn; the oracle is told the draws."""
    c, gap, impacts, worst = (0.1, 0.2), 0.5, 8, 0.0
    scene = dat21(0.5, tolerance=Tolerance(*c, draw=draw))
    for seed in range(20):
        run = simulate(scene, paths=1, impacts=impacts, dt=5e-3, scheme=scheme, rng=seed, keep_paths=True)
        stream = streams(np.random.SeedSequence(seed), 0)
        path = Path.start(scene, 5e-3, SCHEMES[scheme], fault)
        if draw == "path":
            u = stream.tolerance.uniform(-1.0, 1.0, 2).repeat(2)
        else:
            u = stream.tolerance.uniform(-1.0, 1.0, 4)
            v = stream.tolerance.uniform(-1.0, 1.0, (2, impacts + 1))
            path.fresh = {m: list(gap + c[m - 1] * v[m - 1]) for m in (1, 2)}
        path.walls = {f: gap + c[abs(f) - 1] * d for f, d in zip((1, -1, 2, -2), u, strict=True)}
        path.state[0], path.state[2] = path.walls[1], path.walls[2]
        while len(path.impacts) < impacts:
            path.step(stream.steps.standard_normal(), stream.bridges[0].standard_normal)
        worst = max(worst, np.abs(np.array(path.impacts[:impacts]) - run.raw[0][:, [0, 2, 3, 4, 5, 6]]).max())
    return worst


@pytest.mark.parametrize("draw", ["path", "contact"])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_kernel_follows_oracle_between_drawn_walls(scheme, draw):
    assert tolerant_differ(scheme, draw) < 1e-7  # eight impacts of rounding


@pytest.mark.parametrize("scheme", SCHEMES)
def test_planted_redraw_of_the_flank_struck_is_seen(scheme):
    assert tolerant_differ(scheme, "contact", fault="redraws the flank struck") > 1e-4


def test_state_at_a_clock_time_is_the_state_after_that_many_steps():
    scene, dt, at = dat21(0.5), 5e-3, np.array([4, 100, 300])
    entropy = np.random.SeedSequence(3)
    raw = sample(Plan(scene, 1, 2, dt, True, entropy, 1000, at, {}, 1), 0)
    stream = streams(entropy, 0)
    path, states = Path.start(scene, dt, True), {}
    for n in range(at[-1] + 1):
        states[n] = list(path.state)
        path.step(stream.steps.standard_normal(), stream.bridges[0].standard_normal)
    assert np.abs(raw.clock[0, 0] - np.array([states[n] for n in at])).max() < 1e-10
