"""Every sampler and closure of a small report, to the last bit; as a program it prints a digest of each.

By hand, for the code takes minutes to compile for another processor: `test_processors.as_on` says what to set.

    python tests/montecarlo/everything.py                  # on this processor
    python tests/montecarlo/everything.py haswell          # as on another one
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
from rattle.scene import DAT21, Scene, Tolerance

SCENES = {
    "plain": Scene.from_gears(DAT21, sigma=0.1),
    "toleranced": Scene.from_gears(DAT21, sigma=0.8, tolerance=Tolerance(0.02, 0.04, distribution="normal")),
}  # fmt: skip


def digests():
    """Digest of each part's numbers, of all their bits."""
    found = {}

    def note(name, *arrays):
        found[name] = hashlib.sha256(b"".join(np.ascontiguousarray(a, float).tobytes() for a in arrays)).hexdigest()

    for kind, scene in SCENES.items():
        for closure in CLOSURES:
            orbit = mean_map(scene, impacts=4, closure=closure)
            times = np.linspace(0.1, 0.9, 5) * orbit.trace.span[1]
            table = orbit.section.select_dtypes("number")
            note(f"{kind}, {closure}", table, orbit.at_times(times).select_dtypes("number"))
        for scheme in SCHEMES:
            run = simulate(scene, paths=1500, impacts=4, scheme=scheme, record=Record(raw=True, times=[0.7, 1.9]))
            note(f"{kind}, {scheme}", run.raw, run.section.select_dtypes("number"), run.at_times())
    plain = SCENES["plain"]
    controlled = simulate(plain, paths=1500, impacts=4, scheme="exact-flight", control=True)
    note("control variate", controlled.section.select_dtypes("number"))
    verdict = validate(plain, impacts=4, paths=2048, scheme="exact-flight", closures=list(CLOSURES))
    table = verdict.table.select_dtypes("number")
    for name in table:
        note(f"report, {name}", table[name])
    return found


if __name__ == "__main__":
    if len(sys.argv) > 1:
        from test_processors import as_on

        with tempfile.TemporaryDirectory() as folder:
            environment = os.environ | {"NUMBA_CACHE_DIR": folder} | as_on(sys.argv[1])
            raise SystemExit(subprocess.run([sys.executable, __file__], env=environment, check=False).returncode)
    for name, digest in digests().items():
        print(digest[:16], name)
