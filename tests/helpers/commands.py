"""The command line as a user types it, and studies that are soon computed."""

import json
import shlex

import click
from click.testing import CliRunner

from rattle.compare.cli.main import main

__all__ = ["SMALL_VALIDATION", "commands", "main", "manifest_of", "rattle", "strict", "study"]

SMALL_VALIDATION = (
    "validate --sigma 0.1 --sigma 1.0 --seed 5 --paths 600 --impacts 2 --dt 0.01"
    " --over sigma=0.01:1:3 --validity-paths 600"
)

STUDY = """
[study]
title = "{title}"
impacts = {impacts}
closures = {closures}
paths = {paths}
{more}
[scene]
alpha = 1.5
epsilon = 0.9
beta1 = 0.083
gamma1 = 0.057
{second}

[[axes]]
sigma = {sigma}
"""
SECOND = "beta2 = 0.133\ngamma2 = 0.029\nmu = 0.6"


def study(
    title="small", impacts=1, closures=("corrected",), paths=64, sigma=(0.1,), more="", stages=1
):
    """The text of a study file over sigma; its scene is small, and `more` are lines of its table
    ``[study]``."""
    second = SECOND if stages == 2 else "stages = 1"
    lists = {
        "closures": json.dumps(closures),
        "sigma": sigma if isinstance(sigma, str) else list(sigma),
    }
    return STUDY.format(
        title=title, impacts=impacts, paths=paths, more=more, second=second, **lists
    )


def rattle(line, *words, code=0, **settings):
    """Run a command as it is typed, with further words that may hold spaces; it ends with this
    exit code and no traceback."""
    done = CliRunner().invoke(main, [*shlex.split(line), *map(str, words)], **settings)
    assert done.exit_code == code, done.output
    assert "Traceback" not in done.output
    return done


def manifest_of(folder):
    """What a report says of how it was made."""
    return json.loads((folder / "manifest.json").read_text())


def strict(text):
    """JSON as its standard has it: without NaN and without infinity."""

    def refused(word):
        raise AssertionError(f"{word} is no JSON")

    return json.loads(text, parse_constant=refused)


def commands(group=main, above=""):
    """Each command that does something, by its words after ``rattle``: ``simulate``, ``check
    speed``."""
    for name, command in sorted(group.commands.items()):
        if isinstance(command, click.Group):
            yield from commands(command, f"{above}{name} ")
        else:
            yield f"{above}{name}", command
