"""Entries that are no regular files, or have no end: nothing hangs, nothing fills the memory."""

import os
import socket
import threading
import time
from contextlib import chdir

import pytest
from commands import study
from studies import CELLS_FOLDER, LOG_FILE, Runner, Store, run

from rattle import Scene, Study
from rattle.compare.report.manifest import read_settings
from rattle.scene import FileError, OutputError
from rattle.scene import files as module

HUGE = 10 * 2**30


def make_sparse(path):
    with path.open("wb") as file:
        file.truncate(HUGE)


def make_socket(path):
    """From its own folder, for the path of a socket may not be long."""
    with chdir(path.parent), socket.socket(socket.AF_UNIX) as bound:
        bound.bind(path.name)


ENDLESS = {
    "pipe": os.mkfifo,
    "zero": lambda path: path.symlink_to("/dev/zero"),
    "sparse": make_sparse,
    "socket": make_socket,
    "loop": lambda path: path.symlink_to(path),
}


@pytest.fixture
def wanted():
    return Study.from_toml(study())


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / CELLS_FOLDER)


@pytest.mark.parametrize("kind", ENDLESS)
def test_such_a_cell_is_replaced(kind, wanted, store):
    """As a damaged cell is; it does not count as stored."""
    run(wanted.cells, store, Runner(1))
    first = wanted.cells[0]
    store.path(first).unlink()
    ENDLESS[kind](store.path(first))
    assert store.missing(wanted.cells) == ([] if kind == "sparse" else [first])
    assert run(wanted.cells, store, Runner(1)).computed == 1
    assert store.path(first).is_file()


@pytest.mark.usefixtures("no_work")
def test_a_folder_in_place_of_a_cell_is_refused_before_any_work(wanted, store):
    store.path(wanted.cells[-1]).mkdir()
    with pytest.raises(OutputError, match="is a folder in place of a result; remove it"):
        run(wanted.cells, store, Runner(1))


@pytest.mark.parametrize("kind", ["pipe", "zero"])
def test_such_a_lock_is_not_waited_for(kind, wanted, store):
    """The name of its holder is read from a regular file only."""
    lock = store.folder / "locks" / wanted.cells[0].key
    ENDLESS[kind](lock)
    if kind == "pipe":
        assert store.obtain(wanted.cells[0]) is not None
    else:
        with pytest.raises(OutputError, match="cannot be written"):
            store.obtain(wanted.cells[0])


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("kind", ENDLESS)
def test_such_a_log_is_refused_before_any_work(kind, wanted, store, tmp_path):
    ENDLESS[kind](tmp_path / LOG_FILE)
    said = r"study.log': exists and is not|study.log': .*choose another place"
    with pytest.raises(OutputError, match=said):
        run(wanted.cells, store, Runner(1))


@pytest.mark.parametrize("kind", ENDLESS)
@pytest.mark.parametrize("reader", [Scene.load, Study.load, read_settings])
def test_such_a_file_that_a_user_names(kind, reader, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "PIPE_PATIENCE", 0.05)
    monkeypatch.setattr(module, "MOST_BYTES", 2**20)
    path = tmp_path / "file"
    ENDLESS[kind](path)
    with pytest.raises(FileError, match=r"cannot be read \(|has more than"):
        reader(path)


@pytest.mark.parametrize("late", ["opened late", "written late"])
def test_a_scene_may_come_through_a_pipe(late, tmp_path, monkeypatch):
    """Whoever writes may take its time: before the patience ends it has to be there, not to have
    written."""
    monkeypatch.setattr(module, "PIPE_PATIENCE", 60.0 if late == "opened late" else 0.05)
    scene = Scene(alpha=1.0, epsilon=0.5, beta1=0.1, gamma1=0.1, stages=1)
    if late == "opened late":
        os.mkfifo(path := tmp_path / "pipe")
        descriptor = path
    else:
        reading, descriptor = os.pipe()
        path = f"/dev/fd/{reading}"

    def write():
        time.sleep(0.2)
        with open(descriptor, "w") as pipe:
            pipe.write(scene.to_toml())

    writer = threading.Thread(target=write)
    writer.start()
    assert Scene.load(path) == scene
    writer.join()
