"""Files of others in a study's folder, entries that are no regular files, and outputs that are not Unicode."""

import os
import stat

import pytest
from click.testing import CliRunner
from commands import rattle, study

from rattle.compare.cli.main import main
from rattle.compare.engine.run import CELLS, LOG, check_log
from rattle.compare.engine.store import Store
from rattle.compare.study.design import Study
from rattle.scene import OutputError

FOREIGN = {
    "study.toml": "# my other study\n",
    "errors.parquet": "precious",
    "sections.parquet": "precious",
    "reasons.csv": "a,b\n",
    "study.html": "<p>mine</p>",
    "manifest.json": '{"my": 1}',
    "study.log": "my own log\n",
    "cells/mine.parquet": "precious",
    "figures/mine.svg": "<svg/>",
}


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "noise.toml"
    path.write_text(study())
    return path


@pytest.mark.parametrize("name", FOREIGN)
def test_a_file_of_others_is_neither_replaced_nor_continued(file, tmp_path, name):
    mine = tmp_path / "mine" / name
    mine.parent.mkdir(parents=True)
    mine.write_text(FOREIGN[name])
    found = rattle("study", file, "--out", tmp_path / "mine", code=2)
    assert name.split("/")[0] in found.output
    assert "choose another" in found.output
    assert mine.read_text() == FOREIGN[name]
    assert [path for path in (tmp_path / "mine").rglob("*") if path.is_file()] == [mine]


def test_another_study_is_replaced_only_where_that_is_asked_for(file, tmp_path):
    rattle("study", file)
    other = tmp_path / "other.toml"
    other.write_text(study(sigma=(0.3,), title="another"))
    found = rattle("study", other, "--out", tmp_path / "noise", code=2)
    assert "holds another study" in found.output
    rattle("study", other, "--out", tmp_path / "noise", "--overwrite")
    assert (tmp_path / "noise" / "study.toml").read_text() == other.read_text()
    more = study(sigma=(0.3, 0.4), title="another")  # has cells in common: an edit of one's own
    other.write_text(more)
    rattle("study", other, "--out", tmp_path / "noise")


@pytest.mark.parametrize(
    "command", ["validate", "stationary", "boundary", "sensitivity", "tradeoff", "chaos", "claims", "check stability"]
)
def test_every_report_leaves_a_manifest_of_others_alone(tmp_path, command):
    mine = tmp_path / "manifest.json"
    mine.write_text('{"my": 1}')
    found = rattle(*command.split(), "--out", tmp_path, "--overwrite", code=2)
    assert "holds other things (manifest.json)" in found.output
    assert mine.read_text() == '{"my": 1}'


@pytest.mark.parametrize("command", ["simulate", "animate", "init"])
def test_every_file_of_others_is_left_alone(tmp_path, command):
    mine = tmp_path / "mine.html"
    mine.write_text("<p>mine</p>")
    words = {
        "simulate": ["simulate", "--out", mine, "--paths", 8, "--impacts", 1],
        "animate": ["animate", "--out", mine, "--overwrite"],
        "init": ["init", mine],
    }
    rattle(*words[command], code=2)
    assert mine.read_text() == "<p>mine</p>"


def make(kind, path):
    """Something that is no result, in the place of one."""
    if kind == "a pipe":
        os.mkfifo(path)
    elif kind == "an endless device":
        path.symlink_to("/dev/zero")
    else:
        with path.open("wb") as file:
            file.truncate(10 * 2**30)  # sparse: takes no room


@pytest.mark.parametrize("kind", ["a pipe", "an endless device", "a sparse file"])
def test_an_entry_that_is_no_result_is_computed_again(tmp_path, kind):
    wanted = Study.from_toml(study())
    store = Store(tmp_path / CELLS)
    cell = wanted.cells[0]
    make(kind, store.path(cell))
    assert store.read(cell) is None
    assert store.obtain(cell) is not None
    assert stat.S_ISREG(store.path(cell).lstat().st_mode)
    assert store.path(cell).stat().st_size < 2**20


@pytest.mark.parametrize("kind", ["a pipe", "an endless device"])
def test_a_log_that_is_no_file_is_refused(tmp_path, kind):
    make(kind, tmp_path / LOG)
    with pytest.raises(OutputError, match="is not a file"):
        check_log(tmp_path)


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "latin-1"])
def test_what_an_output_cannot_show_is_replaced(file, encoding):
    text = study().replace('title = "small"', 'title = "σ → ∞"')
    file.write_text(text, encoding="utf-8")
    found = CliRunner(charset=encoding).invoke(main, ["study", str(file), "--explain"])
    assert found.exit_code == 0, found.output
    assert "2 to compute" in found.output
