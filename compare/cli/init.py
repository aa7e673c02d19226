"""The command ``rattle init``."""

from pathlib import Path

import click

from rattle.compare.cli.console import say


@click.command()
@click.argument("file", type=click.Path(path_type=Path), default=Path("gears.toml"))
def init(file: Path) -> None:
    """Write a scene file to start from: every key with its unit and a comment, and the values of DAT21.

    FILE is gears.toml if none is given; a file that is there is never replaced.  Exit codes: 0 written; 2 not.
    """
    from rattle.compare.cli.template import template
    from rattle.scene.errors import OutputError

    text = template(file.name)
    try:
        with file.open("x", encoding="utf-8") as new:
            new.write(text)
    except FileExistsError:
        raise OutputError(f"{file}: is there already; give another name") from None
    except OSError as error:
        raise OutputError(f"{file}: cannot be written ({error.strerror}); give another place") from None
    say(f"{file}: a gear pair to change; then: rattle simulate {file} --units physical")
