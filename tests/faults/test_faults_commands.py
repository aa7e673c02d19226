"""Each command under each fault: it ends with one line that names the remedy, and leaves nothing
half written."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from commands import rattle, study
from programs import python, surroundings
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
        assert sorted(path.name for path in place.iterdir()) == ["filler", "table.csv"]
        make_read_only(place)
        assert "cannot be written" in rattle(f"{words} {table}", code=2).stderr
    assert "is not a file" in rattle(f"{words} {tmp_path}", code=2).stderr


ENDLESS = 600.0  # seconds in which any machine has loaded a library
LONG = {
    "validate": "--paths 100000000",
    "check order": "--paths 1000000",
    "study": "study.toml",
    "chaos": "",
}


def used(process):
    """Processor seconds of all threads of a process, of /proc/PID/stat: utime and stime."""
    try:
        text = Path(f"/proc/{process.pid}/stat").read_text(encoding="ascii")
    except OSError:
        return 0.0
    fields = text.rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def wait_for_work(process, seconds):
    """Wait until a process has used so many more seconds of processor time, or has ended: no busy
    machine fails it."""
    wanted = used(process) + seconds
    while process.poll() is None and used(process) < wanted:
        time.sleep(0.02)


def begin(command, place):
    """A command as a process; in `said` it lists what it has loaded."""
    place.mkdir()
    (place / "study.toml").write_text(study(impacts=2, paths=50_000_000, sigma=(0.1, 0.2)))
    words = [sys.executable, "-X", "importtime", "-m", "rattle.compare.cli.main"]
    with place.with_suffix(".txt").open("wb") as said:
        return subprocess.Popen(
            [*words, *command.split(), *LONG[command].split()],
            cwd=place,
            stdout=subprocess.DEVNULL,
            stderr=said,
            env=surroundings({}),
        )


def wait_for_json(process, said):
    """Wait until a command itself has loaded json."""
    begun = time.monotonic()
    while not re.search(r"\| +json$", said.read_text(), re.M):
        assert process.poll() is None
        waited = time.monotonic() - begun
        assert waited < ENDLESS, "json is not loaded any longer: wait for something else"
        time.sleep(0.1)


def test_an_interrupt_ends_a_command_soon(tmp_path):
    """One of each kind, started at once and interrupted in turn; only the cells of a study are
    left."""
    running = {command: begin(command, tmp_path / command) for command in LONG}
    try:
        for command, process in running.items():
            wait_for_json(process, tmp_path / f"{command}.txt")
            process.send_signal(signal.SIGSTOP)
        for command, process in running.items():
            process.send_signal(signal.SIGCONT)
            wait_for_work(process, 0.5)
            assert process.poll() is None, command  # still at work
            process.send_signal(signal.SIGINT)
            process.wait(timeout=60)  # two seconds where the machine has nothing else to do
            text = (tmp_path / f"{command}.txt").read_text()
            lines = [line for line in text.splitlines() if not line.startswith("import time:")]
            assert process.returncode == 130, lines
            assert sum(line.startswith("rattle: interrupted") for line in lines) == 1
            assert "Traceback" not in text
            left = {path.name for path in (tmp_path / command).iterdir()}
            assert left <= {"study.toml"} | ({"study"} if command == "study" else set())
    finally:
        for process in running.values():
            process.kill()
            process.wait()


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
        ("compare.study.design.combine", NO_PAGE),
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
