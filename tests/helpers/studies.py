"""Small studies that the tests run, cells that go wrong, and the engine that computes cells."""

import os
import signal
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from commands import study

from rattle import InputError
from rattle.compare.engine.run import CELLS_FOLDER, LOG_FILE, Runner, obtain_all, run
from rattle.compare.engine.store import Store
from rattle.compare.study.cells import Prediction, Sample
from rattle.compare.study.design import combine, read_results

__all__ = [
    "CELLS_FOLDER",
    "LOG_FILE",
    "Deadly",
    "Prediction",
    "Refused",
    "Runner",
    "Sample",
    "Signalled",
    "Store",
    "compute",
    "obtain_all",
    "run",
    "study_text",
    "tables_of",
]


def study_text(sigmas=(0.01, 0.02, 0.05), paths=4096, impacts=2, common="true", more=""):
    """A study over sigma of two stages and closures; `more` is appended."""
    closures = ("saltation", "corrected")
    lines = f"seed = 3\ncommon_noise = {common}"
    return study("small", impacts, closures, paths, sigmas, lines, stages=2) + more


def tables_of(study, store):
    """The tables of what is stored."""
    return combine(study, read_results(study, store))


def compute(study, folder, workers=1):
    """Compute the cells of a study; its tables."""
    store = Store(folder / CELLS_FOLDER)
    run(study.cells, store, Runner(workers))
    return tables_of(study, store)


@dataclass(frozen=True)
class Deadly(Prediction):
    """A cell that kills the process that computes it."""

    def compute(self, blocks=None):
        os.kill(os.getpid(), signal.SIGKILL)


@dataclass(frozen=True)
class Signalled(Prediction):
    """A cell that sends a signal to the first process that computes it, which makes a file."""

    first: str = ""
    signal: int = signal.SIGKILL

    def compute(self, blocks=None):
        with suppress(FileExistsError):
            Path(self.first).touch(exist_ok=False)
            os.kill(os.getpid(), self.signal)
        return super().compute(blocks)


@dataclass(frozen=True)
class Refused(Prediction):
    """A cell that cannot be computed, which shows only when it is tried."""

    def compute(self, blocks=None):
        raise InputError("impacts", self.impacts, "are too many")
