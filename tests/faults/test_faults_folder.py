"""Whatever happens while a folder is written, it holds the old report or the new one, and a message
says what to do."""

import random
import time

import pytest
from programs import start
from small_disks import disk

from rattle.compare.report import folder as module
from rattle.compare.report.folder import whole_folder, write_whole
from rattle.scene import OutputError

OURS = frozenset({"one.txt", "two.txt"})
WRITER = """
import sys
from pathlib import Path
from rattle.compare.report.folder import whole_folder
for turn in range(1000000):
    with whole_folder(Path(sys.argv[1]), frozenset({"one.txt", "two.txt"}), True) as inside:
        (inside / "one.txt").write_text(str(turn))
        (inside / "two.txt").write_text(str(turn))
    print(turn, flush=True)
"""


def contents(folder):
    return sorted(p.name for p in folder.iterdir())


def written(out, text, size=1):
    with whole_folder(out, OURS, overwrite=True) as inside:
        (inside / "one.txt").write_text(text)
        (inside / "two.txt").write_text(text * size)


def test_killed_at_any_moment_a_folder_is_old_or_new(tmp_path):
    """Each kill leaves a whole folder, in its place or, between two steps, beside it; the next run
    clears up."""
    out = tmp_path / "report"
    draw = random.Random(1)
    for _ in range(8):
        with start("-c", WRITER, out) as running:
            running.stdout.readline()
            time.sleep(draw.uniform(0.0, 0.02))
            running.kill()
        (there,) = [out] if out.exists() else tmp_path.glob(".report-*.old")
        assert (there / "one.txt").read_text() == (there / "two.txt").read_text()
        written(out, "after")
        assert contents(tmp_path) == ["report"]  # what the killed process left is gone


def test_two_runs_into_one_folder_lose_nothing(tmp_path):
    out = tmp_path / "report"

    def both():
        with whole_folder(out, OURS, overwrite=False) as slow:
            (slow / "one.txt").write_text("slow")
            with whole_folder(out, OURS, overwrite=False) as quick:
                (quick / "one.txt").write_text("quick")

    with pytest.raises(
        OutputError, match=r"taken by another run meanwhile; this report is kept as .*report-2"
    ):
        both()
    assert (out / "one.txt").read_text() == "quick"
    assert (tmp_path / "report-2" / "one.txt").read_text() == "slow"
    assert contents(tmp_path) == ["report", "report-2"]


def test_a_full_disk_keeps_the_old_report(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "BYTES_FREE", 0)
    with disk(tmp_path / "disk", "64k") as place:
        written(place / "report", "old")
        with pytest.raises(OutputError, match=r"disk is full.*make room"):
            written(place / "report", "new", 40_000)
        with pytest.raises(OutputError, match=r"disk is full.*make room"):
            write_whole(place / "one.csv", "new" * 40_000)
        assert contents(place) == ["report"]
        assert (place / "report" / "two.txt").read_text() == "old"
