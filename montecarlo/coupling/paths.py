"""Paths on a shared Brownian tree: one over as many impacts as wanted, and two of them on the same
noise.

The **long path** is followed a stretch at a time, with the growth of a frame under the
**linearisation of the drift**: the exact Jacobian of the flight, and the saltation matrix with the
drift's rates at the path's own impacts.  The distance of two noisy paths is not proportional to
their initial one, however small (docs/model.md section 8).  Of **two paths**: how far apart an
impact leaves them, and how fast they diverge, the noise resolved to times of 1e-9.
"""

import math

import numpy as np

from rattle.montecarlo.coupling.dyadic import DEEPEST, Tree, new_hits, tree_of, walk_step
from rattle.montecarlo.noise.philox import STEP, Word, normals
from rattle.montecarlo.schemes.step_state import MOST_IN_A_STEP
from rattle.scene import Constants, Floats, Scene
from rattle.scene.compiled import internal, jit, little_code
from rattle.scene.flight import jacobian, noise_rate
from rattle.scene.linear_algebra import put_row
from rattle.scene.orbit import first_state
from rattle.scene.tangent import Stretch, grow
from rattle.scene.wheel import nearest_wall

DEPTH = 12  # of the tree: leaves are 1.2e-5 long; noise changes a velocity by 3.5e-3 sigma in one
# shares of a step between which an impact is used: the partner's is in the same step
EARLIEST = 0.2
LATEST_SHARE = 0.6
PATH_NUMBER = Word(0)  # whose random numbers both paths share
LEAST_DISTANCE = 1e-16  # least distance of two paths, for logarithms


@jit
def _stretch(
    tree: Tree,
    path: Word,
    step: int,
    most: int,
    at: Floats,
    s: Stretch,
    velocity: Floats,
) -> tuple[int, int, int]:
    """Fill the arrays from ``at = (x1, y1, ..., time since last impact)`` on; returns impacts,
    steps, sticking."""
    little_code()
    c = tree.c
    w = tree.clock
    hits = new_hits(tree.c, MOST_IN_A_STEP)
    states = at.size - 1
    state = at[:states]
    n = taken = sticking = 0
    z0 = z1 = z2 = z3 = 0.0
    while taken < most and n + len(hits) <= s.flight.size:
        if len(velocity) > 0:
            for i in range(c.wheels.size):
                velocity[taken, i] = state[2 * i + 1]
        if c.sigma > 0.0:
            if taken == 0 or step % 2 == 0:
                z0, z1, z2, z3 = normals(tree.key, path, Word(step // 2), Word(STEP))
            z = (z0, z1) if step % 2 == 0 else (z2, z3)
        else:
            z = (0.0, 0.0)
        impacts, closed = walk_step(tree, path, step, z, state, hits)
        sticking += closed
        last = 0.0
        for i in range(impacts):
            flight = at[states] + hits[i, 0] - last
            code = int(hits[i, 1])
            tau = (step % len(w.forcing)) * w.h + hits[i, 0]
            s.flight[n] = flight
            s.phase[n] = tau
            s.code[n] = code
            put_row(s.before[n], hits[i, 2:])
            at[states] = 0.0
            last = hits[i, 0]
            n += 1
        at[states] += w.h - last
        step += 1
        taken += 1
    return n, taken, sticking


class LongPath:
    """One path of a scene, to be followed a stretch at a time.

    `step`: time between the velocities that `stretch` returns. `steps`: number of the next step,
    counted from time 0 (modulo the period at the start). `sticking_steps`: steps to whose end a
    mesh stayed closed.
    """

    def __init__(self, scene: Scene, seed: int, path: int = 0, depth: int = DEPTH) -> None:
        self.tree = tree_of(scene, seed, depth)
        self.path = Word(path)
        self.sticking_steps = 0
        self.step = self.tree.clock.h
        self.steps = round(scene.phase % (2.0 * np.pi) / self.step)
        self.at = np.array([*first_state(scene), 0.0])
        self.frame = np.eye(2 * scene.stages)

    def stretch(
        self, steps: int, tangent: bool = True, velocities: bool = True
    ) -> tuple[Stretch, Floats]:
        """The impacts of the next steps.

        A path that has more impacts than there is space for (one in two steps) ends its stretch
        early.

        Shapes: `velocity` (steps taken, wheels).
        """
        wheels = self.tree.c.wheels.size
        s = Stretch.empty(steps // 2 + MOST_IN_A_STEP * wheels, wheels)
        velocity = np.empty((steps if velocities else 0, wheels))
        n, taken, sticking = _stretch(self.tree, self.path, self.steps, steps, self.at, s, velocity)
        s = s.first(n)
        if tangent:
            grow(self.tree.c, self.frame, s)
        self.steps += taken
        self.sticking_steps += sticking
        return s, velocity[:taken]


@internal
def _two_normals(tree: Tree, step: int) -> tuple[float, float]:
    if tree.c.sigma == 0.0:
        return 0.0, 0.0
    z0, z1, z2, z3 = normals(tree.key, PATH_NUMBER, Word(step // 2), Word(STEP))
    return (z0, z1) if step % 2 == 0 else (z2, z3)


@jit
def _after_impact(
    tree: Tree,
    steps: int,
    settle: int,
    state: Floats,
    least: float,
    deltas: Floats,
    apart: Floats,
    place: Floats,
) -> tuple[int, int]:
    hits = new_hits(tree.c, MOST_IN_A_STEP)
    other = new_hits(tree.c, MOST_IN_A_STEP)
    c = tree.c
    w = tree.clock
    begin = state.copy()
    partner = state.copy()
    n = missed = 0
    for k in range(steps):
        put_row(begin, state)
        z = _two_normals(tree, k)
        impacts, _ = walk_step(tree, PATH_NUMBER, k, z, state, hits)
        if k < settle or impacts != 1 or abs(hits[0, 1]) != 1:
            continue
        share = hits[0, 0] / w.h
        speed = abs(hits[0, 3])
        if not (EARLIEST < share < LATEST_SHARE and speed > least):
            continue
        whole = True
        for i in range(deltas.size):
            put_row(partner, begin)
            partner[0] -= hits[0, 1] * deltas[i]
            met, _ = walk_step(tree, PATH_NUMBER, k, z, partner, other)
            whole = met == 1 and other[0, 1] == hits[0, 1]
            if not whole:
                break
            # after both impacts the difference obeys the noise-free linear flight: carry it back to
            # the later impact
            back = jacobian(c, other[0, 0] - w.h)
            apart[n, i] = 0.0
            for j in range(state.size):
                apart[n, i] += back[1, j] * (state[j] - partner[j])
        if not whole:
            missed += 1
            continue
        tau = (k % len(w.forcing)) * w.h + hits[0, 0]
        place[n, 0] = tau
        place[n, 1] = speed
        place[n, 2] = noise_rate(c, tau, 0)
        n += 1
        if n == len(apart):
            break
    return n, missed


def after_impact(
    scene: Scene,
    deltas: Floats,
    impacts: int,
    seed: int,
    *,
    least: float = 0.25,
    settle: int = 5000,
) -> tuple[Floats, Floats, int]:
    """Difference in ``y1`` after an impact at mesh 1, of two paths that reach the wall some
    distance apart.

    Shapes: `apart` (impacts, deltas); `place` (impacts, 3).
    """
    tree = tree_of(scene, seed, DEEPEST)
    apart = np.empty((impacts, deltas.size))
    place = np.empty((impacts, 3))
    steps = settle + 2000 * impacts
    n, missed = _after_impact(
        tree, steps, settle, np.array(first_state(scene)), least, deltas, apart, place
    )
    return apart[:n], place[:n], missed


@internal
def _distance(a: Floats, b: Floats) -> float:
    """Distance of two states."""
    square = 0.0
    for i in range(a.size):
        square += (a[i] - b[i]) ** 2
    return math.sqrt(square)


@internal
def _place(c: Constants, a: Floats, b: Floats, delta: float) -> bool:
    """Put b at the distance `delta` from a, in its present direction or opposite to it; False if
    walls forbid both."""
    d = _distance(a, b)
    for sign in (1.0, -1.0):
        inside = True
        for i in range(c.wheels.size):
            x = a[2 * i] + sign * (b[2 * i] - a[2 * i]) * delta / d
            inside = inside and nearest_wall(c, i, x)[1] > 0.0
        if inside:
            for i in range(a.size):
                b[i] = a[i] + sign * (b[i] - a[i]) * delta / d
            return True
    return False


@jit
def _growths(
    tree: Tree,
    settle: int,
    wait: int,
    steps: int,
    a: Floats,
    delta: float,
    ratio: float,
    growths: Floats,
) -> int:
    c = tree.c
    hits = new_hits(tree.c, MOST_IN_A_STEP)
    b = a.copy()
    n = waited = 0
    last = 0.0
    together = True
    for k in range(steps):
        z = _two_normals(tree, k)
        walk_step(tree, PATH_NUMBER, k, z, a, hits)
        if k < settle:
            continue
        if together:  # start anew with a partner beside the path
            for i in range(a.size):
                b[i] = a[i] + delta / math.sqrt(a.size)
            together = not _place(c, a, b, delta)
            waited = 0
            last = delta
            continue
        walk_step(tree, PATH_NUMBER, k, z, b, hits)
        waited += 1
        now = _distance(a, b)
        # the smaller of two: between both paths' impacts distance does not count
        far = min(now, last)
        last = now
        if far >= ratio * delta or waited >= wait:
            growths[0, n] = waited * tree.clock.h
            growths[1, n] = math.log(max(far, LEAST_DISTANCE) / delta)
            n += 1
            if n == growths.shape[1]:
                break
            together = now < 1e-3 * delta or not _place(c, a, b, delta)
            waited = 0
            last = delta
    return n


def growths(
    scene: Scene,
    delta: float,
    events: int,
    seed: int,
    *,
    ratio: float = 2.0,
    patience: float = 200.0,
    settle: int = 5000,
) -> tuple[Floats, Floats]:
    """Time in which two paths on a shared Brownian tree diverge from `delta` to `ratio` times that,
    and the growth.

    The distance is looked at once a step (2 pi / 128 or less); after each growth the partner is put
    back to `delta` in its present direction.  The distance is that of ``(x1, y1, ...)``, the
    smaller one of two successive steps.

    `patience`: Time after which a growth is given up; it is returned as it is then.
    """
    little_code()
    tree = tree_of(scene, seed, DEEPEST)
    wait = max(2, int(patience / tree.clock.h))
    growths = np.empty((2, events))
    n = _growths(
        tree,
        settle,
        wait,
        settle + wait * events,
        np.array(first_state(scene)),
        delta,
        ratio,
        growths,
    )
    return growths[0, :n], growths[1, :n]
