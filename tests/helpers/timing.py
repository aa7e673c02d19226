"""Waits that no slow or busy machine can fail: for processor time, not for time on the clock."""

import os
import time

__all__ = ["wait_for_work"]

TICK = os.sysconf("SC_CLK_TCK")
LOOK = 0.02  # seconds between two looks at a process


def wait_for_work(process, seconds):
    """Wait until a process has used so many more seconds of processor time, or has ended."""
    wanted = _used(process) + seconds
    while process.poll() is None and _used(process) < wanted:
        time.sleep(LOOK)


def _used(process):
    """Processor seconds of all threads of a process, of /proc/PID/stat: utime and stime."""
    try:
        with open(f"/proc/{process.pid}/stat", encoding="ascii") as file:
            fields = file.read().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / TICK
