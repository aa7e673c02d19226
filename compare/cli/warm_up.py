"""The command ``rattle warm-up``."""

import sys
import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import click
import numpy as np

from rattle.compare.cli.console import say

if TYPE_CHECKING:
    from rattle.scene import Scene

IMPACTS, PATHS = 2, 64  # a small run compiles the same machine code as a large one
Task = Callable[[], object]


def tasks() -> dict[str, Task]:
    """Small runs that compile what the commands need, by name: every closure, every scheme, long orbits and runs."""
    from rattle.closure import CLOSURES
    from rattle.compare.chaos.exponents import lyapunov
    from rattle.montecarlo import SCHEMES, Record, simulate, simulate_rare
    from rattle.montecarlo.branches.search import rare_events
    from rattle.montecarlo.coupling.long_path import LongPath
    from rattle.montecarlo.coupling.pairs import growths
    from rattle.montecarlo.long_run import long_run
    from rattle.scene import DAT21, Scene, Tolerance

    scene = Scene.from_gears(DAT21, sigma=0.1)
    single = Scene.from_gears(DAT21, sigma=0.1, stages=1)
    tolerant = Scene.from_gears(DAT21, sigma=0.1, tolerance=Tolerance(1e-3, 1e-3, draw="contact"))
    by_path = Scene.from_gears(DAT21, sigma=0.1, tolerance=Tolerance(1e-3, 1e-3, draw="path"))
    found: dict[str, Task] = {}
    for name in CLOSURES:
        found[f"closure {name}"] = partial(_predict, scene, name)
        found[f"closure {name}, one stage"] = partial(_predict, single, name)
        found[f"closure {name}, gaps that vary"] = partial(_predict, by_path, name)
    found["closures in the long run"] = partial(
        _stationary, Scene(alpha=0.25, epsilon=0.5, beta1=0.0, gamma1=0.0, stages=1, sigma=0.01)
    )
    for name, scheme in SCHEMES.items():
        record = Record(step_bias=scheme.has_step_bias, histogram=True, energy=True, batches=True)
        found[f"scheme {name}"] = partial(simulate, tolerant, paths=PATHS, impacts=IMPACTS, scheme=name, record=record)
    for name, one in (("rare branches", scene), ("rare branches, one stage", single)):
        found[name] = partial(rare_events, one, 4)
    found["paths near rare branches"] = partial(simulate_rare, scene, paths=PATHS, impacts=IMPACTS)
    for name, one in (("the long run", scene), ("the long run, one stage", single)):
        found[name] = partial(long_run, one, paths=16, periods=64)
    found["gaps that vary by path"] = partial(simulate, by_path, paths=PATHS, impacts=IMPACTS)
    found["orbits"] = partial(lyapunov, scene, impacts=8192)
    found["long paths"] = partial(LongPath(scene, 0).stretch, 100)
    found["pairs of paths"] = partial(growths, scene, 1e-4, 2, seed=0, settle=10)
    return found


def _predict(scene: "Scene", closure: str) -> None:
    """All that a closure can be asked for."""
    from rattle.closure import mean_map

    found = mean_map(scene, impacts=IMPACTS, closure=closure)
    start, end = found.section["tau"].iloc[[0, -1]]
    found.at_times([0.5 * (start + end)])
    found.density(IMPACTS, "y1", np.zeros(1))


def _stationary(scene: "Scene") -> None:
    """The linear closure at a periodic orbit."""
    from rattle.closure.attractor import attractor
    from rattle.closure.stationary import linear_law

    linear_law(scene, attractor(scene))


@click.command("warm-up")
def warm_up() -> None:
    """Compile all machine code now.

    Then no later command has to; without it each command compiles what it needs when it first runs. Machine code is
    kept for this user, this installation and this kind of processor.

    Exit codes: 0 done; 2 it cannot be kept.
    """
    from tqdm import tqdm

    from rattle.scene.errors import OutputError
    from rattle.scene.machine_code import count_compiled, folder

    started, found = time.perf_counter(), tasks()
    place = folder()
    if place is None:
        raise OutputError("machine code cannot be kept: set NUMBA_CACHE_DIR to a folder of your own")
    for name in (line := tqdm(found, disable=None, unit="task", file=sys.stderr)):
        line.set_postfix_str(name)
        found[name]()
    seconds = time.perf_counter() - started
    say(f"{count_compiled()} functions compiled in {seconds:.0f} s; kept in {place}")
