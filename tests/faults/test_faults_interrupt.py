"""Ctrl-C at any moment, in the middle of an import too: one line, exit code 130, nothing half written."""

import os
import re
import sys

import pytest
from programs import python

INTERRUPT = "import os, signal; os.kill(os.getpid(), signal.SIGINT)"
EXTENSION = f"""
try:
    {INTERRUPT}
    for _ in range(1000):
        pass  # where an interrupt is heard
except BaseException:
    raise ImportError("initialization failed")
"""
"""Behaves like a C extension that is interrupted while it is loaded."""
ENDLESS = f"""
{INTERRUPT}
import time
while True:
    try:
        time.sleep(10.0)
    except BaseException:
        pass
"""
COMMAND = """
from rattle.compare.cli.main import main

@main.command()
def load():
    import extension
    import time
    time.sleep(60.0)
    print("it went on")

main(["load"])
"""


def rattle(code, folder, **files):
    """Run code in a process whose path begins with a folder of test modules; it is interrupted."""
    for name, text in files.items():
        (folder / f"{name}.py").write_text(text)
    path = os.pathsep.join([str(folder), *filter(None, sys.path)])
    return python("-c", code, code=130, cwd=folder, PYTHONPATH=path)


@pytest.mark.parametrize("loaded", [EXTENSION, ENDLESS, INTERRUPT], ids=["caught", "endless", "plain"])
def test_an_interrupt_while_a_command_loads_a_library(tmp_path, loaded):
    done = rattle(COMMAND, tmp_path, extension=loaded)
    assert re.fullmatch(r"rattle: interrupted[^\n]*\n", done.stderr)
    assert done.stdout == ""


@pytest.mark.parametrize("library", ["click", "tomli_w", "numpy"])
def test_an_interrupt_while_the_command_itself_is_loaded(tmp_path, library):
    done = rattle("import rattle.compare.cli.main", tmp_path, **{library: EXTENSION})
    assert done.stderr == "rattle: interrupted\n"


def test_a_second_interrupt_does_not_stop_the_cleaning_up(tmp_path):
    command = COMMAND.replace("    import extension", """
    import os, signal
    try:
        os.kill(os.getpid(), signal.SIGINT)
        for _ in range(1000): pass
    finally:
        os.kill(os.getpid(), signal.SIGINT)
        for _ in range(1000): pass
        open("cleaned", "w").close()
""")  # fmt: skip
    done = rattle(command, tmp_path)
    assert done.stderr.count("\n") == 1
    assert (tmp_path / "cleaned").exists()
