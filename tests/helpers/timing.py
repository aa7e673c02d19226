"""Times that no slow or busy machine can fail: ratios of two measured in turn, and processor time used so far."""

import math
import os
import time

__all__ = ["times_as_long", "wait_for_work"]

TICK = os.sysconf("SC_CLK_TCK")
LOOK = 0.02  # seconds between two looks at a process


def times_as_long(call, other, turns=5):
    """Processor time of a call, in units of that of another; the least of several turns, after one that compiles."""
    least = [math.inf, math.inf]
    call(), other()
    for _ in range(turns):
        for i, measured in enumerate((call, other)):
            before = time.process_time()
            measured()
            least[i] = min(least[i], time.process_time() - before)
    return least[0] / max(least[1], 1e-6)


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
