"""Output of the commands: text without terminal control characters, and strict JSON."""

from datetime import datetime
from typing import Any

import click

from rattle.compare.report.json_text import json_text
from rattle.scene.text import harmless


def say(text: str, *, err: bool = False, keep: str = "") -> None:
    """Print a text on one line; control characters, such as those of a file's name, are shown as escapes."""
    click.echo(harmless(text, keep), err=err)


def say_json(data: Any) -> None:
    """Print data as strict JSON; NaN and infinities become null."""
    click.echo(json_text(data))


def say_part(part: str) -> None:
    """Print on standard error which part of a long command begins, and when."""
    say(f"{datetime.now():%H:%M:%S} {part}", err=True)
