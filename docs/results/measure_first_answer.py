"""Measure what the first answer takes where no machine code is kept, in processor and wall seconds
of all processes.

``python docs/results/measure_first_answer.py [OLDER]`` writes docs/results/first_answer.csv (about
five minutes on two idle cores for each tree).  OLDER is the folder of an older checkout, which is
measured in turn with this one; without it its rows are kept.
"""

import os
import platform
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pandas as pd
from kept_tables import Table, keep, short

ROOT = Path(__file__).parents[2]
TABLE = Path(__file__).parent / "first_answer.csv"
MAIN = "from rattle.compare.cli.main import main; main()"
FENCE = re.compile(r"^```(toml|python)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def commands() -> tuple[str, dict[str, list[str]]]:
    """The README's gears, and the arguments of Python for each thing that is measured."""
    found = dict(FENCE.findall((ROOT / "README.md").read_text(encoding="utf-8")))
    validate = ["-c", MAIN, "validate", "gears.toml"]
    return found["toml"], {
        "rattle warm-up": ["-c", MAIN, "warm-up"],
        "the README's Python example": ["-c", found["python"]],
        "rattle validate gears.toml --no-validity": [*validate, "--no-validity"],
        "rattle validate gears.toml": validate,
    }


def measure(tree: Path, gears: str, words: list[str], kept: Path) -> tuple[float, float]:
    """Processor and wall seconds of a process and of those that it starts, in a folder of its
    own."""
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith("RATTLE_")
    }
    environment |= {"PYTHONPATH": str(tree), "NUMBA_CACHE_DIR": str(kept)}
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "gears.toml").write_text(gears, encoding="utf-8")
        with ChildrenSeconds() as seconds:
            subprocess.run(
                [sys.executable, *words],
                cwd=folder,
                env=environment,
                check=True,
                capture_output=True,
            )
    return seconds.processor, seconds.wall


class ChildrenSeconds:
    """Context that measures the processor seconds of the processes that it starts, and the wall
    seconds."""

    def __enter__(self) -> "ChildrenSeconds":
        self._began = self._now()
        return self

    def __exit__(self, *error: object) -> None:
        spent = [end - begin for end, begin in zip(self._now(), self._began, strict=True)]
        self.processor, self.wall = spent

    def _now(self) -> tuple[float, float]:
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime, time.perf_counter()


def processor() -> str:
    """Name of the processor."""
    with open("/proc/cpuinfo", encoding="utf-8") as file:
        names = re.findall(r"^model name\s*:\s*(.*)$", file.read(), re.MULTILINE)
    return names[0] if names else platform.processor()


def table(found: pd.DataFrame) -> Table:
    """What the first answer takes in an older version and in this one."""
    times = {"cpu_seconds": "processor", "wall_seconds": "wall"}
    wide = found.pivot_table(
        index=["what", "state"], columns="version", values=list(times), sort=False
    )
    order = [(of, version) for of in times for version in ("before", "now")]
    heads = ["", "machine code", *(f"{version}: {times[of]} s" for of, version in order)]
    return heads, [
        [*names, *(short(values[column]) for column in order)] for names, values in wide.iterrows()
    ]


def main() -> None:
    """Measure, and write the table."""
    older = {"before": Path(sys.argv[1]).resolve()} if len(sys.argv) > 1 else {}
    trees = older | {"now": ROOT}
    gears, asked = commands()
    rows = []
    for what, words in asked.items():
        for version, tree in trees.items():
            with tempfile.TemporaryDirectory() as kept:
                for state in ("nothing kept", "kept"):
                    cpu, wall = measure(tree, gears, words, Path(kept))
                    rows.append(
                        (
                            version,
                            what,
                            state,
                            round(cpu, 1),
                            round(wall, 1),
                            os.cpu_count(),
                            processor(),
                        )
                    )
                    print(*rows[-1], f"load {os.getloadavg()[0]:.1f}", flush=True)
    columns = ["version", "what", "state", "cpu_seconds", "wall_seconds", "cores", "processor"]
    found = pd.DataFrame(rows, columns=columns)
    if "before" not in trees and TABLE.exists():
        known = pd.read_csv(TABLE)
        found = pd.concat([known[known["version"] == "before"], found])
    keep(found, TABLE, table, None)


if __name__ == "__main__":
    main()
