"""Measure what each command takes by default on the gear sets of an engineer, in processor seconds
of all processes, and when `assess` gives its first answer.

``python docs/results/measure_engineers.py`` writes docs/results/engineers.csv (about an hour
on one core for all sets).  Five gear sets in docs/results/engineers/ are made up with values in
published ranges: a car's loose gear at idle, a truck's power take-off, an electric drive, a soft
pair, and one that never rattles.  Ten are drawn at random (draw_engineers.py).  Machine code is
kept.
"""

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import pandas as pd
from kept_tables import Table, keep, short
from measure_first_answer import MAIN, processor

HERE = Path(__file__).parent
TABLE = HERE / "engineers.csv"
SETS = sorted((HERE / "engineers").glob("*.toml"))
COMMANDS = {
    "assess": ["assess"],
    "to 2 %": ["stationary", "--accuracy", "0.02", "--no-closures"],
    "stationary": ["stationary"],
    "boundary": ["boundary", "--quantity", "rate_above", "--level", "100", "--over", "torque1"],
    "sensitivity": ["sensitivity"],
    "validate": ["validate"],
    "chaos": ["chaos"],
}
"""Commands with what they need beside the file."""
ANSWERED = (0, 3)  # exit codes of an answer, 3 of one that is not as accurate as was asked for
LONGEST = 1200.0  # wall seconds after which a command is stopped: the machine may be busy


def spent_by(process: int) -> float:
    """Processor seconds of a process so far."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return sum(int(ticks) for ticks in fields[11:15]) / os.sysconf("SC_CLK_TCK")


def measure(command: str, gears: Path) -> dict[str, object]:
    """Processor and wall seconds of a command and of its first answer, its exit code, and what it
    answers."""
    name, *settings = COMMANDS[command]
    words = [sys.executable, "-c", MAIN, name, str(gears), *settings]
    began = time.perf_counter()
    first: tuple[float, float] | None = None
    lines = []
    with (
        tempfile.TemporaryDirectory() as folder,
        tempfile.TemporaryFile() as errors,
        subprocess.Popen(words, cwd=folder, stdout=subprocess.PIPE, stderr=errors) as process,
    ):
        stop = threading.Timer(LONGEST, process.kill)
        stop.start()
        assert process.stdout is not None
        for line in process.stdout:
            first = first or (spent_by(process.pid), time.perf_counter() - began)
            lines.append(line.decode())
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        stop.cancel()
        wall = time.perf_counter() - began
        code = process.returncode
        if code not in ANSWERED:
            errors.seek(0)
            print(errors.read().decode()[-300:], flush=True)
    answer = "".join(lines[:-1])  # the last is the page's place
    cpu_first, wall_first = first or (None, None)
    return {
        "gears": gears.stem,
        "command": command,
        "cpu_seconds": round(used.ru_utime + used.ru_stime, 1),
        "wall_seconds": round(wall, 1),
        "cpu_first": cpu_first and round(cpu_first, 1),
        "wall_first": wall_first and round(wall_first, 1),
        "exit_code": code,
        "sentences": answer.count("\n"),
        "states_accuracy": any(sign in answer for sign in ("±", " to ", "exact", "%")),
    }


def table(found: pd.DataFrame) -> Table:
    """Processor seconds of each command on each gear set."""
    heads = ["", "`assess`: first answer", *(f"`{name}`" for name in COMMANDS)]
    heads[heads.index("`to 2 %`")] = "rate and power to 2 %"
    rows = []
    for name, of in found.groupby("gears"):
        runs = of.set_index("command").reindex(list(COMMANDS))
        cells = [short(runs.loc["assess", "cpu_first"])]
        for _, run in runs.iterrows():
            refused = run["exit_code"] >= 0 and run["exit_code"] not in ANSWERED
            cells.append(short(run["cpu_seconds"]) + (" (refused)" if refused else ""))
        rows.append([str(name), *cells])
    return heads, rows


def main() -> None:
    """Measure what is not yet in the table: remove its rows to measure something again."""
    for command in COMMANDS:
        for gears in SETS:
            known = pd.read_csv(TABLE)
            if ((known["gears"] == gears.stem) & (known["command"] == command)).any():
                continue
            row = measure(command, gears) | {"processor": processor()}
            print(json.dumps(row, ensure_ascii=False), flush=True)
            made = pd.concat([known, pd.DataFrame([row])]).sort_values("gears", kind="stable")
            keep(made, TABLE, table, None)


if __name__ == "__main__":
    main()
