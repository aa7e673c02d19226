"""Each command under each fault: it ends with one line that names the remedy, and leaves nothing
half written."""

import json
import signal

import pytest
from commands import rattle, study
from programs import python, start
from small_disks import disk, make_read_only

WRITERS = {
    "validate": (
        "--paths 600 --impacts 2 --dt 0.01 --no-validity --sigma 0.1 --closure saltation --out"
    ),
    "tradeoff": "--out",
    "chaos": "--no-sweep --out",
    "check claims": "--out",
}
"""Commands that write a report folder, by way of `rattle.compare.report.folder.whole_folder` alone.
"""


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("command", WRITERS)
def test_no_room_is_said_before_any_work(command, tmp_path):
    with disk(tmp_path / "disk", "64k") as place:
        words = f"{command} {WRITERS[command]} {place / 'report'}"
        assert "MB are free there; make room" in rattle(words, code=2).stderr
        make_read_only(place)
        assert "cannot be written; choose another place" in rattle(words, code=2).stderr
        assert not any(place.iterdir())


def test_the_table_of_simulate_on_a_full_disk(tmp_path):
    """The results are printed, and the earlier table is whole."""
    words = "simulate --paths 100 --impacts 2 --dt 0.01 --out"
    with disk(tmp_path / "disk", "8k") as place:
        table = place / "table.csv"
        table.write_text("impact,tau: old")
        (place / "filler").write_bytes(b"x" * 4096)
        done = rattle(f"{words} {table}", code=2)
        assert "100 paths" in done.stdout
        assert "the disk is full" in done.stderr
        assert table.read_text() == "impact,tau: old"
        assert {path.name for path in place.iterdir()} == {"filler", "table.csv"}
        make_read_only(place)
        assert "cannot be written" in rattle(f"{words} {table}", code=2).stderr
    assert "is not a file" in rattle(f"{words} {tmp_path}", code=2).stderr


AT_WORK = """
from rattle.compare.cli.main import main
from rattle.scene import progress

progress.QUIET = progress.BETWEEN = progress.LINE_TICK = 0.005
main({words})
"""
LONG_COMMANDS = {
    "validate --paths 100000000": "of 100,000,000 paths",
    "study study.toml": "of 4 cells",
    "chaos": "exponents: ",
}
"""What each says while it is at work."""


@pytest.mark.parametrize("command", LONG_COMMANDS)
def test_an_interrupt_ends_a_command_soon(command, tmp_path, monkeypatch):
    """Only the cells of a study are left."""
    (tmp_path / "study.toml").write_text(study(impacts=2, paths=50_000_000, sigma=(0.1, 0.2)))
    monkeypatch.chdir(tmp_path)
    with start("-c", AT_WORK.format(words=command.split())) as running:
        for said in running.stderr:
            if LONG_COMMANDS[command] in said:
                running.send_signal(signal.SIGINT)
                break
        _, last = running.communicate()
    assert running.returncode == 130, last
    assert last.count("rattle: interrupted") == 1
    assert "Traceback" not in last
    assert {path.name for path in tmp_path.iterdir()} <= {"study.toml", "study"}


@pytest.mark.usefixtures("undrawn")
def test_manifests_that_cannot_be_repeated(tmp_path):
    rattle(f"validate {WRITERS['validate']} {tmp_path / 'report'}")
    text = (tmp_path / "report" / "manifest.json").read_text()
    data = json.loads(text)
    changed = json.dumps(data | {"settings": data["settings"] | {"paths": 3}})
    del data["seal"]  # as an earlier version wrote it
    foreign = "is no manifest of this version"
    for content, said in (
        (changed, "was changed after it was written"),
        (text[: len(text) // 2], foreign),
        ("", foreign),
        ("[1]", foreign),
        (json.dumps(data | {"version": 2}), "comes from a newer version of rattle"),
    ):
        (tmp_path / "manifest.json").write_text(content)
        words = f"validate --repeat {tmp_path / 'manifest.json'}"
        assert said in rattle(words, code=2).stderr
    assert data["version"] == 1


ENDING = """
import os, signal
from rattle.compare.cli.main import main

def interrupted(*_, **__):
    os.kill(os.getpid(), signal.SIGINT)
    for _ in range(10**8): pass

import {module}
{module}.{function} = interrupted
main({words})
"""
STORED = "run the same command again to continue"
NO_PAGE = f"2 of 2 results stored, but their page is not written; {STORED}"


def interrupt(function, words, folder):
    """The last line of a command that is interrupted in a function."""
    module, _, name = f"rattle.{function}".rpartition(".")
    code = ENDING.format(module=module, function=name, words=words.split())
    return python("-c", code, code=130, cwd=folder).stderr.splitlines()[-1]


@pytest.mark.parametrize(
    ("function", "said"),
    [
        ("compare.study.folder.write_page", NO_PAGE),
        ("compare.engine.run.run", f"0 of 2 results stored; {STORED}"),
        ("compare.cli.study.say_lines", "all 2 results are stored, and their page is written"),
    ],
)
def test_an_interrupted_study_says_what_is_stored(function, said, tmp_path):
    (tmp_path / "s.toml").write_text(study())
    assert interrupt(function, "study s.toml", tmp_path) == f"rattle: interrupted; {said}"
    assert (tmp_path / "s" / "study.html").exists() == ("page is written" in said)


def test_an_interrupted_search_says_what_is_stored(tmp_path):
    """Cells that are kept beside the folder of the report; without a folder nothing is kept."""
    words = "boundary --impacts 1 --width 0.9 --over sigma=0.01:0.02:2"
    said = interrupt("compare.parameters.page.make_report", f"{words} --out b", tmp_path)
    stored = len(list((tmp_path / "b-cells").glob("*.parquet")))
    assert stored
    assert said == f"rattle: interrupted; {stored} results stored in b-cells; {STORED}"
    said = interrupt("compare.parameters.search.find_changes", f"{words} --json", tmp_path)
    assert said == "rattle: interrupted; nothing was written"


TWICE = """
from rattle.compare.cli.main import main

@main.command()
def load():
    import os, signal
    try:
        os.kill(os.getpid(), signal.SIGINT)
        for _ in range(1000): pass
    finally:
        os.kill(os.getpid(), signal.SIGINT)
        for _ in range(1000): pass
        open("cleaned", "w").close()

main(["load"])
"""


def test_a_second_interrupt_does_not_stop_the_cleaning_up(tmp_path):
    done = python("-c", TWICE, code=130, cwd=tmp_path)
    assert done.stderr.count("\n") == 1
    assert (tmp_path / "cleaned").exists()
