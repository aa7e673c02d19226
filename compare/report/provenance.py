"""Where a report comes from: the command, the commit, the versions and the time of its run."""

import importlib.metadata
import os
import platform
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numba
from llvmlite import binding

from rattle.compare.report.json_text import Facts
from rattle.scene import OutputError
from rattle.scene.sources import PACKAGES, describe_difference, sources_in

COMPILER: Any = numba.config  # numba has no type annotations

VERSIONED = ("rattle", "numpy", "numba", "llvmlite", "scipy", "pandas", "matplotlib", "pyarrow")


class Stopwatch:
    """Wall time and processor time since it was made."""

    def __init__(self) -> None:
        self._wall = time.perf_counter()
        self._cpu = time.process_time()

    @property
    def seconds(self) -> dict[str, float]:
        """Both, for a manifest."""
        wall = time.perf_counter() - self._wall
        cpu = time.process_time() - self._cpu
        return {"wall_seconds": round(wall, 1), "cpu_seconds": round(cpu, 1)}


def provenance(watch: Stopwatch | None = None) -> Facts:
    """Command, commit and versions of this run, and its time if a watch has taken it; for the
    manifest.

    Raises OutputError where the sources are no longer those that have computed the numbers.
    """
    if change := describe_difference(sources_in(*PACKAGES, "compare")):
        raise OutputError(f"{change}, so nothing is written; start it again")
    origin = {"command": command_line(sys.argv[1:]), "commit": commit(), "versions": versions()}
    return origin if watch is None else origin | watch.seconds


def command_line(words: Sequence[str]) -> str:
    """A command as it is typed in a shell."""
    return shlex.join(["rattle", *words]).encode(errors="backslashreplace").decode()


def versions() -> dict[str, str]:
    """Versions of the packages on which the numbers depend, and the processor as named by system
    and compiler."""
    named = {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "processor": _processor(),
        "compiled for": COMPILER.CPU_NAME or binding.get_host_cpu_name(),
        "vectors": _vectors(),
    }
    for package in VERSIONED:
        named[package] = "not installed"
        with suppress(importlib.metadata.PackageNotFoundError):
            # another may be installed by now
            imported = sys.modules.get(package) if package != "rattle" else None
            named[package] = (
                imported.__version__ if imported else importlib.metadata.version(package)
            )
    return named


def _processor() -> str:
    """Model name of the processor."""
    with suppress(OSError):
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
        if model := re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE):
            return model[1]
    return platform.processor() or "unknown"


def _vectors() -> str:
    """The vector instructions for which code is compiled; they determine the order of sums, hence
    their last bits."""
    chosen = COMPILER.CPU_FEATURES
    features = binding.get_host_cpu_features().flatten() if chosen is None else chosen
    return (
        " ".join(sorted(re.findall(r"\+(s?sse[\w.]*|avx[\w.]*|fma\w*|neon|sve\w*)", features)))
        or "none"
    )


def commit() -> str:
    """Git commit of the running code."""
    here = Path(__file__).resolve().parents[2]

    def git(*words: str) -> str:
        output = subprocess.run(
            ["git", "-C", str(here), *words], capture_output=True, check=True
        ).stdout
        return os.fsdecode(output).strip()

    try:
        if Path(git("rev-parse", "--show-toplevel")).resolve() != here:
            return "unknown"
        changed = git("status", "--porcelain", "--", "scene", "closure", "montecarlo", "compare")
        return git("rev-parse", "HEAD") + ("+changes" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
