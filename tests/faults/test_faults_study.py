"""A study whose folder is full, read-only, damaged, newer, shared, or whose clock goes backwards."""

import itertools
import json
import shutil
import subprocess
import time

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from small_disks import disk, make_read_only

from rattle.compare.cli.main import main
from rattle.compare.study.current import is_current
from rattle.compare.study.design import Study
from rattle.compare.study.engine import run
from rattle.compare.study.executors import Here
from rattle.compare.study.figures import FIGURES
from rattle.compare.study.obtain import read_stored
from rattle.compare.study.store import NAME, Store, with_seal
from rattle.compare.study.tables import CELLS, MANIFEST, load_study
from rattle.scene import FileError

TEXT = """
[study]
title = "{title}"
impacts = 2
closures = ["corrected"]
paths = 1024

[scene]
alpha = 1.5
epsilon = 0.9
beta1 = 0.083
gamma1 = 0.057
stages = 1

[[axes]]
sigma = [0.01, 0.02]
"""


def rattle(*words, code=0):
    found = CliRunner().invoke(main, [str(w) for w in words])
    assert found.exit_code == code, found.output
    assert "Traceback" not in found.output
    return found


@pytest.fixture
def file(tmp_path):
    (tmp_path / "noise.toml").write_text(TEXT.format(title="noise"))
    return tmp_path / "noise.toml"


@pytest.fixture(scope="module", autouse=True)
def few_figures():
    """Draw one figure instead of seven, as drawing takes most of a small study's time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rattle.compare.study.page.FIGURES", dict([*FIGURES.items()][:1]))
        yield


@pytest.fixture(scope="module")
def once(tmp_path_factory):
    """A finished study, to be copied."""
    file = tmp_path_factory.mktemp("once") / "noise.toml"
    file.write_text(TEXT.format(title="noise"))
    rattle("study", file)
    return file.with_suffix("")


@pytest.fixture
def finished(file, once):
    return shutil.copytree(once, file.with_suffix(""))


# --- full and read-only


def test_a_disk_that_fills_while_the_page_is_written(file, tmp_path):
    """All cells are kept, no file of the page is half written, and with free space the command need not recompute."""
    with disk(tmp_path / "disk", "250k") as place:
        found = rattle("study", file, "--out", place / "noise", code=2)
        assert "all results stored: make room and repeat the command" in found.output
        assert len(list((place / "noise" / CELLS).glob("*.parquet"))) == 4
        assert not (place / "noise" / MANIFEST).exists()
        assert not list((place / "noise").glob(".*"))
        with pytest.raises(FileError, match="holds no finished study"):
            load_study(place / "noise")
        subprocess.run(["mount", "-o", "remount,size=20m", place], check=True)
        assert "0 cells computed, 4 there" in rattle("study", file, "--out", place / "noise").output
        assert len(load_study(place / "noise").errors) == 2 * 2 * 2 * 4


def test_a_disk_without_room_for_a_single_file(file, tmp_path):
    with disk(tmp_path / "disk", "8k") as place:
        (place / "filler").write_bytes(b"x" * 8192)
        found = rattle("study", file, "--out", place / "noise", code=2)
        assert "out = " in found.output


def test_a_log_that_cannot_grow_stops_nothing(file, tmp_path, capfd):
    with disk(tmp_path / "disk", "40k") as place:
        rattle("study", file, "--out", place / "noise", code=2)
    assert "Logging error" not in capfd.readouterr().err


def test_a_finished_study_on_a_read_only_disk_shows_its_result(file, finished, tmp_path):
    words = ("study", file, "--out", tmp_path / "disk" / "noise")
    with disk(tmp_path / "disk", "20m") as place:
        shutil.copytree(finished, place / "noise")
        whole = rattle(*words)
        make_read_only(place)
        shown = rattle(*words)
        assert shown.stdout == whole.stdout
        assert shown.stderr == whole.stderr == "All 4 results are stored, and the page is up to date.\n"
        assert json.loads(rattle(*words, "--json").stdout)["complete"]
        assert "4 cells, 0 to compute" in rattle(*words, "--explain").stdout
        assert "4 of 4 results stored" in rattle(*words, "--status").stdout
        assert len(load_study(place / "noise").errors) == 32


def test_what_a_finished_study_lacks_on_a_read_only_disk_is_said(file, finished, tmp_path):
    words = ("study", file, "--out", tmp_path / "disk" / "noise")
    answer = rattle("study", file).stdout.splitlines()
    with disk(tmp_path / "disk", "20m") as place:
        shutil.copytree(finished, place / "noise")
        (place / "noise" / "study.toml").write_text("")
        make_read_only(place)
        shown = rattle(*words)
        assert "study.toml': cannot be written (Read-only file system)" in shown.stderr
        assert shown.stdout.splitlines()[:-1] == answer[:-1]
        subprocess.run(["mount", "-o", "remount,rw", place], check=True)
        (place / "noise" / MANIFEST).unlink()  # so the page cannot be assigned to the study
        make_read_only(place)
        shown = rattle(*words)
        assert "cannot be written" in shown.stderr
        assert shown.stderr.endswith("all results stored; the page could not be written\n")
        assert shown.stdout.splitlines() == answer[:-1]
        subprocess.run(["mount", "-o", "remount,rw", place], check=True)
        next((place / "noise" / CELLS).glob("*.parquet")).unlink()
        make_read_only(place)
        assert "cannot be written" in rattle(*words, code=2).output


# --- damaged and newer


DAMAGE = {"truncated": lambda b: b[: len(b) // 2], "empty": lambda b: b"", "flipped": lambda b: b[:9] + b"?" + b[10:]}


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("name", ["errors.parquet", "study.html", "page.json", "manifest.json"])
def test_a_damaged_page_is_seen(file, finished, name, damage):
    study = Study.load(file)
    assert is_current(study, finished)
    content = (finished / name).read_bytes()
    (finished / name).write_bytes(DAMAGE[damage](content))
    assert not is_current(study, finished) or (name == "manifest.json" and damage == "flipped")
    if name == "errors.parquet":
        with pytest.raises(FileError, match=r"errors.parquet is damaged; run rattle study again"):
            load_study(finished)


def test_a_damaged_page_is_written_again_from_its_cells(file, finished):
    whole = (finished / "errors.parquet").read_bytes()
    (finished / "errors.parquet").write_bytes(whole[:-20])
    assert "0 cells computed, 4 there" in rattle("study", file).output
    assert (finished / "errors.parquet").read_bytes() == whole
    assert "All 4 results are stored" in rattle("study", file).output


def test_a_folder_of_a_newer_version_says_so(finished):
    record = json.loads((finished / MANIFEST).read_text())
    (finished / MANIFEST).write_text(json.dumps(record | {"version": 2}))
    with pytest.raises(FileError, match=r"newer version of rattle .manifest 2; this one reads 1.; update rattle"):
        load_study(finished)


def test_a_page_of_another_study_is_not_taken_for_ours(file, finished):
    """Two studies in one folder: tables and the study beside them are always of the same one."""
    other = file.with_name("other.toml")
    other.write_text(TEXT.format(title="other"))
    rattle("study", other, "--out", finished)
    assert load_study(finished).study.title == "other"
    assert load_study(finished).record["title"] == "other"
    assert "0 cells computed" in rattle("study", file).output
    assert load_study(finished).study.title == "noise"


# --- results that somebody else has made


def hostile(table, key, facts, record=None):
    """The table of a cell file with whatever is in it."""
    content = pa.Table.from_pandas(table)
    text = json.dumps({"key": key, "facts": facts}) if record is None else record
    return content.replace_schema_metadata({**content.schema.metadata, NAME: text.encode()})


PLAIN = pd.DataFrame({"tau": [0.5, 1.0]})
HOSTILE = {
    "facts no table": lambda key: hostile(PLAIN, key, ["seconds"]),
    "seconds no number": lambda key: hostile(PLAIN, key, {"seconds": {"a": 1}, "paths": 2}),
    "other columns": lambda key: hostile(PLAIN, key, {"seconds": 1.0}),
    "no rows": lambda key: hostile(PLAIN.iloc[:0].astype(object), key, {}, f'{{"key": "{key}", "facts": {{}}}}'),
    "record a list": lambda key: hostile(PLAIN, key, {}, "[1, 2]"),
    "record a number": lambda key: hostile(PLAIN, key, {}, "3"),
    "nested deeply": lambda key: hostile(PLAIN, key, {}, "[" * 100_000),
    "huge": lambda key: hostile(PLAIN, key, {"seconds": 1.0, "more": "x" * 3_000_000}),
    "no metadata": lambda key: pa.table({"tau": [0.5]}),
    "bomb": lambda key: pa.table({"tau": pa.chunked_array([pa.array([0.0] * 100_000)] * 20)}),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_what_is_no_result_is_set_aside(case, tmp_path, monkeypatch):
    """Anybody with access to the folder can write a valid seal; the content is still validated, and is only data."""
    monkeypatch.setattr("rattle.compare.study.store.MOST_VALUES", 1_000_000)
    study, store = Study.from_toml(TEXT.format(title="noise")), Store(tmp_path / CELLS)
    cell = study.cells[0]
    pq.write_table(HOSTILE[case](cell.key), store.path(cell.key), compression="zstd")
    store.path(cell.key).write_bytes(with_seal(store.path(cell.key).read_bytes()))
    assert store.path(cell.key).stat().st_size < (8_000_000 if case == "huge" else 300_000)
    assert read_stored(store, cell) is None
    assert not store.path(cell.key).exists()
    (note,) = store.aside.glob("*.txt")
    assert len(note.read_text()) < 400
    assert run(study, store, Here(1)).computed == 4


@pytest.mark.parametrize("name", ["cells", "figures", "study.log", "locks", "set-aside"])
def test_links_out_of_the_folder_are_refused(file, tmp_path, name):
    """Links in a shared folder cannot redirect writes."""
    elsewhere, out = tmp_path / "elsewhere", tmp_path / "noise"
    elsewhere.mkdir()
    place = out / CELLS / name if name in ("locks", "set-aside") else out / name
    place.parent.mkdir(parents=True)
    target = elsewhere / "log" if name == "study.log" else elsewhere
    place.symlink_to(target)
    found = rattle("study", file, code=2)
    assert "link" in found.output
    assert not list(elsewhere.iterdir())


# --- clocks


def test_a_clock_that_goes_backwards(file, finished, tmp_path, monkeypatch):
    """Progress, estimates, locks and the log tolerate it, and the numbers are the same."""
    now, steps = time.time(), itertools.count()

    def backwards():
        return now - 5.0 * next(steps)

    monkeypatch.setattr(time, "time", backwards)
    monkeypatch.setattr("tqdm.std.time", backwards)
    rattle("study", file, "--out", tmp_path / "back")
    rattle("show", tmp_path / "back")
    record, before = (json.loads((f / MANIFEST).read_text()) for f in (tmp_path / "back", finished))
    assert record["errors_sha256"] == before["errors_sha256"]
    assert 0.0 < record["wall_seconds"] < 300.0
    log = (tmp_path / "back" / "study.log").read_text()
    assert log.count(" done ") == 4
    stamps = [line[:23] for line in log.splitlines()]
    assert stamps == sorted(stamps, reverse=True)  # it did go backwards
    assert stamps[0] > stamps[-1]


def test_estimates_of_the_time_left_do_not_depend_on_the_clock(tmp_path, monkeypatch):
    from rattle.compare.study.progress import Progress

    study = Study.from_toml(TEXT.format(title="noise"))
    cells = study.cells
    store = Store(tmp_path / CELLS)
    run(study, store, Here(1))
    monkeypatch.setattr(time, "time", lambda: -1e9)
    with Progress({c.key: c for c in cells}, 0, tmp_path, False) as progress:
        for cell in cells[:2]:
            progress.finish(cell, read_stored(store, cell), True)
        assert 0.0 < progress.seconds_left < 60.0
