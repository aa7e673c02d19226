"""Small studies that the tests run, and cells that go wrong."""

import os
import signal
from dataclasses import dataclass

from rattle.compare.study.cells import Prediction
from rattle.compare.study.design import combine, read_results
from rattle.scene.errors import InputError

HEAD = """
[study]
title = "small"
impacts = {impacts}
closures = ["saltation", "corrected"]
paths = {paths}
seed = 3
common_noise = {common}

[scene]
alpha = 1.5
epsilon = 0.9
beta1 = 0.083
gamma1 = 0.057
beta2 = 0.133
gamma2 = 0.029
mu = 0.6
"""


def study_text(sigmas=(0.01, 0.02, 0.05), paths=4096, impacts=2, common="true", more=""):
    """A study over sigma; `more` is appended."""
    head = HEAD.format(paths=paths, impacts=impacts, common=common)
    return head + f"\n[[axes]]\nsigma = {list(sigmas)}\n" + more


def tables_of(study, store):
    """The tables of what is stored."""
    return combine(study, read_results(study, store))


@dataclass(frozen=True)
class Deadly(Prediction):
    """A cell that kills the process that computes it."""

    def compute(self, blocks=None):
        os.kill(os.getpid(), signal.SIGKILL)


@dataclass(frozen=True)
class Refused(Prediction):
    """A cell that cannot be computed, which shows only when it is tried."""

    def compute(self, blocks=None):
        raise InputError("impacts", self.impacts, "are too many")
