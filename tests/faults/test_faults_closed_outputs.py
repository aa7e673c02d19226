"""Programs without a standard error or output, as daemons are, and without a folder for temporary
files."""

import io
import subprocess
import sys

import pytest
from programs import LONG, surroundings
from scenes import dat21

from rattle import simulate
from rattle.scene.progress import has_terminal, print_on_stderr

FUNCTION = (
    "from rattle.scene.moments import gaussian_raw_moments as f; print(float(f(1.0, 0.5, 2.0, 4)[2,"
    " 2]))"
)
MAIN = "from rattle.compare.cli.main import main; main()"


def shell(words, *command, **environment):
    """Run Python in a shell with redirected outputs; returns exit code and standard output."""
    line = ["sh", "-c", f'exec "$@" {words}', "sh", sys.executable, *command]
    settings = {"env": surroundings(environment), "text": True, "timeout": LONG}
    done = subprocess.run(line, stdout=subprocess.PIPE, **settings)
    return done.returncode, done.stdout


def test_machine_code_is_compiled_without_standard_error(tmp_path):
    """What would be said there does not go to standard output."""
    assert shell(
        "2>&-", "-c", FUNCTION, NUMBA_CACHE_DIR="/dev/null/nowhere", TMPDIR=str(tmp_path)
    ) == (0, "2.5\n")


@pytest.mark.parametrize(
    ("words", "command", "code"),
    [
        ("2>&-", "simulate --paths -3", 2),
        ("2>/dev/full", "simulate --paths -3", 2),
        ("2>&-", "simulate --nosuch", 2),
        ("<&- >&- 2>&-", "--help", 0),
    ],
)
def test_a_command_that_nobody_can_read_ends_as_it_would(words, command, code):
    """And what would be said of an error does not go to standard output."""
    assert shell(words, "-c", MAIN, *command.split()) == (code, "")


CLOSED = io.StringIO()
CLOSED.close()


@pytest.mark.parametrize("stream", [None, CLOSED])
def test_progress_and_messages_go_nowhere_where_standard_error_cannot_be_written(
    stream, capsys, monkeypatch
):
    monkeypatch.setattr(sys, "stderr", stream)
    print_on_stderr("something")
    assert not has_terminal()
    simulate(dat21(0.1), paths=64, impacts=1, rng=1, progress="paths")
    assert capsys.readouterr().out == ""


NOWHERE = """
import tempfile

def none():
    raise FileNotFoundError(2, "No usable temporary directory found")

tempfile.gettempdir = none
"""


@pytest.mark.parametrize("place", ["kept", "/dev/null/nowhere"])
def test_without_a_folder_for_temporary_files(tmp_path, place):
    """Machine code is kept where it can be, and results of one call are."""
    code = f"{NOWHERE}{FUNCTION}\nfrom rattle.scene.compiled import folder\nprint(folder())"
    hidden = {"NUMBA_CACHE_DIR": str(tmp_path / place), "HOME": "/dev/null"}
    rc, out = shell("2>&1", "-c", code, **hidden)
    assert rc == 0, out
    assert "2.5\n" in out
