"""Runs on numba's simulator of a GPU beside the processor, in a process of its own; differences as JSON to stdout.

The simulator is chosen by an environment variable that numba reads when it is imported.
"""

import json
import os
import sys
import threading
import time
from dataclasses import replace

if __name__ == "__main__":
    os.environ["NUMBA_ENABLE_CUDASIM"] = "1"

import numpy as np
from mc_checks import dat21
from numba.cuda.simulator import kernel, kernelapi

from rattle.montecarlo import Record, simulate
from rattle.montecarlo.cuda.bench import speed
from rattle.montecarlo.settings import Sampling, plan_of
from rattle.scene import Scene, Tolerance

CONTACT = Tolerance(0.02, 0.03, distribution="uniform", draw="contact")
PATH = Tolerance(0.02, 0.03, distribution="normal", draw="path")
FIXED = Tolerance(0.02, 0.03, distribution="fixed")
NOISY = dat21(0.3)

CASES: dict[str, tuple[Scene, dict]] = {
    "plain": (NOISY, {"record": {"times": [0.1, 0.31, 1.0], "itineraries": {"other": [-1, -2]}}}),
    "plain, histograms": (NOISY, {"paths": 8, "record": {"histogram": True}}),
    "plain, one stage": (replace(NOISY, stages=1), {}),
    "plain, contact": (replace(NOISY, tolerance=CONTACT), {}),
    "plain, path": (replace(NOISY, tolerance=PATH), {}),
    "plain, fixed": (replace(NOISY, tolerance=FIXED), {}),
    "plain, two-point": (NOISY, {"sampling": Sampling(increments="two-point")}),
    "plain, some unfinished": (NOISY, {"sampling": Sampling(horizon=1.15)}),
    "located": (NOISY, {"scheme": "euler-maruyama-located"}),
    "located, one stage": (replace(NOISY, stages=1), {"scheme": "euler-maruyama-located"}),
    "located, contact": (replace(NOISY, tolerance=CONTACT), {"scheme": "euler-maruyama-located"}),
    "located, no noise": (replace(NOISY, sigma=0.0, tolerance=PATH), {"scheme": "euler-maruyama-located"}),
    "exact": (NOISY, {"scheme": "exact-flight", "dt": 0.05}),
    "exact, one stage": (replace(NOISY, stages=1), {"scheme": "exact-flight", "dt": 0.05}),
    "exact, contact": (replace(NOISY, tolerance=CONTACT), {"scheme": "exact-flight", "dt": 0.05}),
}


_allocating = threading.Lock()


def shared_array(self, shape, dtype):
    """The simulator's shared array, made by one thread only: its own lets two threads make two at the same time."""
    frame = sys._getframe(1)
    with _allocating:
        where = frame.f_code.co_filename, frame.f_lineno
        if where not in self._allocations:
            self._allocations[where] = np.full(shape, np.nan, dtype)
        return self._allocations[where]


def is_alive(self):
    """As of any thread; but the simulator asks for it again and again, and no other thread would get on meanwhile."""
    time.sleep(1e-5)
    return threading.Thread.is_alive(self)


def largest(a, b) -> float:
    """Largest difference between two arrays that must be missing in the same places."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    if a.shape != b.shape or (np.isnan(a) != np.isnan(b)).any():
        return float("inf")
    return float(np.nanmax(np.abs(a - b), initial=0.0))


def compare(scene: Scene, rng: int = 5, **settings) -> dict:
    """Differences between a run on the simulated GPU and one on the processor, whose seed is always 5."""
    settings = {"paths": 10, "impacts": 2, "dt": 0.01, "scheme": "euler-maruyama"} | settings
    record = Record(raw=True, step_bias=False, **settings.pop("record", {}))
    host = simulate(scene, rng=5, record=record, **settings)
    on_gpu = replace(settings.get("sampling", Sampling()), device="cuda")
    gpu = simulate(scene, rng=rng, record=record, **settings | {"sampling": on_gpu})
    seen = [0, 1, 2, 3, 6] if scene.stages == 1 else list(range(7))
    return {
        "rows": largest(host.raw[:, :, seen], gpu.raw[:, :, seen]),
        "section": largest(host.section, gpu.section),
        "covariance": largest(host.covariance, gpu.covariance),
        "fixed": largest(host.at_times(), gpu.at_times()),
        "agreement": largest(host.agreement, gpu.agreement),
        "histograms": largest(host.histograms.counts, gpu.histograms.counts) if host.histograms else 0.0,
        "work": [[r.path_steps, r.sticking_steps, r.unfinished] for r in (host, gpu)],
    }


def main() -> None:
    kernelapi.FakeCUDAShared.array = shared_array
    kernel.BlockThread.is_alive = is_alive
    found = {
        "cases": {name: compare(scene, **settings) for name, (scene, settings) in CASES.items()},
        "another key": compare(NOISY, rng=6),
        "speed": speed(plan_of(NOISY, paths=4, impacts=1, dt=0.01, scheme="euler-maruyama"), repeats=1),
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main()
