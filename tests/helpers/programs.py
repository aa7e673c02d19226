"""Programs that run in a Python of their own."""

import os
import pty
import re
import subprocess
import sys

LONG = 600  # seconds that nothing here takes, however busy the machine


def python(*words, code=0, cwd=None, **environment):
    """Run a Python that finds the modules that this one finds, and ends with this exit code."""
    path = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, *map(str, words)]
    done = subprocess.run(
        command,
        env=os.environ | path | environment,
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=LONG,
    )
    assert done.returncode == code, done.stdout[-3000:] + done.stderr[-3000:]
    return done


def on_terminal(*words, **environment):
    """Run a Python whose output is a terminal; all that it wrote, and the lines that are seen at
    its end."""
    path = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "COLUMNS": "100"}
    given = (
        {name: value for name, value in os.environ.items() if name != "PYTEST_CURRENT_TEST"}
        | path
        | environment
    )
    ours, theirs = pty.openpty()
    ends = {"stdin": theirs, "stdout": theirs, "stderr": theirs}
    with subprocess.Popen([sys.executable, *map(str, words)], env=given, **ends) as program:
        os.close(theirs)
        written = b""
        try:
            while part := os.read(ours, 65536):
                written += part
        except OSError:  # it has ended
            os.close(ours)
    text = written.decode()
    assert program.returncode == 0, text
    return text, screen(text)


def screen(text):
    """The lines of a terminal after a text with returns, line feeds and steps up was written."""
    lines = [""]
    row = 0
    column = 0
    for piece in re.findall(r"\x1b\[\d*[A-Za-z]|\r|\n|[^\x1b\r\n]+", text):
        if piece == "\r":
            column = 0
        elif piece == "\n":
            row += 1
            lines += [""] * (row == len(lines))
        elif piece == "\x1b[A":
            row -= 1
        else:
            before = lines[row].ljust(column)
            lines[row] = before[:column] + piece + before[column + len(piece) :]
            column += len(piece)
    return [line.rstrip() for line in lines]
