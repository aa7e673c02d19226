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
from programs import python
from small_disks import disk, make_read_only

WRITERS = {
    "validate": [
        *["--paths", "600", "--impacts", "2", "--dt", "0.01", "--no-validity"],
        *["--sigma", "0.1", "--closure", "saltation"],
    ],
    "tradeoff": [],
    "chaos": ["--no-sweep"],
    "claims": [],
}
"""Commands that write a report folder, by way of `rattle.compare.report.folder.whole_folder` alone.
"""


@pytest.mark.parametrize("command", WRITERS)
def test_no_room_is_said_before_any_work(command, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "rattle.montecarlo.kernel.blocks.run", lambda *_: pytest.fail("paths were followed")
    )
    with disk(tmp_path / "disk", "64k") as place:
        found = rattle(command, *WRITERS[command], "--out", place / "report", code=2)
        assert "MB are free there; make room" in found.stderr
        make_read_only(place)
        found = rattle(command, *WRITERS[command], "--out", place / "report", code=2)
        assert "cannot be written; choose another place" in found.stderr
        assert not any(place.iterdir())


def test_the_table_of_simulate_on_a_full_disk(tmp_path):
    """The results are printed, and the earlier table is whole."""
    words = ["simulate", "--paths", "100", "--impacts", "2", "--dt", "0.01"]
    with disk(tmp_path / "disk", "8k") as place:
        (place / "table.csv").write_text("impact,tau: old")
        (place / "filler").write_bytes(b"x" * 4096)
        found = rattle(*words, "--out", place / "table.csv", code=2)
        assert "100 paths" in found.stdout
        assert "the disk is full" in found.stderr
        assert (place / "table.csv").read_text() == "impact,tau: old"
        assert sorted(p.name for p in place.iterdir()) == ["filler", "table.csv"]
        make_read_only(place)
        assert "cannot be written" in rattle(*words, "--out", place / "table.csv", code=2).stderr
        assert "cannot be written" in rattle(*words, "--out", tmp_path, code=2).stderr


ENDLESS = 600.0  # seconds in which any machine has loaded a library
LONG = {
    "validate": ["--paths", "100000000"],
    "order": ["--paths", "1000000"],
    "study": ["study.toml"],
    "chaos": [],
}


def used(process):
    """Processor seconds of all threads of a process, of /proc/PID/stat: utime and stime."""
    try:
        fields = (
            Path(f"/proc/{process.pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
        )
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def wait_for_work(process, seconds):
    """Wait until a process has used so many more seconds of processor time, or has ended: no busy
    machine fails it."""
    wanted = used(process) + seconds
    while process.poll() is None and used(process) < wanted:
        time.sleep(0.02)


def test_an_interrupt_ends_a_command_soon(tmp_path):
    """One of each kind, started at once and interrupted in turn; only the cells of a study are
    left."""
    running = {}
    said = {}
    for command in LONG:
        place = tmp_path / command
        place.mkdir()
        (place / "study.toml").write_text(study(impacts=2, paths=50_000_000, sigma=(0.1, 0.2)))
        said[command] = tmp_path / f"{command}.txt"
        with said[command].open("wb") as file:
            running[command] = subprocess.Popen(
                [
                    sys.executable,
                    "-X",
                    "importtime",
                    "-m",
                    "rattle.compare.cli.main",
                    *command.split(),
                    *LONG[command],
                ],
                cwd=place,
                stdout=subprocess.DEVNULL,
                stderr=file,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            )
    try:
        for command, process in running.items():
            begun = time.monotonic()
            while not re.search(
                r"\| +json$", said[command].read_text(), re.M
            ):  # loaded by the command itself
                assert process.poll() is None, command
                assert time.monotonic() - begun < ENDLESS, (
                    "json is not loaded any longer: wait for something else"
                )
                time.sleep(0.1)
            process.send_signal(signal.SIGSTOP)
        for command, process in running.items():
            process.send_signal(signal.SIGCONT)
            wait_for_work(process, 0.5)
            assert process.poll() is None, command  # still at work
            process.send_signal(signal.SIGINT)
            process.wait(timeout=60)  # two seconds where the machine has nothing else to do
            lines = [
                x
                for x in said[command].read_text().splitlines()
                if not x.startswith("import time:")
            ]
            assert process.returncode == 130, lines
            assert len([x for x in lines if x.startswith("rattle: interrupted")]) == 1
            assert not any("Traceback" in x for x in lines)
            left = {p.name for p in (tmp_path / command).iterdir()}
            assert left <= {"study.toml"} | ({"study"} if command == "study" else set())
    finally:
        for process in running.values():
            process.kill()
            process.wait()


@pytest.mark.usefixtures("undrawn")
def test_manifests_that_cannot_be_repeated(tmp_path):
    rattle("validate", *WRITERS["validate"], "--out", tmp_path / "report")
    text = (tmp_path / "report" / "manifest.json").read_text()
    data = json.loads(text)
    changed = json.dumps(data | {"settings": data["settings"] | {"paths": 3}})
    del data["seal"]  # as an earlier version wrote it
    bad = {
        "changed": (changed, "was changed after it was written"),
        "truncated": (text[: len(text) // 2], "is no manifest of this version"),
        "empty": ("", "is no manifest of this version"),
        "a list": ("[1]", "is no manifest of this version"),
        "newer": (json.dumps(data | {"version": 2}), "comes from a newer version of rattle"),
    }
    for content, said in bad.values():
        (tmp_path / "manifest.json").write_text(content)
        assert said in rattle("validate", "--repeat", tmp_path / "manifest.json", code=2).stderr
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


@pytest.mark.parametrize(
    ("function", "said"),
    [
        (
            "compare.study.folder.write_page",
            f"2 of 2 results stored, but their page is not written; {STORED}",
        ),
        (
            "compare.study.design.combine",
            f"2 of 2 results stored, but their page is not written; {STORED}",
        ),
        ("compare.engine.run.run", f"0 of 2 results stored; {STORED}"),
        ("compare.cli.study.say_lines", "all 2 results are stored, and their page is written"),
    ],
)
def test_an_interrupted_study_says_what_is_stored(function, said, tmp_path):
    (tmp_path / "s.toml").write_text(study())
    module, _, name = f"rattle.{function}".rpartition(".")
    code = ENDING.format(module=module, function=name, words=["study", "s.toml"])
    done = python("-c", code, code=130, cwd=tmp_path)
    assert done.stderr.splitlines()[-1] == f"rattle: interrupted; {said}"
    assert (tmp_path / "s" / "study.html").exists() == ("page is written" in said)


def test_an_interrupted_search_says_what_is_stored(tmp_path):
    """Cells that are kept beside the folder of the report; without a folder nothing is kept."""
    words = [
        "boundary",
        "--impacts",
        "1",
        "--points",
        "2",
        "--width",
        "0.9",
        "--between",
        "0.01",
        "0.02",
    ]
    code = {"module": "rattle.compare.parameters.page", "function": "make_report"}
    done = python("-c", ENDING.format(words=[*words, "--out", "b"], **code), code=130, cwd=tmp_path)
    stored = len(list((tmp_path / "b-cells").glob("*.parquet")))
    said = f"rattle: interrupted; {stored} results stored in b-cells; {STORED}"
    assert done.stderr.splitlines()[-1] == said
    assert stored
    code = {"module": "rattle.compare.parameters.search", "function": "find_changes"}
    done = python("-c", ENDING.format(words=[*words, "--json"], **code), code=130, cwd=tmp_path)
    assert done.stderr.splitlines()[-1] == "rattle: interrupted; nothing was written"


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
    done = python(
        "-c", TWICE, code=130, cwd=tmp_path, PYTHONPATH=os.pathsep.join(filter(None, sys.path))
    )
    assert done.stderr.count("\n") == 1
    assert (tmp_path / "cleaned").exists()
