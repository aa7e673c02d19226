"""Small runs that compile what the commands need, shared by several processes; how long each
function takes.

A task is run by one process.  A file in the folder of machine code says that it is done.
"""

import hashlib
import os
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
from filelock import FileLock, Timeout
from numba.core import event

# a small run compiles the same machine code as a large one
WARM_UP_IMPACTS = 2
WARM_UP_PATHS = 64
RARE_PATHS = 4096  # from which it is known that a branch is worth it
WARM_UP = "warm-up"  # the command that needs all tasks
LONGEST_TASK = 600.0  # seconds after which a process that has begun a task is no longer waited for
Task = Callable[[], object]

VALIDATED = (
    "closure branching",
    "closure published",
    "closure corrected",
    "paths near rare branches",
)
"""What a validation needs besides the simulation; last what has most in common with it."""
SIMULATED_FIRST = (
    "scheme exact-flight",
    "paths near rare branches",
    "rare branches",
    "closure branching",
)
"""The same where the command itself begins with the closures."""
NEEDS: dict[str, tuple[str, ...]] = {
    "session": (*VALIDATED, "scheme exact-flight", "closure saltation"),
    "validate": (*SIMULATED_FIRST, "closure published", "closure corrected", "closure saltation"),
    "simulate": ("scheme exact-flight", "closure saltation", "rare branches"),
    "assess": ("the long run", *VALIDATED, "scheme exact-flight", "closure saltation"),
    "stationary": ("the long run", "closures in the long run"),
    "run-up": ("the long run",),
    "chaos": ("orbits", "paths on one noise"),
    "boundary": (*VALIDATED, "scheme exact-flight", "closure saltation"),
    "sensitivity": ("paths on one noise", "scheme exact-flight", "closure saltation"),
    "tradeoff": (
        "scheme exact-flight",
        "scheme euler-maruyama-located",
        "scheme euler-maruyama",
        *VALIDATED,
    ),
}
"""The tasks of a command, and of a session in Python, in the order in which other processes take
them.

What the command itself needs last comes first.
"""


def tasks(orders: int = 1) -> dict[str, Task]:
    """All tasks by name, for a drive of so many orders: every closure, every scheme, long orbits
    and runs.

    Neighbours have much in common, which one process compiles once: a process takes them from the
    first on, and those that it has started from the last on.
    """
    import numpy as np

    import rattle as rt
    from rattle.closure import CLOSURES
    from rattle.closure.stationary import linear_law
    from rattle.compare.chaos.exponents import lyapunov
    from rattle.montecarlo import SCHEMES, simulate_rare
    from rattle.montecarlo.branches.search import search_of
    from rattle.montecarlo.coupling.paths import LongPath, growths
    from rattle.montecarlo.long_run import long_run
    from rattle.scene.long_orbit import attractor

    def predict(scene: rt.Scene, closure: str) -> None:
        """All that a closure can be asked for."""
        prediction = rt.mean_map(scene, impacts=WARM_UP_IMPACTS, closure=closure)
        start, end = prediction.section["tau"].iloc[[0, -1]]
        prediction.at_times([0.5 * (start + end)])
        prediction.density(WARM_UP_IMPACTS, "y1", np.zeros(1))

    def follow_on_one_noise() -> None:
        """A long path, and pairs of paths on one noise."""
        LongPath(scene, 0).stretch(100)
        growths(scene, 1e-4, 2, seed=0, settle=10)

    drive = tuple(rt.Order(order, 1.0 / order) for order in range(1, orders + 1))
    scene = rt.Scene.from_gears(rt.DAT21, sigma=0.1, drive=drive)
    tolerant = replace(scene, tolerance=rt.Tolerance(1e-3, 1e-3))
    periodic = rt.Scene(
        alpha=0.25, epsilon=0.5, beta1=0.0, gamma1=0.0, stages=1, sigma=0.01, drive=drive
    )
    simulate = partial(rt.simulate, paths=WARM_UP_PATHS, impacts=WARM_UP_IMPACTS)
    closures = {f"closure {name}": partial(predict, scene, name) for name in CLOSURES}
    schemes: dict[str, Task] = {}
    for name, scheme in SCHEMES.items():
        record = rt.Record(
            step_bias=scheme.has_step_bias, histogram=True, energy=True, batches=True
        )
        schemes[f"scheme {name}"] = partial(simulate, tolerant, scheme=name, record=record)
    others: dict[str, Task] = {
        "the long run": partial(long_run, scene, paths=16, periods=64),
        "paths near rare branches": partial(simulate_rare, scene, paths=RARE_PATHS, impacts=3),
        "rare branches": lambda: search_of(scene, 4).until(1.0),
        "orbits": partial(lyapunov, scene, impacts=8192),
        "closures in the long run": lambda: linear_law(periodic, attractor(periodic)),
        "paths on one noise": follow_on_one_noise,
    }
    exact = "scheme exact-flight"
    return {exact: schemes[exact], **others, **schemes, **closures}


@dataclass(frozen=True)
class DoneTasks:
    """The folder of machine code, and what marks its tasks: the processor and the kind of the
    drive."""

    place: Path
    kind: str

    def mark(self, task: str) -> Path:
        """The empty file that says that a task is done."""
        digest = hashlib.sha256(f"{self.kind} {task}".encode()).hexdigest()[:16]
        return self.place / f"task-{digest}.done"

    def count(self) -> int:
        """How many functions are kept."""
        return sum(1 for _ in self.place.rglob("*.nbc"))

    def run(self, name: str, task: Task, wait: float) -> bool:
        """Run a task, unless it is done or another process still runs it after so many seconds;
        whether it is done."""
        mark = self.mark(name)
        lock = FileLock(mark.with_suffix(".lock"))
        with suppress(OSError, NotImplementedError):  # without a lock where none can be had
            try:
                lock.acquire(timeout=wait)
            except Timeout:
                return False
        try:
            if not mark.exists():
                task()
                with suppress(OSError):
                    mark.touch()
        finally:
            lock.release()
        return True


def compile_tasks(found: Mapping[str, Task], kept: DoneTasks, wait: float = 0.0) -> Iterator[str]:
    """Run tasks, and give the name of each before; those that another process has begun are waited
    for at the end."""
    begun = []
    for name, task in found.items():
        yield name
        if not kept.run(name, task, 0.0):
            begun.append(name)
    if wait > 0.0:
        for name in begun:
            yield name
            kept.run(name, found[name], wait) or found[name]()


def kept_tasks(orders: int = 1) -> DoneTasks | None:
    """Where it is noted which tasks are done; None where no machine code is kept."""
    from rattle.scene.compiled import folder, processor, source_stamp

    place = folder()
    if place is None:
        return None
    return DoneTasks(place, f"{processor()} {source_stamp()} {min(orders, 2)}")


def help_parent(wanted: str) -> None:
    """Compile what a process needs that has started this one, as long as that one runs."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    command, _, several = wanted.partition(", ")
    orders = 2 if several else 1
    kept = kept_tasks(orders)
    all_tasks = tasks(orders)
    names = reversed(all_tasks) if command == WARM_UP else NEEDS.get(command, ())
    needed = {name: all_tasks[name] for name in names}
    for _ in compile_tasks(needed, kept) if kept else ():
        pass


def _end_with_parent() -> None:
    """End this process when the one that has started it closes its end of the pipe, or ends."""
    os.read(0, 1)
    os._exit(0)


class Clock(event.Listener):
    """Processor seconds of each function's own typing and of its LLVM, without those of the
    functions that it calls."""

    def __init__(self) -> None:
        self.rows: dict[str, list[float]] = defaultdict(lambda: [0, 0.0, 0.0])
        # functions that are compiled, and in which part of the work
        self._inside: list[tuple[str, int]] = []
        self._last = 0.0

    def on_start(self, event: Any) -> None:
        """Begin a function, or LLVM's part of it."""
        self._count()
        if event.kind == "numba:llvm_lock":
            name, _ = self._inside[-1] if self._inside else ("", 1)
            self._inside.append((name, 2))
            return
        function = event.data["dispatcher"].py_func
        name = f"{function.__module__}.{function.__qualname__}".removeprefix("rattle.")
        self.rows[name][0] += 1
        self._inside.append((name, 1))

    def on_end(self, event: Any) -> None:
        """End it."""
        self._count()
        self._inside.pop()

    def _count(self) -> None:
        now = time.process_time()
        if self._inside:
            name, part = self._inside[-1]
            self.rows[name][part] += now - self._last
        self._last = now


def measure_times(found: Mapping[str, Task]) -> pd.DataFrame:
    """Run tasks in this process alone, with all compiled anew: how long the work on each function
    takes."""
    from rattle.scene.compiled import compiling_anew

    clock = Clock()
    kinds = ("numba:compile", "numba:llvm_lock")
    with ExitStack() as recorded:
        recorded.enter_context(compiling_anew())
        for kind in kinds:
            recorded.enter_context(event.install_listener(kind, clock))
        for task in found.values():
            task()
    table = pd.DataFrame.from_dict(
        clock.rows, orient="index", columns=["signatures", "typing", "LLVM"]
    )
    table["all"] = table["typing"] + table["LLVM"]
    return table.sort_values("all", ascending=False).astype({"signatures": int})
