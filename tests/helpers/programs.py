"""Programs that run in a Python of their own."""

import os
import subprocess
import sys

LONG = 600  # seconds that nothing here takes, however busy the machine


def python(*words, code=0, cwd=None, **environment):
    """Run a Python that finds the modules that this one finds, and ends with this exit code."""
    path = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, *map(str, words)]
    done = subprocess.run(
        command, env=os.environ | path | environment, cwd=cwd, capture_output=True, text=True, timeout=LONG
    )
    assert done.returncode == code, done.stdout[-3000:] + done.stderr[-3000:]
    return done
