"""What the commands say on the terminal: text that cannot steer it, and strict JSON."""

from typing import Any

import click

from rattle.compare.report.json_text import json_text
from rattle.scene.text import harmless

__all__ = ["say", "say_json"]


def say(text: str, *, err: bool = False) -> None:
    """Print a text, characters that would steer the terminal as escapes; on standard error if asked."""
    click.echo(harmless(text), err=err)


def say_json(data: Any) -> None:
    """Print data as strict JSON: null for what is no number."""
    click.echo(json_text(data))
