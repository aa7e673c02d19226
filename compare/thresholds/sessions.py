"""Data shared by the tests of a session: settings, ensembles, and the common width of all intervals."""

import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import pytest

from rattle.compare.study.cells import Sample, Sampled
from rattle.compare.study.obtain import obtain
from rattle.compare.study.store import Store, Stored
from rattle.compare.study.waiting import aloud
from rattle.compare.thresholds.claim import Claim, merged, read_claim
from rattle.compare.thresholds.plugin import CLAIM, REFUSED
from rattle.compare.thresholds.settings import Settings
from rattle.compare.validation.verdict import widest
from rattle.montecarlo.ensemble import Blocks, in_threads
from rattle.scene.errors import InputError, RattleError

__all__ = ["Drawn", "Thresholds", "thresholds_of"]


class Drawn(NamedTuple):
    """An ensemble with its cost.

    Attributes
    ----------
    run : Sampled
    computed : bool
        Whether it was simulated now; false if it was stored.
    seconds : float
        Wall time of the simulation; 0 if it was stored.
    """

    run: Sampled
    computed: bool
    seconds: float


@dataclass
class _Watched:
    """A cell that runs on threads and records whether it had to be computed."""

    sample: Sample
    workers: int
    computed: bool = False

    @property
    def key(self) -> str:
        return self.sample.key

    @property
    def label(self) -> str:
        return self.sample.label

    def opened(self, stored: Stored) -> Sampled:
        return self.sample.opened(stored)

    def compute(self, blocks: Blocks | None = None) -> Stored:
        self.computed = True
        return self.sample.compute(in_threads(self.workers))


@dataclass
class Thresholds:
    """The claims of a session and the ensembles that they are compared with.

    Attributes
    ----------
    settings : Settings
    claims : sequence of Claim
        Claims of all selected tests with valid markers.
    config : pytest.Config
    """

    settings: Settings
    claims: Sequence[Claim]
    config: pytest.Config
    _drawn: dict[str, Sampled] = field(default_factory=dict)

    @cached_property
    def rows(self) -> int:
        """Number of checks of all tests."""
        return sum(len(claim.rows) for claim in self.claims)

    @cached_property
    def looks(self) -> int:
        """Number of intervals that may be evaluated: every row at every possible look of its claim."""
        return sum(len(claim.rows) * len(self.settings.sizes(claim)) for claim in self.claims)

    @property
    def z(self) -> float:
        """Half width of the intervals in standard errors, for simultaneous coverage (Bonferroni)."""
        return widest(self.looks, self.settings.false_alarm)

    @cached_property
    def folder(self) -> Path:
        """Folder of the stored ensembles; raises InputError if pytest's cache is off and no other folder is given."""
        if self.settings.cache is not None:
            return self.settings.cache
        cache = getattr(self.config, "cache", None)
        if cache is None:
            raise InputError("rattle-cache", "", "pytest's own cache is switched off; name a folder for the ensembles")
        return Path(cache.mkdir("rattle"))

    @cached_property
    def store(self) -> Store:
        """Store of the ensembles, created when the first one is needed."""
        return Store(self.folder)

    def ensemble(self, claim: Claim, paths: int | None) -> Drawn:
        """Simulate an ensemble, or read the one that an earlier test or session has simulated.

        Parameters
        ----------
        claim : Claim
            What the test says of a model.
        paths : int or None
            Number of paths; None for the accuracy of the claim.

        Returns
        -------
        Drawn
        """
        sample = Sample(claim.scene, claim.impacts[-1], self.settings.seed, claim.scheme, paths, claim.accuracy)
        cell = _Watched(sample, self.settings.workers)
        started = time.perf_counter()
        if cell.key not in self._drawn:
            self._drawn[cell.key] = sample.opened(obtain(self.store, cell, say=_past_capture(self.config)))
        return Drawn(self._drawn[cell.key], cell.computed, cell.computed * (time.perf_counter() - started))


def thresholds_of(marked: Sequence[pytest.Item], settings: Settings, config: pytest.Config) -> Thresholds:
    """Read the claims of marked tests, and store each claim, or the error of its marker, in the stash of its test.

    A test that inherits the marker but does not use the fixture has no claim.

    Parameters
    ----------
    marked : sequence of pytest.Item
        The selected tests with the marker.
    settings : Settings
        Settings as they were given.
    config : pytest.Config
        Configuration of the session.

    Returns
    -------
    Thresholds
    """
    claims = []
    for item in marked:
        if "rattle" not in getattr(item, "fixturenames", ()):
            if any(mark.name == "rattle" for mark in item.own_markers):
                item.stash[REFUSED] = RattleError("its marker checks nothing; let the test take the fixture 'rattle'")
            continue
        try:
            claims.append(_claim(item))
        except Exception as error:  # any error in reading a marker belongs to this test alone
            item.stash[REFUSED] = error
        else:
            item.stash[CLAIM] = claims[-1]
    return Thresholds(settings, claims, config)


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
    return read_claim(merged(mark.kwargs for mark in markers), item.path.parent)
