"""Exact flights of a block of paths, some of them conditioned on a rare branch, with the weight of each impact."""

import math

from rattle.montecarlo.kernel.kernel import EXACT, Job, Output, finish_inside, step_lanes
from rattle.montecarlo.kernel.lanes import CHUNK, Lanes, Room, list_marked, of_level
from rattle.montecarlo.noise.brownian import Noise
from rattle.montecarlo.noise.philox import Word, fill_normals
from rattle.montecarlo.rare.mixture import BranchMixture
from rattle.montecarlo.schemes.short_flight import phase_at
from rattle.montecarlo.schemes.step_state import Progress
from rattle.scene.compiled import lean, widest_vectors
from rattle.scene.types import Floats, Ints

FAR = 6.0  # argument from which erfc is 0, and below whose negative it is 2


@lean
def _condition(z: Floats, u: float, rest: float, k: int, part: Ints, ahead: Floats, lanes: int) -> None:
    """Replace a step's normals of the paths of one part by their values given ``u z`` in all; vectorises.

    Given that the steps ahead, this one among them, add `ahead` to ``u z``, a step's normal has mean ``u ahead / rest``
    and variance ``1 - u^2 / rest``.
    """
    widest_vectors()
    pull, spread = u / rest, math.sqrt(max(0.0, 1.0 - u * u / rest))
    for p in range(lanes):
        own = part[p] == k
        x = pull * ahead[p] + spread * z[p] if own else z[p]
        z[p] = x
        ahead[p] -= u * x if own else 0.0


@lean
def _add_along(z: Floats, u: float, done: Floats, lanes: int) -> None:
    """Add a step's normals to ``u z``; vectorises."""
    widest_vectors()
    for p in range(lanes):
        done[p] += u * z[p]


@lean
def _weight(mixture: BranchMixture, n: int, p: int, done: Floats) -> float:
    """Weight of a path after n steps."""
    total = mixture.plain
    last = mixture.rest.shape[1] - 1
    for k in range(mixture.unit.shape[0]):
        rest = mixture.rest[k, min(n, last)]
        scale = 1.0 / math.sqrt(2.0 * rest) if rest > 1e-12 else 1e9
        for t in range(mixture.level.shape[1]):
            short = (mixture.level[k, t] - done[k, p]) * scale
            if short < -FAR:
                total += mixture.rate[k, t]
            elif short < FAR:
                total += mixture.rate[k, t] * 0.5 * math.erfc(short)
    return 1.0 / total


@lean
def _retire(every: Lanes, room: Room, part: Ints, ahead: Floats, done: Floats, impacts: int, live: int) -> int:
    """Move the last path in use to the lane of each finished one; returns the lanes still in use."""
    for p in range(live - 1, -1, -1):
        if every.impacts[0, p] >= impacts:
            live -= 1
            room.path[p], room.path[live] = room.path[live], room.path[p]
            for j in range(4):
                every.state[0, j, p] = every.state[0, j, live]
                every.walls[0, j, p] = every.walls[0, j, live]
            every.last[0, p], every.impacts[0, p] = every.last[0, live], every.impacts[0, live]
            part[p], ahead[p] = part[live], ahead[live]
            for k in range(done.shape[0]):
                done[k, p] = done[k, live]
    return live


@lean
def run_weighted(
    job: Job, mixture: BranchMixture, every: Lanes, room: Room, part: Ints, ahead: Floats, done: Floats, out: Output
) -> tuple[int, int]:
    """Follow a block of paths until each has had its impacts; gives path-steps, and those in which a mesh sticks.

    `out`: Its `controls` take the weight of each impact, given the steps up to its own, shape (paths, impacts, 1).
    Shapes: `part` (lanes,); `ahead` (lanes,); `done` (branches, lanes).
    """
    widest_vectors()
    (_, live, impacts, _), n, z, steps = out.rows.shape, 0, room.z, mixture.unit.shape[1]
    work, sticking = 0, 0
    while n < job.most_steps and live > 0:
        wide = (live + 7) // 8 * 8
        for _ in range(min(CHUNK, job.most_steps - n)):
            if n % 2 == 0:
                fill_normals(job.key, room.path, Word(n // 2), wide, z)
            w, area = z[n % 2 * 2], z[n % 2 * 2 + 1]
            for k in range(mixture.unit.shape[0]):
                if n < steps and mixture.unit[k, n] != 0.0:
                    _condition(w, mixture.unit[k, n], mixture.rest[k, n], k, part, ahead, wide)
            for k in range(mixture.unit.shape[0]):  # once all normals are what they will be
                if n < steps and mixture.unit[k, n] != 0.0:
                    _add_along(w, mixture.unit[k, n], done[k], wide)
            begin = job.tau + n * job.dt
            lanes = of_level(every, 0, w, area)
            step_lanes(EXACT, job, begin, job.dt, lanes, room.marks, wide)
            found = list_marked(room.marks, live, room.groups, room.hits)
            phase = phase_at(job.c.drive, begin)
            for i in range(found):
                p, s = room.hits[i], lanes.before
                noise = Noise(w[p] * math.sqrt(job.dt), area[p] * math.sqrt(job.dt / 12.0))
                at = Progress(0, begin, job.dt, noise, s[0, p], s[1, p], s[2, p], s[3, p])
                row, met = int(room.path[p]) - out.first, lanes.impacts[p]
                sticking += finish_inside(EXACT, job, n, 0, p, at, phase, lanes, room, out, impacts)
                if lanes.impacts[p] > met:
                    weight = _weight(mixture, n + 1, p, done)
                    for k in range(met, min(lanes.impacts[p], impacts)):
                        out.controls[row, k, 0] = weight
            n += 1
            work += live
        live = _retire(every, room, part, ahead, done, impacts, live)
    return work, sticking
