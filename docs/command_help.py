"""What every command says with ``--help``, folded below its heading, asked of the commands when the
site is built.

.. code-block:: none

    ```{command-help}
    ```
"""

from typing import Any

import click
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

__all__ = ["setup"]

WIDTH = 110  # characters of a line


class CommandHelp(SphinxDirective):
    """A section for each command of ``rattle``."""

    def run(self) -> list[nodes.Node]:
        """Make them."""
        from commands import commands

        return [self.section(f"rattle {name}", command) for name, command in commands()]

    def section(self, name: str, command: click.Command) -> nodes.section:
        """Heading, first sentence, and the whole help, folded."""
        text = command.get_help(
            click.Context(command, info_name=name, terminal_width=WIDTH, max_content_width=WIDTH)
        )
        section = nodes.section(
            "", nodes.title("", name), ids=[name.replace(" ", "-")], names=[name]
        )
        section += nodes.paragraph("", command.get_short_help_str(limit=200))
        summary = f"<details class='command-help'><summary><code>{name} --help</code></summary>"
        section += nodes.raw("", summary, format="html")
        section += nodes.literal_block("", text, language="none")
        section += nodes.raw("", "</details>", format="html")
        self.state.document.note_implicit_target(section, section)
        return section


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive."""
    app.add_directive("command-help", CommandHelp)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
