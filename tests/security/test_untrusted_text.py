"""No text from a file, a name or a message can control a terminal or reverse the text direction of
a page."""

import json
import re
from pathlib import Path

import pytest
from commands import rattle as command
from commands import study

from rattle import InputError
from rattle.scene import FileError, OutputError, RattleError, harmless, line

STEERING = (
    "\x1b]0;pwned\x07\x9b31m\x08\x7f\x85"
    "\u202e\u2066\u2069\u200b\u200e\u061c\u2028\u2029\ufeff\u00ad\U000e0041"
)
"""Terminal title, colour, deletion; reversed text direction; zero width; other line separators;
tags."""
IN_A_NAME = STEERING.replace("\x85", "")
RAW = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u00ad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\U000e0000-\U000e007f]"
)
TOLERANCE = (
    '[scene.tolerance]\nc1_max = 0.01\n[[axes]]\n"tolerance.distribution" = ["uniform", "{}"]\n'
)


def quoted(text):
    """A text as TOML has it, between quotation marks."""
    return "".join(c if c.isalnum() else f"\\U{ord(c):08x}" for c in text)


def rattle(*words, code=0):
    """Run a command, and check that its output has no terminal control characters."""
    found = command(*words, code=code)
    assert not RAW.search(found.stdout + found.stderr)
    return found


def files_are_harmless(folder):
    """No text file has control characters."""
    texts = {".md", ".html", ".csv", ".json", ".log", ".svg", ".txt"}
    read = [path for path in folder.rglob("*") if path.suffix in texts]
    assert read
    for path in read:
        assert not RAW.search(path.read_text(encoding="utf-8")), path


def test_every_such_character_is_shown():
    for c in STEERING:
        shown = c.encode("unicode_escape").decode()
        assert harmless(f"a{c}b") == line(f"a{c}b") == f"a{shown}b"
    plain = "σ = 0.1, ü 中 🙂 “a” – \xa0 1\u202f000"
    assert harmless(f"{plain}\n\tb\r\n") == f"{plain}\n\tb\n"
    assert harmless("a\nb", keep="") == "a\\nb"
    assert harmless("\udcff") == "\\udcff"
    assert harmless(harmless(STEERING)) == harmless(STEERING)


class Steering:
    """A value with its own representation."""

    def __repr__(self):
        return STEERING


@pytest.mark.parametrize(
    "error",
    [
        RattleError(STEERING),
        OutputError(STEERING),
        InputError(STEERING, STEERING, STEERING),
        FileError("page", Path(STEERING), STEERING),
        InputError("model", Steering(), "-"),
    ],
)
def test_errors_are_harmless_wherever_they_are_shown(error):
    assert not RAW.search(str(error))
    assert "\\x1b]0;pwned" in str(error)


def test_a_study_from_end_to_end(tmp_path):
    """A hostile title and value of an axis, on the terminal and in all files."""
    file = tmp_path / (IN_A_NAME.replace("/", "") + ".toml")
    file.write_text(study(title=quoted(STEERING)) + TOLERANCE.format(quoted(STEERING)))
    out = ("--out", tmp_path / "out")
    for word in ("--explain", "--status"):
        said = rattle("study", file, word, *out).output
        assert "\\x1b]0;pwned\\x07\\x9b31m" in said
        assert "\\u202e" in said
    assert "\\x1b]0;pwned" in rattle("study", file, *out, code=1).stderr
    files_are_harmless(tmp_path / "out")
    reasons = (tmp_path / "out" / "reasons.csv").read_text()
    assert "\\x1b]0;pwned\\x07\\x9b31m" in reasons
    record = json.loads(rattle("study", file, *out, "--json", code=1).stdout)
    assert record["title"] == STEERING  # data are as they were
    assert "\\x1b]0;pwned" in rattle("show", tmp_path / "out").stdout
