"""Disks that are full or read-only: real ones where a small file system may be mounted; what a
process leaves."""

import platform
import subprocess
from contextlib import contextmanager

import pytest

DEAD = 999_999_999  # number of a process that no system has


def scratch_name(name, process, suffix=".part"):
    """Name of what a process writes, or has left."""
    return f".{name}-{platform.node()}-{process}-0123abcd{suffix}"


@contextmanager
def disk(place, size, options=""):
    """A file system of `size` mounted on a folder; the test is skipped, and says so, where that is
    not allowed."""
    place.mkdir(exist_ok=True)
    mounting = ["mount", "-t", "tmpfs", "-o", f"size={size}{options}", "none", place]
    if subprocess.run(mounting, capture_output=True).returncode != 0:
        pytest.skip(
            "no file system may be mounted here: only a privileged process can try a disk that is"
            " really full"
        )
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", place], check=True)


def make_read_only(place):
    """Nothing more can be written on the disk mounted there."""
    subprocess.run(["mount", "-o", "remount,ro", place], check=True)
