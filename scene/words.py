"""What the parts of a scene are called: wheels and meshes of gears, bodies and contacts of any
other system."""

import re
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.resources import files

from rattle.scene.errors import InputError

TEXTS: dict[str, dict[str, str]] = tomllib.loads(
    files("rattle.scene").joinpath("texts.toml").read_text("utf-8")
)
"""What stands in ``texts.toml``."""


@dataclass(frozen=True)
class Words:
    """What a scene calls its parts, and the changes that this makes in a text about gears."""

    wheel: str = "wheel"
    mesh: str = "mesh"
    flank: str = "flank"
    stage: str = "stage"
    system: str = "gear pair"
    changes: Mapping[str, str] = field(default_factory=dict)

    def put_into(self, text: str) -> str:
        """A text about gears in these words; code, a name between brackets or quotation marks and
        a single word, which is a key, are left."""
        if not self.changes or " " not in text:
            return text
        longest_first = sorted(self.changes, key=len, reverse=True)
        # a template may break a line between two words
        phrases = "|".join(longest_first).replace(" ", r"\s+")
        pattern = rf"`[^`]*`|\([\w-]+\)|'[\w-]+'|\b(?:{phrases})\b(?![.=(]\w)"

        def put(match: re.Match[str]) -> str:
            phrase = " ".join(match[0].split())
            return self.changes.get(phrase, match[0])

        return re.sub(pattern, put, text)

    @contextmanager
    def in_errors(self) -> Iterator[None]:
        """Errors about gears, and fields such as ``wheel.third.gamma``, come in these words."""
        try:
            yield
        except InputError as error:
            field = re.sub(r"^wheel\.", f"{self.wheel}.", error.field)
            remedy = self.put_into(error.remedy)
            raise type(error)(field, error.value, remedy, error.where) from None


PAIR = Words()
GEARBOX = Words(system="gearbox")

IN_BOTH_CASES = TEXTS["of_bodies_in_both_cases"]
BODIES = Words(
    wheel="body",
    mesh="contact",
    flank="wall",
    stage="body",
    system="system",
    changes=TEXTS["of_bodies"]
    | IN_BOTH_CASES
    | {old[0].upper() + old[1:]: new[0].upper() + new[1:] for old, new in IN_BOTH_CASES.items()},
)
