"""Cells that cannot be computed, permissions of what is written, and what killed processes have
left."""

import os

import pytest
from commands import rattle, study
from small_disks import DEAD, scratch_name
from studies import CELLS_FOLDER, Sample

from rattle import InputError


@pytest.fixture
def file(tmp_path):
    (tmp_path / "s.toml").write_text(study())
    return tmp_path / "s.toml"


def test_a_study_without_a_single_ensemble_says_why(file, monkeypatch):
    """If all cells failed, no page is written."""

    def refused(*_):
        raise InputError("paths", 64, "are too few")

    monkeypatch.setattr(Sample, "compute", refused)
    why = "1 of 2 cells could not be computed (paths = 64: are too few)"
    said = rattle(f"study {file}", code=2).output
    assert f"nothing can be compared yet, {why}" in said


@pytest.mark.parametrize("umask", [0o022, 0o077], ids=oct)
def test_all_that_a_study_writes_may_be_read_by_whom_the_umask_lets(file, umask):
    """Cells, locks, log, tables, page and figures: missing permissions never make results look
    damaged."""
    before = os.umask(umask)
    try:
        rattle(f"study {file}")
    finally:
        os.umask(before)
    out = file.with_suffix("")
    modes = {(path.is_dir(), path.stat().st_mode & 0o777) for path in [out, *out.rglob("*")]}
    assert modes == {(False, 0o666 & ~umask), (True, 0o777 & ~umask)}


def test_what_killed_processes_have_left_is_gone_after_the_next_run(file):
    """Also if killed after the last file was moved into place, when nothing is left to compute or
    to draw."""
    rattle(f"study {file}")
    out = file.with_suffix("")
    for place in (out, out / CELLS_FOLDER):
        (place / scratch_name("rattle", DEAD)).touch()
    (out / scratch_name("page", DEAD) / "figures").mkdir(parents=True)
    assert "All 2 results are stored" in rattle(f"study {file}").output
    assert not list(out.rglob(".*"))
