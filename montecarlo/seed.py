"""What `rng` may be: a seed, a SeedSequence, or a generator of numpy (SPEC 7 of Scientific
Python)."""

import numpy as np

from rattle.scene import InputError, count

Seed = int | np.random.SeedSequence
"""What gives the same results each time."""

Rng = Seed | np.random.Generator | np.random.BitGenerator
"""A whole number or a SeedSequence gives the same results each time.  A generator gives those of a
child of its seed sequence, another one each time that it is passed, whatever was drawn from it; no
number is drawn from it here."""


def read_seed(rng: Rng) -> Seed:
    """The seed that a public function is given; a generator is asked for a child once in each
    call."""
    if isinstance(rng, np.random.Generator):
        rng = rng.bit_generator
    if isinstance(rng, np.random.BitGenerator):
        return rng.seed_seq.spawn(1)[0]  # type: ignore[attr-defined, no-any-return]
    if isinstance(rng, np.random.RandomState):
        why = "has no seed sequence; give a whole number, or np.random.default_rng(7)"
        raise InputError("rng", "a RandomState", why)
    return rng if isinstance(rng, np.random.SeedSequence) else count("rng", rng, least=0)


def child_seed(seed: np.random.SeedSequence, *keys: int) -> np.random.SeedSequence:
    """The child of a seed that some keys name."""
    return np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, *keys))


def read_whole_seed(rng: Rng) -> int:
    """The same as a whole number, for results that are stored under it."""
    seed = read_seed(rng)
    return seed if isinstance(seed, int) else int(seed.generate_state(1, np.uint64)[0])
