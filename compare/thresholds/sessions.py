"""What the tests of a session share: its settings and its simulations."""

import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from rattle.compare.study.cells import Cell
from rattle.compare.study.obtain import obtain
from rattle.compare.study.store import Store, Stored
from rattle.compare.study.waiting import aloud
from rattle.compare.thresholds.claim import Claim, merge, read_claim
from rattle.compare.thresholds.plugin import CLAIM, REFUSED
from rattle.compare.thresholds.settings import Settings
from rattle.montecarlo.blocks import Blocks, in_threads
from rattle.scene.errors import InputError, RattleError


class Drawn(NamedTuple):
    """A simulation with its cost."""

    run: Any
    computed: bool  # whether it was simulated now; false if it was stored
    seconds: float  # wall time of the simulation; 0 if it was stored


@dataclass
class _Watched:
    """A cell that runs on threads and records whether it had to be computed."""

    cell: Cell
    workers: int
    computed: bool = False

    @property
    def key(self) -> str:
        return self.cell.key

    @property
    def label(self) -> str:
        return self.cell.label

    def restore(self, stored: Stored) -> object:
        return self.cell.restore(stored)

    def compute(self, blocks: Blocks | None = None) -> Stored:
        self.computed = True
        return self.cell.compute(in_threads(self.workers))


@dataclass
class Thresholds:
    """The settings of a session and the simulations that its tests share."""

    settings: Settings
    config: pytest.Config
    _drawn: dict[str, Any] = field(default_factory=dict)

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

    def draw(self, cell: Cell) -> Drawn:
        """Simulate, or read what an earlier test or session has simulated."""
        watched = _Watched(cell, self.settings.workers)
        started = time.perf_counter()
        if cell.key not in self._drawn:
            say = _past_capture(self.config)
            found = watched.compute() if self.store is None else obtain(self.store, watched, say=say)
            self._drawn[cell.key] = cell.restore(found)
        return Drawn(self._drawn[cell.key], watched.computed, watched.computed * (time.perf_counter() - started))


def read_claims(marked: Sequence[pytest.Item]) -> None:
    """Store the claim of each marked test, or the error of its marker, in the stash of the test.

    A test that inherits the marker but does not use the fixture has no claim.
    """
    for item in marked:
        if "rattle" not in getattr(item, "fixturenames", ()):
            if any(mark.name == "rattle" for mark in item.own_markers):
                item.stash[REFUSED] = RattleError("its marker checks nothing; let the test take the fixture 'rattle'")
            continue
        try:
            item.stash[CLAIM] = _claim(item)
        except Exception as error:  # any error in reading a marker belongs to this test alone
            item.stash[REFUSED] = error


def _past_capture(config: pytest.Config) -> Callable[[str], None]:
    """A function that prints a line on the terminal although pytest captures output."""

    def say(text: str) -> None:
        capture = config.pluginmanager.getplugin("capturemanager")
        with capture.global_and_fixture_disabled() if capture else nullcontext():
            aloud(text)

    return say


def _claim(item: pytest.Item) -> Claim:
    markers = list(item.iter_markers("rattle"))
    if unnamed := [mark.args for mark in markers if mark.args]:
        raise InputError("marker rattle", unnamed[0], "name every option, as in scene='dat21.toml'")
    return read_claim(merge(mark.kwargs for mark in markers), item.path.parent)
