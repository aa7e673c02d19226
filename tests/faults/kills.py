"""kill -9 at random moments of a study, as it is loaded, computed and written: ``python tests/faults/kills.py 100``."""

import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from click.testing import CliRunner

from rattle.compare.cli.main import main
from rattle.compare.study.design import Study
from rattle.compare.study.store import Store
from rattle.compare.study.tables import CELLS, TABLES

TEXT = """
[study]
title = "killed"
impacts = 2
closures = ["saltation", "corrected"]
paths = 20_000

[scene]
alpha = 1.5
epsilon = 0.9
beta1 = 0.083
gamma1 = 0.057
stages = 1

[[axes]]
sigma = [0.01, 0.02, 0.03, 0.04]
"""
BEGUN = {"imports": "noise.toml", "cells": f"noise/{CELLS}/*.parquet", "page": "noise/.page-*.part"}
"""Phases of a run, and the files that show that one has begun."""
CELLS_OF_ALL = 12
LIFE = ("imports", "cells", "cells", "page", "page")
"""Phases in which a study is killed, one run after the other, before it is run to its end."""
LOOK = 0.002  # seconds between two looks at a folder
COMMAND = ("-m", "rattle.compare")
QUICK = (
    "-c",
    "from rattle.compare.study import impacts_page as page; page.FIGURES = dict([*page.FIGURES.items()][:1]);"
    "from rattle.compare.cli.main import main; main()",
)
"""The usual command, and one that draws a single figure, as drawing takes most of a small study's time."""


class Life:
    """A study in a folder of its own, killed again and again.

    Attributes
    ----------
    out : Path
        Its results.
    sound : dict of str to bytes
        The cells that have been seen there: each must stay as it is.
    """

    def __init__(self, place, command):
        place.mkdir()
        self.command = command
        self.file = place / "noise.toml"
        self.file.write_text(TEXT)
        self.out = place / "noise"
        self.out.mkdir()
        self.sound = {}

    def start(self):
        """A run of its command."""
        self.before = {phase: self.signs(phase) for phase in ("cells", "page")}
        words = [sys.executable, *self.command, "study", str(self.file)]
        return subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)

    def signs(self, phase):
        """The files of a phase, of this run or left by earlier ones."""
        return set(self.file.parent.glob(BEGUN[phase]))

    def wait_for(self, phase, running):
        """Whether a run has reached a phase, rather than ended before it."""
        while not self.signs(phase) - self.before.get(phase, set()):
            if running.poll() is not None:
                return False
            time.sleep(LOOK)
        return True

    def seconds(self):
        """Run it to its end; returns the time of each phase on this machine."""
        running, begun = self.start(), {}
        for phase in BEGUN:
            self.wait_for(phase, running)
            begun[phase] = time.monotonic()
        self.ended(running)
        ends = [*list(begun.values())[1:], time.monotonic()]
        return {phase: end - begun[phase] for phase, end in zip(BEGUN, ends, strict=True)}

    def killed(self, phase, after):
        """Whether a run was killed so many seconds after a phase had begun; it may also have ended before."""
        running = self.start()
        if self.wait_for(phase, running):
            time.sleep(after)
            running.kill()
        _, said = running.communicate()
        assert running.returncode in (0, -9), said
        self.look()
        return running.returncode == -9

    def ended(self, running):
        """Check that a run that is not killed succeeds, and leaves nothing half written."""
        _, said = running.communicate()
        assert running.returncode == 0, said
        self.look()
        assert len(self.sound) == CELLS_OF_ALL
        assert not list(self.out.rglob(".*"))
        assert not list(self.out.rglob("*.part"))

    def look(self):
        """Check that all earlier cells are unchanged byte for byte, and that all cells are complete."""
        there = {path.name: path.read_bytes() for path in self.out.glob(f"{CELLS}/*.parquet")}
        lost = [name for name, content in self.sound.items() if there.get(name) != content]
        assert not lost, f"{lost} are lost"
        if there:
            store, cells = (
                Store(self.out / CELLS),
                {f"{cell.key}.parquet": cell for cell in Study.load(self.file).cells},
            )
            assert all(store.read(cells[name]) is not None for name in there)
            assert not store.aside.exists()
        self.sound = there

    def tables(self):
        """All tables as bytes, except that of the timings."""
        return {name: (self.out / f"{name}.parquet").read_bytes() for name in TABLES if name != "cost"}


def campaign(place, kills, seed, command=COMMAND):
    """Kill studies so many times; raises AssertionError if anything is lost.  Returns the number in each phase."""
    warm = place / "warm.toml"
    warm.write_text(TEXT.replace("20_000", "64"))
    assert CliRunner().invoke(main, ["study", str(warm)]).exit_code == 0  # compiles
    draw, done, whole = random.Random(seed), Counter(), Life(place / "whole", command)
    seconds = whole.seconds()
    for number in range(2 * kills):  # enough, even if every other run ends before it is killed
        life = Life(place / str(number), command)
        for phase in LIFE:
            if phase == "cells" and len(life.sound) == CELLS_OF_ALL:
                continue
            killed = life.killed(phase, draw.uniform(0.0, seconds[phase]))
            done[phase] += killed
            if not killed:  # faster than the one that was timed
                seconds = Life(place / f"timed-{number}", command).seconds()
            if not killed or done.total() == kills:
                break
        life.ended(life.start())
        assert life.tables() == whole.tables()
        if done.total() == kills:
            return done
    raise AssertionError(f"only {done} runs could be killed")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        print(campaign(Path(folder), int(sys.argv[1]), seed=13))
