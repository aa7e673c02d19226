"""A study whose folder is full, read-only, damaged, newer, shared, or whose clock goes
backwards."""

import shutil
import subprocess

import pytest
from commands import rattle, study
from small_disks import disk
from studies import CELLS_FOLDER, Runner, Store, run

from rattle import Study, load_study
from rattle.compare.report.save import MANIFEST
from rattle.compare.study.folder import is_current
from rattle.scene import FileError, OutputError

NOISE_STUDY = study("noise", impacts=2, paths=1024, sigma=(0.01, 0.02))


@pytest.fixture
def file(tmp_path):
    (tmp_path / "noise.toml").write_text(NOISE_STUDY)
    return tmp_path / "noise.toml"


@pytest.fixture(scope="module")
def once(tmp_path_factory):
    """A finished study, to be copied."""
    file = tmp_path_factory.mktemp("once") / "noise.toml"
    file.write_text(NOISE_STUDY)
    rattle(f"study {file}")
    return file.with_suffix("")


@pytest.fixture
def finished(file, once):
    return shutil.copytree(once, file.with_suffix(""))


def test_a_disk_that_fills_while_cells_are_written(tmp_path):
    wanted = Study.from_toml(study(impacts=2, paths=1024, sigma=(0.01, 0.02, 0.03, 0.04, 0.05)))
    with disk(tmp_path / "disk", "250k") as place:
        store = Store(place / CELLS_FOLDER)
        with pytest.raises(OutputError, match="the disk is full"):
            run(wanted.cells, store, Runner(1))
        kept = len(wanted.cells) - len(store.missing(wanted.cells))
        assert 0 < kept < 10
        assert not list(store.folder.glob(".*.part"))
        subprocess.run(["mount", "-o", "remount,size=20m", place], check=True)
        assert run(wanted.cells, store, Runner(1)).computed == 10 - kept


def test_a_disk_that_fills_while_the_page_is_written(file, tmp_path):
    """All cells are kept, no file of the page is half written, and with free space the command need
    not recompute."""
    with disk(tmp_path / "disk", "250k") as place:
        found = rattle(f"study {file} --out {place / 'noise'}", code=2)
        assert "all results stored: make room and repeat the command" in found.output
        assert len(list((place / "noise" / CELLS_FOLDER).glob("*.parquet"))) == 4
        assert not (place / "noise" / MANIFEST).exists()
        assert not list((place / "noise").glob(".*"))
        with pytest.raises(FileError, match="holds no finished study"):
            load_study(place / "noise")
        subprocess.run(["mount", "-o", "remount,size=20m", place], check=True)
        said = rattle(f"study {file} --out {place / 'noise'}").output
        assert "0 results computed, 4 stored" in said
        assert len(load_study(place / "noise").errors) == 2 * 2 * 2 * 4


@pytest.mark.parametrize("name", ["errors.parquet", "study.html", "study.md", "manifest.json"])
def test_a_damaged_page_is_seen(file, finished, name):
    wanted = Study.load(file)
    assert is_current(wanted, finished)
    content = (finished / name).read_bytes()
    (finished / name).write_bytes(content[:-1] + b"?")
    assert not is_current(wanted, finished)
    if name == "errors.parquet":
        with pytest.raises(FileError, match=r"errors.parquet is damaged; run rattle study again"):
            load_study(finished)


def test_a_damaged_page_is_written_again_from_its_cells(file, finished):
    whole = (finished / "errors.parquet").read_bytes()
    (finished / "errors.parquet").write_bytes(whole[:-20])
    assert "0 results computed, 4 stored" in rattle(f"study {file}").output
    assert (finished / "errors.parquet").read_bytes() == whole
    assert "All 4 results are stored" in rattle(f"study {file}").output
