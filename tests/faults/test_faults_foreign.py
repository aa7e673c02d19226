"""What this project did not make is never replaced, continued or deleted, whatever it is called, by
any command."""

import shutil
import subprocess

import pytest
from commands import manifest_of, rattle, study
from places import ROOT
from studies import CELLS_FOLDER, LOG_FILE
from test_faults_commands import WRITERS

SMALL_STUDY = study(paths=64)
COMMITTED = ROOT / "reports"
THEIRS = {
    "study.toml": study(title="their own"),
    "errors.parquet": "precious",
    "manifest.json": '{"my": 1}',
    "page.json": "[]",
    "study.html": "<p>",
    LOG_FILE: "my log\n",
    f"{CELLS_FOLDER}/mine": "1",
    "figures/errors.svg": "<svg/>",
    "validity.csv": "a,b\n",
}


def place(folder, name, text):
    """Put a file of others into a folder."""
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text)


def everything(folder):
    """All files in a folder with their content."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture
def file(tmp_path):
    (tmp_path / "noise.toml").write_text(SMALL_STUDY)
    return tmp_path / "noise.toml"


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("name", THEIRS)
def test_a_study_replaces_nothing_of_others(file, tmp_path, name):
    place(out := tmp_path / "p", name, THEIRS[name])
    before = everything(out)
    for option in ("", "--overwrite"):
        said = rattle(f"study {file} --out {out} {option}", code=2).stderr
        assert name.split("/")[-1] in said or name.split("/")[0] in said
        assert "choose another" in said
        assert everything(out) == before


def test_a_study_leaves_what_it_does_not_write_and_continues_its_own(file, tmp_path):
    """Beside notes and its own study file; interrupted before there was a page, finished, and with
    a value added."""
    place(out := tmp_path / "p", "notes.txt", "mine")
    own = shutil.copy(file, out / "study.toml")
    rattle(f"study {own} --out {out}")
    (out / "manifest.json").unlink()
    assert "0 results computed" in rattle(f"study {own} --out {out}").stderr
    assert "page is up to date" in rattle(f"study {own} --out {out}").stderr
    file.write_text(study(paths=64, sigma=(0.1, 0.2)))
    assert "4 stored" in rattle(f"study {file} --out {out}").stderr
    assert (out / "notes.txt").read_text() == "mine"


def test_another_study_replaces_the_tables_of_the_first_only_if_asked_to(file, tmp_path):
    rattle(f"study {file}")
    before = everything(out := tmp_path / "noise")
    other = tmp_path / "other.toml"
    other.write_text(study(title="other", sigma=(0.3,), paths=64))
    said = rattle(f"study {other} --out {out}", code=2).stderr
    remedy = "choose another folder, or overwrite it (--overwrite)"
    assert f"holds another study (small); {remedy}" in said
    assert everything(out) == before
    rattle(f"study {other} --out {out} --overwrite")
    assert manifest_of(out)["title"] == "other"


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("command", WRITERS)
@pytest.mark.parametrize("name", ["manifest.json", "page.json", "figures/mine.svg", "notes.txt"])
def test_a_report_replaces_nothing_of_others(command, name, tmp_path):
    """Not even with --overwrite, and beside a report."""
    out = tmp_path / "out"
    if name == "notes.txt":
        shutil.copytree(COMMITTED / "chaos", out)
    place(out, name, '{"my": 1}')
    before = everything(out)
    said = rattle(f"{command} --overwrite {WRITERS[command]} {out}", code=2).stderr
    assert "holds other things" in said
    assert everything(out) == before


SIMULATE = "simulate --paths 64 --impacts 1 --out"


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("make", ["cp theirs", "ln -s theirs", "ln -s nowhere", "mkfifo"])
def test_the_table_of_simulate_replaces_nothing_of_others(make, tmp_path):
    """Its own earlier table and an empty file are replaced, as a program of `mktemp` makes one."""
    (tmp_path / "theirs").write_text("time,impact\n")
    out = tmp_path / "out.csv"
    subprocess.run([*make.split(), out.name], cwd=tmp_path, check=True)
    kind = out.lstat()
    rattle(f"{SIMULATE} {out}", code=2)
    assert out.lstat() == kind
    assert (tmp_path / "theirs").read_text() == "time,impact\n"


def test_the_table_of_simulate_replaces_its_own(tmp_path):
    (out := tmp_path / "out.csv").touch()
    for _ in range(2):
        rattle(f"{SIMULATE} {out}")
        assert out.read_text().startswith("impact,tau")


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("name", [LOG_FILE, f"{CELLS_FOLDER}/mine"])
def test_a_command_keeps_no_cells_among_files_of_others(name, tmp_path):
    place(tmp_path / "out-cells", name, "theirs")
    said = rattle(f"chaos --no-sweep --out {tmp_path / 'out'}", code=2).stderr
    assert "is not a log of rattle" in said or "holds other things (mine)" in said
    assert everything(tmp_path) == {f"out-cells/{name}": b"theirs"}
