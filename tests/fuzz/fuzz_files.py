"""Scene files and study files through the command line."""

import contextlib
import re
import tempfile
from pathlib import Path

import tomli_w
from click.testing import CliRunner
from commands import main, strict
from fuzz_must import must


def run(*words):
    """A command line that has ended as ours do, with a reason where it refuses."""
    done = CliRunner().invoke(main, words)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    must(done.exit_code in (0, 1, 2, 3, 4), "exit code", done.exit_code, done.output)
    reason = re.search("rattle: |Error: |Usage: ", done.stderr)
    must(done.exit_code != 2 or reason, "exit code 2 without a reason:", done.output)
    return done


def command(name):
    """The command prints strict JSON, and the report that it has written can be shown."""

    def on_file(scene, settings):
        table = scene.to_dict()
        options = ["--workers=1", "--json", "--out=report"]
        if name == "study":
            table |= settings
        else:
            options += ["--no-validity", *(f"--{key}={value}" for key, value in settings.items())]
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            Path("file.toml").write_text(tomli_w.dumps(table), encoding="utf-8")
            done = run(name, "file.toml", *options)
            if done.exit_code == 2:
                return "refused", name
            must(strict(done.stdout), "no answer")
            must(run("show", "report").exit_code == 0, "show")
        return ("stopped", f"code {done.exit_code}") if done.exit_code else ("complete", "")

    return on_file
