"""The command ``rattle``."""

import io
import os
import sys
from typing import Any

import click

from rattle.compare.cli.assess import assess
from rattle.compare.cli.check import check, warm_up
from rattle.compare.cli.judge import judge
from rattle.compare.cli.parameters import boundary, sensitivity
from rattle.compare.cli.ranges import EXAMPLE, RENAMED
from rattle.compare.cli.shared import CommandGroup, say
from rattle.compare.cli.show import animate, drive, init, show
from rattle.compare.cli.simulate import chaos, run_up, simulate, stationary
from rattle.compare.cli.study import study
from rattle.compare.cli.validate import tradeoff, validate
from rattle.compare.report.interrupt import EXIT_INTERRUPTED, describe_interrupt, ends_soon, said
from rattle.scene.errors import RattleError
from rattle.scene.progress import speaking
from rattle.scene.text import harmless

EXIT_BAD_INPUT = 2


class RattleGroup(CommandGroup):
    """Group of commands that reports the project's own errors in one line on standard error, with
    exit code 2."""

    def main(self, *args: Any, **settings: Any) -> Any:
        """Run the program; what is printed goes nowhere where an output is closed, as a daemon's
        are.

        What the output's encoding cannot show, as σ on a Windows pipe, is shown as an escape.
        """
        for name in ("stdout", "stderr"):
            stream = getattr(sys, name)
            if stream is None:
                setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115  (open as long as the process)
            elif isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="backslashreplace")
        return super().main(*args, **settings)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command, and convert its errors to a message and an exit code."""
        try:
            with ends_soon(), speaking("starting"):
                return super().invoke(ctx)
        except click.NoSuchOption as error:
            renamed = RENAMED.get(error.option_name)
            if renamed is None:
                raise
            why = f"{error.option_name} is now part of {renamed}, as in {EXAMPLE}"
            raise click.UsageError(why, error.ctx) from None
        # the message may quote a file name with control characters
        except click.ClickException as error:
            setattr(error, "message", harmless(error.message))  # noqa: B010  (final by its type)
            raise
        except BrokenPipeError:
            raise
        except RattleError as error:
            say(f"rattle: {error}", err=True)
            ctx.exit(EXIT_BAD_INPUT)
        except OSError as error:
            why = (
                f"{error.filename}: {error.strerror}; choose another place or make room there, and"
                " try again"
            )
            say(f"rattle: {why if error.filename else error}", err=True)
            ctx.exit(EXIT_BAD_INPUT)
        except KeyboardInterrupt as interrupt:
            said.set()
            say(f"rattle: {str(interrupt) or describe_interrupt()}", err=True)
            ctx.exit(EXIT_INTERRUPTED)


COMPLETION = """\b
Completion by the Tab key, for this session or from the shell's start-up file:
  bash:  eval "$(_RATTLE_COMPLETE=bash_source rattle)"
  zsh:   eval "$(_RATTLE_COMPLETE=zsh_source rattle)"
  fish:  _RATTLE_COMPLETE=fish_source rattle | source
"""


@click.group(
    cls=RattleGroup,
    epilog=COMPLETION,
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
)
@click.version_option(package_name="rattle")
def main() -> None:
    """When can a cheap moment closure of a noisy vibro-impact system be believed?"""


for command in (
    *(animate, assess, boundary, chaos, check, drive, init, judge),
    *(run_up, sensitivity, show, simulate, stationary, study, tradeoff, validate, warm_up),
):
    main.add_command(command)

if __name__ == "__main__":
    main()
