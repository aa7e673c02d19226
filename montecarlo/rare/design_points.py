"""Design points: the least noise that brings about another event than the orbit's at one impact.

The noise is that of all steps from the start, a standard normal vector.  The first-order reliability method (Hasofer
and Lind 1974) looks for the nearest point of the boundary to the origin: it follows the gradient of a limit function,
here by differences.  The distance is the reliability index, whose normal tail estimates the branch's probability.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.kernel.block import Plan, sample, start_state
from rattle.montecarlo.rare.controlled import Origin, Question, follow_controlled
from rattle.scene.compiled import jit
from rattle.scene.constants import Constants

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FARTHEST = 5.5  # reliability index up to which branches are looked for
SEARCHED = 16  # impacts at which other events are looked for
COARSE = 8  # steps that share their noise in the first search
ROUNDS, FINE_ROUNDS = 12, 4  # of the first search, and of the second, by single steps from where the first ended
DIFFERENCE = 1e-3  # for derivatives, in sds
NEAR = 0.01  # largest limit function at a design point
ALIKE = 0.97  # cosine from which two design points are one
BEYOND = (1.02, 1.1, 1.25)  # multiples of a design point that are tried to get into the branch
PILOT_PATHS = 4096
PILOT = 0x9170  # spawn key of the pilot's random numbers


@dataclass(frozen=True)
class RareBranch:
    """Another event than the orbit's."""

    impact: int  # the impact at which paths leave the orbit's itinerary, from 1 on
    code: int  # ``mesh * side`` that they strike instead
    beta: float  # reliability index: size of the least noise
    probability: float  # ``Phi(-beta)``, its estimate to first order
    # what the branch adds to the kurtosis of the section row that it changes most, by the same estimate
    kurtosis: float
    shift: Floats  # the design point, increments in units of their sd; (steps,)


@dataclass(frozen=True)
class Pilot:
    """What a small plain run tells beforehand."""

    mean: Floats  # of the section quantities; (impacts, 6)
    sd: Floats  # theirs, over the paths that keep to the orbit's itinerary; (impacts, 6)


def pilot_of(plan: Plan, codes: Ints) -> Pilot:
    """A plain run of a few blocks with random numbers of its own.

    Shapes: `codes` (impacts,).
    """
    seed = np.random.SeedSequence(plan.seed.entropy, spawn_key=(*plan.seed.spawn_key, PILOT))
    plan = plan._replace(seed=seed, paths=PILOT_PATHS)
    rows = np.concatenate([sample(plan, b).rows[0] for b in range(plan.blocks)])
    kept = np.cumprod(rows[:, :, 6] == codes, axis=1).astype(bool)
    sd = np.array([np.std(rows[of if of.sum() > 100 else slice(None), k, :6], axis=0) for k, of in enumerate(kept.T)])
    return Pilot(rows[:, :, :6].mean(axis=0), sd)


@jit
def _search(
    c: Constants, origin: Origin, codes: Ints, asked: Question, piece: int, rounds: int, noise: Floats
) -> tuple[float, float]:
    """Nearest point of the boundary, from `noise` on and into it; distance (NaN: none found) and limit function."""
    rows, pieces = np.empty((codes.size, 7)), noise.size // piece
    unit = 1.0 / math.sqrt(piece)
    at, trial, gradient = np.zeros(pieces), np.zeros(pieces), np.zeros(pieces)
    for m in range(pieces):
        for i in range(m * piece, (m + 1) * piece):
            at[m] += noise[i] * unit
    limit, used = follow_controlled(c, origin, noise, codes, asked, rows)
    for turn in range(rounds):
        if not math.isfinite(limit):
            return math.nan, limit
        square, along = 0.0, 0.0
        for m in range(pieces):
            gradient[m] = 0.0
            if m * piece < used:
                for i in range(m * piece, (m + 1) * piece):
                    noise[i] = (at[m] + DIFFERENCE) * unit
                other, _ = follow_controlled(c, origin, noise, codes, asked, rows)
                gradient[m] = (other - limit) / DIFFERENCE if math.isfinite(other) else 0.0
                for i in range(m * piece, (m + 1) * piece):
                    noise[i] = at[m] * unit
            square += gradient[m] ** 2
            along += gradient[m] * at[m]
        if square == 0.0 or (turn == 0 and abs(along - limit) > 2.5 * FARTHEST * math.sqrt(square)):
            return math.nan, limit
        share, better, moved = 2.0, False, 0.0
        while not better and share > 0.05:
            share *= 0.5
            for m in range(pieces):
                trial[m] = at[m] + share * ((along - limit) / square * gradient[m] - at[m])
                for i in range(m * piece, (m + 1) * piece):
                    noise[i] = trial[m] * unit
            other, reached = follow_controlled(c, origin, noise, codes, asked, rows)
            better = math.isfinite(other) and abs(other) < (0.9 if turn == 0 else 1.5) * abs(limit) + 1e-3
        if not better:
            return math.nan, limit
        for m in range(pieces):
            moved += (trial[m] - at[m]) ** 2
            at[m] = trial[m]
        limit, used = other, reached
        if moved < 1e-4 and abs(limit) < 1e-4:
            break
    size = 0.0
    for m in range(pieces):
        size += at[m] ** 2
    return (math.sqrt(size) if abs(limit) < NEAR else math.nan), limit


def _enter(c: Constants, origin: Origin, codes: Ints, branch: RareBranch, orbit: Floats, sd: Floats) -> RareBranch:
    """The branch with what is struck there, and what it adds to a kurtosis, not counting walls that are struck."""
    path, k = np.full_like(orbit, np.nan), branch.impact - 1
    for factor in BEYOND:
        follow_controlled(c, origin, branch.shift * factor, codes, Question(-1, 1), path)
        if (path[: k + 1, 6] != codes[: k + 1]).any():
            break
    with np.errstate(invalid="ignore", divide="ignore"):
        square = ((path[:, :6] - orbit[:, :6]) / sd) ** 2
        added = branch.probability * square**2 / (1.0 + branch.probability * square) ** 2
    added[~(sd > 0.0)] = 0.0
    added[:k] = 0.0
    added[np.arange(codes.size), np.where(abs(codes) == 1, 2, 4)] = 0.0
    return replace(branch, code=int(np.nan_to_num(path[k, 6])), kurtosis=float(np.nanmax(added, initial=0.0)))


def find_branches(plan: Plan, codes: Ints, sd: Floats) -> tuple[list[RareBranch], list[tuple[int, int]]]:
    """The branches within `FARTHEST`, one for each design point.

    Returns: Where the first search came near and the second did not settle: unknown, not absent. Shapes: `codes`
    (impacts,); `sd` (impacts, 6).
    """
    c, impacts = plan.scene.constants, codes.size
    start = start_state(plan.scene, np.array([[c.wall1], [c.wall1], [c.wall2], [c.wall2]]))[:, 0]
    origin = Origin(plan.scene.phase, (start[0], start[1], start[2], start[3]), plan.dt)
    orbit = np.full((impacts, 7), np.nan)
    follow_controlled(c, origin, np.empty(0), codes, Question(-1, 1), orbit)
    found: list[RareBranch] = []
    unresolved: list[tuple[int, int]] = []
    tried: list[Floats] = []
    for k in range(min(impacts, SEARCHED)):
        if not (orbit[: k + 1, 6] == codes[: k + 1]).all():
            break
        steps = COARSE * (math.ceil((orbit[k, 0] - origin.tau) / (plan.dt * COARSE)) + 4)
        for code in (1, -1, 2, -2)[: 2 * c.stages]:
            noise, asked = np.zeros(steps), Question(k, code)
            if not _search(c, origin, codes, asked, COARSE, ROUNDS, noise)[0] < 1.25 * FARTHEST:
                continue
            if any(_cosine(noise, other) > ALIKE for other in tried):
                continue
            tried.append(noise.copy())
            beta, _ = _search(c, origin, codes, asked, 1, FINE_ROUNDS, noise)
            if math.isnan(beta):
                unresolved.append((k + 1, code))
            if not beta < FARTHEST:
                continue
            branch = RareBranch(k + 1, code, beta, 0.5 * math.erfc(beta / math.sqrt(2.0)), 0.0, noise)
            found.append(_enter(c, origin, codes, branch, orbit, sd))
    return sorted(found, key=lambda b: -b.kurtosis), unresolved


def _cosine(a: Floats, b: Floats) -> float:
    """Of the angle between two vectors, the shorter filled up with zeros."""
    n = min(a.size, b.size)
    return float(a[:n] @ b[:n] / np.sqrt((a @ a) * (b @ b)))
