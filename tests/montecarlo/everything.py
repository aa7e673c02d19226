"""Every sampler and closure, and a small report, to the last bit; as a program it prints a digest of each.

By hand, for the code takes minutes to compile for another processor, which `test_processors.as_on` pretends to be:

    python tests/montecarlo/everything.py here                            # on this processor
    python tests/montecarlo/everything.py haswell                         # as on another one
    python tests/montecarlo/everything.py haswell saltation exact-flight  # only parts with one of these words
"""

import hashlib
import os
import subprocess
import sys
import tempfile

import numpy as np

from rattle.closure import CLOSURES, mean_map
from rattle.compare import validate
from rattle.montecarlo import SCHEMES, Record, simulate
from rattle.montecarlo.settings.sampling import Sampling
from rattle.scene import DAT21, Scene, Tolerance

SCENES = {
    "plain": Scene.from_gears(DAT21, sigma=0.1),
    "toleranced": Scene.from_gears(DAT21, sigma=0.8, tolerance=Tolerance(0.02, 0.04, distribution="normal")),
}  # fmt: skip


def predicted(scene, closure):
    """Section moments of a closure, and moments at fixed times."""
    orbit = mean_map(scene, impacts=4, closure=closure)
    return orbit.section, orbit.at_times(np.linspace(0.1, 0.9, 5) * orbit.trace.span[1])


def sampled(scene, scheme, **settings):
    """Impacts of single paths, section moments, and moments at fixed times."""
    record = Record(raw=True, times=[0.7, 1.9])
    run = simulate(scene, paths=1500, impacts=4, scheme=scheme, record=record, **settings)
    return run.raw, run.section, run.at_times()


def parts():
    """What is computed, by name."""
    plain = SCENES["plain"]
    for kind, scene in SCENES.items():
        yield from ((f"{kind}, {name}", lambda s=scene, n=name: predicted(s, n)) for name in CLOSURES)
        yield from ((f"{kind}, {name}", lambda s=scene, n=name: sampled(s, n)) for name in SCHEMES)
    yield "control variate", lambda: sampled(plain, "exact-flight", sampling=Sampling(control=True))
    yield "report", lambda: [validate(plain, impacts=4, paths=2048, scheme="exact-flight").table]


def digest(tables):
    """Digest of all bits of all numbers in some tables and arrays."""
    found = hashlib.sha256()
    for table in tables:
        numbers = table.select_dtypes("number") if hasattr(table, "select_dtypes") else table
        found.update(np.ascontiguousarray(numbers, float).tobytes())
    return found.hexdigest()[:16]


def print_digests(words):
    """Print a line for each part whose name has one of the words; for all if there are none."""
    for name, compute in parts():
        if not words or any(word in name for word in words):
            print(digest(compute()), name, flush=True)


if __name__ == "__main__":
    processor, *words = sys.argv[1:]
    if processor == "here":
        print_digests(words)
    else:
        from test_processors import as_on

        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, __file__, "here", *words]
            environment = os.environ | {"NUMBA_CACHE_DIR": folder} | as_on(processor)
            raise SystemExit(subprocess.run(command, env=environment, check=False).returncode)
