"""The commands of the command line by name, those within a group too."""

from collections.abc import Iterator

import click

from rattle.compare.cli.main import main


def commands(group: click.Group = main, above: str = "") -> Iterator[tuple[str, click.Command]]:
    """Each command that does something, by its words after ``rattle``: ``simulate``, ``check speed``."""
    for name, command in sorted(group.commands.items()):
        if isinstance(command, click.Group):
            yield from commands(command, f"{above}{name} ")
        else:
            yield f"{above}{name}", command
