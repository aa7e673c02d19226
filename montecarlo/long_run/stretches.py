"""Stretch after stretch of a block of paths in compiled code: the kernel of `simulate`, then the sums.

What is done once for a stretch (random numbers, times, and the way into compiled code) is spread over few impacts where
a block has few paths, so that many stretches are one call.  A stretch has random numbers of its own: in stretch s path
p has the number ``s 2^32 + p``.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.montecarlo.kernel.control_variate import LinearPath
from rattle.montecarlo.kernel.kernel import EXACT, Job, block_kernel
from rattle.montecarlo.kernel.lanes import Lanes, Room
from rattle.montecarlo.long_run.noise_work import add_noise_work
from rattle.montecarlo.long_run.sums import NOISE, Sums, add_stretch
from rattle.montecarlo.noise.philox import Word
from rattle.scene.compiled import jit

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

APART = 2**32  # between the numbers of a path in two stretches
MANY = 256  # impacts of a path in a stretch from which on stretches become shorter
RUN = block_kernel(EXACT)


class Block(NamedTuple):
    """A block of paths that is followed without end."""

    job: Job  # settings; its time is that at which every period begins
    control: LinearPath  # empty
    first: int  # first, paths, steps: number of the first path, number of paths, and of steps in a period
    paths: int
    steps: int
    every: Lanes  # every, room: paths side by side, and buffers
    room: Room
    state: Floats  # states at the end of the last stretch; (paths, 4)
    struck: Floats  # time of the last impact at each mesh; (paths, 2)
    # buffer of recorded states.  One more than is used: at powers of two, paths would share lines of the cache; (1,
    # paths, samples + 1, 4)
    samples: Floats
    none: Floats  # output of no control variate; (0, 1, COLUMNS)
    # begin, periods, stretches, long: step of the period at which the next stretch begins; periods and stretches
    # followed so far; stretches of the period in which a path had very many impacts; (1,)
    begin: Ints
    periods: Ints
    stretches: Ints
    long: Ints


@jit
def follow_stretches(
    b: Block,
    rows: Floats,
    fixed: Ints,
    turn: float,
    stretches: int,
    until: int,
    length: int,
    sums: Sums,
    detail: bool,
    controls: bool,
) -> int:
    """Follow a block for some stretches.

    `fixed`: Steps of a stretch after which states are recorded, and one beyond its end: the kernel retires no
    path before all are past, and a path that it retires is overwritten by another. `stretches`, `until`:
    Stretches to follow at most, and the number of periods to end at: the end of a batch. `detail`, `controls`:
    Whether distributions and the section are counted, and whether the noise's work is summed then. Returns: 0;
    or, where a path had more impacts in a stretch than there is space for, how many.  The block is then as before
    that stretch. Shapes: `rows` (1, paths, impacts, COLUMNS).
    """
    samples = fixed.size - 1
    part, apart = fixed[samples - 1], fixed[0]
    between = apart * b.job.dt
    for _ in range(stretches):
        if b.periods[0] == until:
            break
        tau, number = b.job.tau + b.begin[0] * b.job.dt, b.stretches[0] * APART + b.first
        for i in range(b.room.path.size):
            b.room.path[i] = Word(number + i)
        walls, last = b.every.walls.copy(), b.every.last.copy()
        b.every.impacts[:] = 0
        job = Job(b.job.c, b.job.backlash, b.job.key, tau, b.job.dt, b.job.scheme, b.job.two_point, part)
        RUN(job, b.control, number, b.every, b.room, rows, fixed, b.samples, b.none)
        own = b.every.impacts[0, : b.paths]
        most = own.max()
        if most >= rows.shape[2]:
            b.every.walls[:], b.every.last[:] = walls, last
            b.every.state[0, :, : b.paths] = b.state.T
            return int(most)
        states, at = b.samples[0, :, :samples], tau + between
        if detail and controls:
            out = sums.main[:, sums.batch[0], NOISE:]
            add_noise_work(b.job.c, rows[0], own, b.state, states, at, between, out)
        b.state[:] = states[:, samples - 1]
        add_stretch(b.job.c, rows[0], own, b.struck, states, at, between, sums, detail)
        b.stretches[0] += 1
        b.begin[0] += part
        b.long[0] += most >= MANY
        if b.begin[0] == b.steps:
            b.begin[0] = 0
            b.periods[0] += 1
            b.every.last[:] -= turn
            b.struck[:] -= turn
            if (until - b.periods[0]) % length == 0:
                sums.batch[0] += 1
            if b.long[0] > 0:
                break
    return 0
