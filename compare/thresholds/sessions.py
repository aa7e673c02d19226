"""What the tests of a session share: its settings and its simulations."""

import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from rattle.compare.study.store import Cell, Content, Store, print_on_stderr
from rattle.compare.thresholds.settings import Settings
from rattle.montecarlo.kernel.blocks import in_threads


class TimedRun(NamedTuple):
    """A simulation with its cost."""

    run: Any
    computed: bool  # whether it was simulated now; false if it was stored
    seconds: float  # wall time of the simulation; 0 if it was stored


@dataclass
class Thresholds:
    """The settings of a session and the simulations that its tests share."""

    settings: Settings
    config: pytest.Config
    _runs: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def folder(self) -> Path | None:
        """Folder of the stored simulations; None if pytest's cache is off and no other folder is given."""
        if self.settings.cache is not None:
            return self.settings.cache
        cache = getattr(self.config, "cache", None)
        return None if cache is None else Path(cache.mkdir("rattle"))

    @cached_property
    def store(self) -> Store | None:
        """Store of the simulations, created when the first one is needed; None if none is kept."""
        return None if self.folder is None else Store(self.folder)

    def simulate(self, cell: Cell) -> TimedRun:
        """Simulate, or read what an earlier test or session has simulated."""
        computed, started = [], time.perf_counter()

        def compute(cell: Cell) -> Content:
            computed.append(cell.key)
            return cell.compute(in_threads(self.settings.workers))

        if cell.key not in self._runs:
            if self.store is None:
                self._runs[cell.key] = cell.restore(compute(cell))
            else:
                self._runs[cell.key] = self.store.obtain(cell, compute, _past_capture(self.config))
        seconds = time.perf_counter() - started if computed else 0.0
        return TimedRun(self._runs[cell.key], bool(computed), seconds)


def _past_capture(config: pytest.Config) -> Callable[[str], None]:
    """A function that prints a line on the terminal although pytest captures output."""

    def say(text: str) -> None:
        capture = config.pluginmanager.getplugin("capturemanager")
        with capture.global_and_fixture_disabled() if capture else nullcontext():
            print_on_stderr(text)

    return say
