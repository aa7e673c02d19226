"""Programs that run in a Python of their own."""

import os
import pty
import re
import shutil
import subprocess
import sys

from places import ROOT

LONG = 600  # seconds that nothing here takes, however busy the machine


def install(place):
    """Copy the face of the package and what all of it rests on into a folder."""
    place.mkdir(parents=True)
    sources_alone = shutil.ignore_patterns("__pycache__")
    for source, target in (("src/rattle", place), ("scene", place / "scene")):
        shutil.copytree(ROOT / source, target, ignore=sources_alone, dirs_exist_ok=True)


def surroundings(environment):
    """The environment of this process with changes, None for what is unset, in which a Python finds
    the modules that this one finds."""
    path = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    changed = os.environ | path | environment
    return {name: str(value) for name, value in changed.items() if value is not None}


def python(*words, code=0, cwd=None, **environment):
    """Run a Python that ends with this exit code."""
    command = [sys.executable, *map(str, words)]
    settings = {"env": surroundings(environment), "cwd": cwd, "timeout": LONG}
    done = subprocess.run(command, capture_output=True, text=True, **settings)
    assert done.returncode == code, done.stdout[-3000:] + done.stderr[-3000:]
    return done


def start(*words, stderr=subprocess.PIPE, **environment):
    """A Python that runs, with pipes for text."""
    command = [sys.executable, *map(str, words)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": stderr}
    return subprocess.Popen(command, env=surroundings(environment), text=True, bufsize=1, **pipes)


def on_terminal(*words, **environment):
    """Run a Python whose output is a terminal; all that it wrote, and the lines that are seen at
    its end."""
    given = surroundings({"COLUMNS": 100, "PYTEST_CURRENT_TEST": None} | environment)
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
