"""Single numbers of the committed reports within a sentence, read when the site is built.

.. code-block:: none

    The report took {fact}`chaos/manifest.json wall_seconds` s.
"""

import json
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxRole

__all__ = ["setup", "written"]


def written(value: Any) -> str:
    """A value as a reader writes it."""
    return (
        f"{value:,}"
        if isinstance(value, int)
        else f"{value:.3g}"
        if isinstance(value, float)
        else str(value)
    )


class Fact(SphinxRole):
    """A value in a JSON file of the reports: the file, a space, and its keys with dots between
    them."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        """Make it."""
        name, _, keys = self.text.partition(" ")
        file = Path(self.config.rattle_reports) / name
        self.env.note_dependency(str(file))
        try:
            value = json.loads(file.read_text())
            for key in keys.split("."):
                value = value[key]
        except (OSError, KeyError, TypeError) as error:
            return [], [
                self.inliner.reporter.error(
                    f"{self.text} is not there: {error!r}", line=self.lineno
                )
            ]
        return [nodes.Text(written(value))], []


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the role."""
    app.add_role("fact", Fact())
    return {"parallel_read_safe": True, "parallel_write_safe": True}
