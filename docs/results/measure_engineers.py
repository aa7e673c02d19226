"""Measure what each command takes by default on the gear sets of an engineer, in processor seconds
of all processes.

``python docs/results/measure_engineers.py`` writes docs/results/engineers.csv (about twenty minutes
on two idle cores).  The five gear sets in docs/results/engineers/ are made up with values in
published ranges: a car's loose gear at idle, a truck's power take-off, an electric drive, a soft
pair, and one that never rattles.  Machine code is kept.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import pandas as pd
from kept_tables import Table, keep, short
from measure_first_answer import MAIN, ChildrenSeconds, processor

HERE = Path(__file__).parent
TABLE = HERE / "engineers.csv"
SETS = sorted((HERE / "engineers").glob("*.toml"))
COMMANDS = {
    "assess": [],
    "stationary": [],
    "sensitivity": [],
    "boundary": ["--quantity", "rate_above", "--level", "100", "--over", "torque1"],
    "chaos": [],
    "validate": [],
}
"""Commands with what they need beside the file."""
LONGEST = 300.0  # wall seconds after which a command is stopped


def measure(command: str, gears: Path) -> dict[str, object]:
    """Processor and wall seconds of a command, its exit code, and how many sentences it answers."""
    words = [sys.executable, "-c", MAIN, command, str(gears), *COMMANDS[command]]
    with tempfile.TemporaryDirectory() as folder, ChildrenSeconds() as seconds:
        try:
            done = subprocess.run(words, cwd=folder, capture_output=True, timeout=LONGEST)
            code = done.returncode
            if code not in (0, 3):
                print(done.stderr.decode()[-300:], flush=True)
            sentences = len(done.stdout.decode().splitlines()) - 1  # the last is the page's place
        except subprocess.TimeoutExpired:
            code = None
            sentences = 0
    return {
        "gears": gears.stem,
        "command": command,
        "cpu_seconds": round(seconds.processor, 1),
        "wall_seconds": round(seconds.wall, 1),
        "exit_code": code,
        "sentences": sentences,
    }


def table(found: pd.DataFrame) -> Table:
    """Processor seconds of each command on each gear set."""
    names = list(found["gears"].unique())
    rows = []
    for command, runs in found.groupby("command", sort=False):
        by_set = runs.set_index("gears")
        cells = [
            short(by_set.loc[name, "cpu_seconds"])
            + ("" if by_set.loc[name, "exit_code"] in (0, 3) else " (refused)")
            for name in names
        ]
        rows.append([f"`rattle {command}`", *cells])
    return ["", *names], rows


def main() -> None:
    """Measure, and write the table."""
    rows = []
    for command in COMMANDS:
        for gears in SETS:
            rows.append(measure(command, gears) | {"processor": processor()})
            print(json.dumps(rows[-1]), flush=True)
    keep(pd.DataFrame(rows), TABLE, table, None)


if __name__ == "__main__":
    main()
