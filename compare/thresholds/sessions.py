"""What the tests of a session share: settings, the number of checks and so the width of every interval, ensembles."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import pytest

from compare.moments import widest
from compare.study.cell import Sample, Sampled
from compare.study.obtain import obtain
from compare.study.store import Store, Stored
from compare.study.waiting import aloud
from compare.thresholds.claim import Claim, merged, read_claim
from compare.thresholds.plugin import CLAIM
from montecarlo.ensemble import Blocks, in_threads
from scene.errors import InputError, RattleError
from scene.validate import choice, count, finite

__all__ = ["PROFILES", "Drawn", "Settings", "Thresholds", "read_settings", "thresholds_of"]

PROFILES = {"quick": 32_768, "full": 1_048_576}
"""Simulated paths of a test that does not say how many."""
BASELINES = ("compare", "record", "regenerate")


class Settings(NamedTuple):
    """What the user has chosen for the session.

    ``false_alarm`` is the largest probability that it fails although every claim in it is true; ``cache`` is None for
    pytest's own.
    """

    false_alarm: float = 0.01
    undecided: str = "skip"
    profile: str = "quick"
    cache: Path | None = None
    seed: int = 0
    workers: int = 1
    baselines: str = "compare"


def read_settings(chosen: Mapping[str, str]) -> Settings:
    """Settings from the text of the options.

    Raises
    ------
    InputError
        Names the option, its value and the remedy.

    Examples
    --------
    >>> read_settings({"rattle_false_alarm": "0.05", "rattle_cache": ""}).false_alarm
    0.05
    """
    given = {name.removeprefix("rattle_"): text for name, text in chosen.items() if text != ""}
    rate = _number("rattle-false-alarm", given.pop("false_alarm", "0.01"))
    if not 0.0 < finite("rattle-false-alarm", rate) < 1.0:
        raise InputError("rattle-false-alarm", rate, "must lie between 0 and 1, both excluded")
    return Settings(
        rate,
        choice("rattle-undecided", given.get("undecided", "skip"), ("skip", "fail")),
        choice("rattle-profile", given.get("profile", "quick"), PROFILES),
        Path(given["cache"]) if "cache" in given else None,
        count("rattle-seed", _whole("rattle-seed", given.get("seed", "0")), least=0),
        count("rattle-workers", _whole("rattle-workers", given.get("workers", "1"))),
        choice("rattle-baselines", given.get("baselines", "compare"), BASELINES),
    )


def _number(field: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(field, text, "give a number") from None


def _whole(field: str, text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise InputError(field, text, "give a whole number") from None


class Drawn(NamedTuple):
    """An ensemble, and what it took to have it: seconds of simulation, or 0 where it was there already."""

    run: Sampled
    computed: bool
    seconds: float


@dataclass
class _Watched:
    """A cell that runs on threads and remembers whether it had to be computed here."""

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
    """The claims of a session and the ensembles that they are held against.

    Attributes
    ----------
    settings : Settings
    rows : int
        Checks of all tests that were selected.
    folder : Path
        Where ensembles are kept.
    config : pytest.Config
    """

    settings: Settings
    rows: int
    folder: Path
    config: pytest.Config
    _drawn: dict[str, Sampled] = field(default_factory=dict)

    @property
    def z(self) -> float:
        """Standard errors on each side of an interval, so that all intervals hold at once (Bonferroni)."""
        return widest(self.rows, self.settings.false_alarm)

    @cached_property
    def store(self) -> Store:
        """Made when the first ensemble is asked for."""
        return Store(self.folder)

    def sample(self, claim: Claim) -> Sample:
        """The ensemble that a claim is held against."""
        paths = claim.paths
        if paths is None and claim.accuracy is None:
            paths = PROFILES[self.settings.profile]
        return Sample(claim.scene, claim.impacts[-1], self.settings.seed, claim.scheme, paths, claim.accuracy)

    def ensemble(self, claim: Claim) -> Drawn:
        """Simulate, or find what an earlier test or session has simulated."""
        cell = _Watched(self.sample(claim), self.settings.workers)
        started = time.perf_counter()
        if cell.key not in self._drawn:
            self._drawn[cell.key] = cell.sample.opened(obtain(self.store, cell, say=_past_capture(self.config)))
        return Drawn(self._drawn[cell.key], cell.computed, cell.computed * (time.perf_counter() - started))


def thresholds_of(marked: Sequence[pytest.Item], chosen: Mapping[str, str], config: pytest.Config) -> Thresholds:
    """Read the claims of marked tests; each is left in its test's stash.

    A test that only inherits the marker and does not take the fixture claims nothing.

    Raises
    ------
    RattleError
        Names the test, the option of its marker, the value and the remedy; every wrong marker in one message.
    """
    settings, rows, wrong = read_settings(chosen), 0, []
    for item in marked:
        if "rattle" not in getattr(item, "fixturenames", ()):
            if any(mark.name == "rattle" for mark in item.own_markers):
                wrong.append(f"{item.nodeid}: its marker checks nothing; let the test take the fixture 'rattle'")
            continue
        try:
            markers = list(item.iter_markers("rattle"))
            if unnamed := [mark.args for mark in markers if mark.args]:
                raise InputError("marker rattle", unnamed[0], "name every option, as in scene='dat21.toml'")
            claim = read_claim(merged(mark.kwargs for mark in markers), item.path.parent)
        except InputError as error:
            wrong.append(f"{item.nodeid}: {error}")
        else:
            item.stash[CLAIM] = claim
            rows += len(claim.rows)
    if wrong:
        raise RattleError("\n".join(f"rattle: {line}" for line in wrong))
    return Thresholds(settings, rows, settings.cache or _own_cache(config), config)


def _past_capture(config: pytest.Config) -> Callable[[str], None]:
    """Says a line on the terminal while a test runs."""

    def say(text: str) -> None:
        capture = config.pluginmanager.getplugin("capturemanager")
        with capture.global_and_fixture_disabled() if capture else nullcontext():
            aloud(text)

    return say


def _own_cache(config: pytest.Config) -> Path:
    cache = getattr(config, "cache", None)
    if cache is None:
        raise InputError("rattle-cache", None, "pytest's own cache is switched off; name a folder for the ensembles")
    return Path(cache.mkdir("rattle"))
