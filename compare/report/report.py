"""What a report says, as data: its answer, the content of its page, its figures, tables and
manifest."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from rattle.scene import Scene
from rattle.scene.words import PAIR, Words

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Report:
    """A report: what `rattle.compare.report.save.save` writes into a folder.

    Texts are plain: between two backticks stands code, everything else is shown literally in
    every format.
    """

    name: str  # of the files of its page; of the folder of its template too, if none is given
    title: str
    # sentences that stand first; at least one.  The first is the advice, or what is most worth
    # knowing
    answer: Sequence[str]
    record: Mapping[str, Any]  # the manifest, as far as it does not depend on the files
    content: Mapping[str, Any]  # what the template of the page shows, by name
    words: Sequence[tuple[str, str]] = ()  # its glossary: each term and its meaning
    # by the name of their file without suffix; those that are drawn already are SVG
    figures: "Mapping[str, Figure | bytes]" = field(default_factory=dict)
    tables: "Mapping[str, pd.DataFrame]" = field(default_factory=dict)  # written as CSV
    large: "Mapping[str, pd.DataFrame]" = field(default_factory=dict)  # written as Parquet
    digits: str | None = None  # of numbers in CSV; all of them if not given
    template: str = ""  # path within `rattle.compare`
    spoken: Words | None = None  # those of the scene; by default of the one in the manifest
    more: Mapping[str, str] = field(default_factory=dict)  # further facts on where it comes from

    @cached_property
    def words_of_scene(self) -> Words:
        """What the scene that the page is about calls its parts."""
        scene = self.record.get("scene")
        if self.spoken is not None or not scene:
            return self.spoken or PAIR
        return Scene.from_dict(scene).words

    @property
    def repeat(self) -> str:
        """The command that makes the report again."""
        return str(self.record.get("repeat", self.record["command"]))

    @property
    def scene(self) -> str:
        """The text of the scene file."""
        return Scene.from_dict(self.record["scene"]).to_toml()
