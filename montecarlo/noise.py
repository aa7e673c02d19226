"""Random streams: each block of paths draws from its own, made from (seed, block number) alone.

Nothing about a stream depends on which worker runs the block, in which order, or how many blocks there are; so
a result is the same bit for bit however the work is shared out.
"""

from typing import NamedTuple

import numpy as np

__all__ = ["LEVELS", "Streams", "streams"]

LEVELS = 3  # step sizes that can run side by side on one noise: dt, 2 dt, 4 dt


class Streams(NamedTuple):
    """The generators of one block.

    ``steps`` drives the Brownian increments and is shared by all step sizes; ``bridges`` split an increment at
    an impact, one generator per step size; ``tolerance`` draws the backlashes.
    """

    steps: np.random.Generator
    bridges: tuple[np.random.Generator, np.random.Generator, np.random.Generator]
    tolerance: np.random.Generator


def streams(seed: np.random.SeedSequence, block: int) -> Streams:
    """The streams of a block.

    Examples
    --------
    >>> seed = np.random.SeedSequence(7)
    >>> a, b = streams(seed, 3).steps.normal(), streams(seed, 3).steps.normal()
    >>> a == b, a == streams(seed, 4).steps.normal()
    (True, False)
    """

    def generator(purpose: int) -> np.random.Generator:
        key = (*seed.spawn_key, block, purpose)
        return np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed.entropy, spawn_key=key)))

    return Streams(generator(0), (generator(2), generator(3), generator(4)), generator(1))
