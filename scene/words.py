"""What the parts of a scene are called: wheels and meshes of gears, bodies and contacts of any
other system."""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

from rattle.scene.errors import InputError


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

IN_BOTH_CASES = {
    "closed teeth open": "a closed contact opens",
    "closed teeth stay closed": "a closed contact stays closed",
    "closed teeth would stay closed": "a closed contact would stay closed",
    "wheel": "body",
    "wheels": "bodies",
    "mesh": "contact",
    "meshes": "contacts",
    "meshes with": "strikes",
    "mesh with itself": "strike itself",
    "stage": "body",
    "stages": "bodies",
    "these gears": "this system",
}
CHANGES = {
    "Does it rattle": "Does it keep striking",
    "Threshold of rattle": "Threshold of impacts",
    "does not rattle in the long run": "has no impacts in the long run",
    "do not rattle in the long run": "have no impacts in the long run",
    "rattles": "moves",
    "rattle": "motion",
    "opens closed teeth": "opens a closed contact",
    "its closed teeth stay closed": "its closed contact stays closed",
    "its closed teeth": "its closed contact",
    "in which teeth bounce": "in which a body bounces",
    "until they stay closed": "until it stays in contact",
    "teeth are pressed shut so firmly": "a contact is pressed shut so firmly",
    "teeth that are pressed shut": "contacts that are pressed shut",
    "its teeth are": "it is",
    "they open": "it opens",
    "teeth": "contacts",
    "gear set": "system",
    "gear sets": "systems",
    "of the same gears": "of the same system",
    "driver and wheel 1": "driver and body 1",
    "backlashes": "gaps",
    "backlash": "gap",
}
BODIES = Words(
    wheel="body",
    mesh="contact",
    flank="wall",
    stage="body",
    system="system",
    changes=CHANGES
    | IN_BOTH_CASES
    | {old[0].upper() + old[1:]: new[0].upper() + new[1:] for old, new in IN_BOTH_CASES.items()},
)
