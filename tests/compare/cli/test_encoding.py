"""Commands whose output is not Unicode show what it lacks as escapes; files are in UTF-8 in every
locale."""

import subprocess
import sys

from commands import study
from programs import python, surroundings

SPEAK = """
import sys
from rattle.compare.cli.main import main
from rattle.compare.cli.shared import say

@main.command()
def speak():
    say("\u03c3 \u2713 \u4e2d")
    say("\u03c3", err=True)
    print("\u2713")
    sys.stderr.write("\u2588")

main(["speak"])
"""


def test_no_command_fails_on_a_character():
    done = python("-c", SPEAK, PYTHONIOENCODING="cp1252:strict", PYTHONUTF8="0")
    assert "\\u2713" in done.stdout


def test_files_are_in_utf_8_in_a_locale_without_it(tmp_path):
    (tmp_path / "s.toml").write_text(study(title="\u03c3 \u4e2d"), encoding="utf-8")
    plain = {
        "LC_ALL": "C",
        "PYTHONUTF8": "0",
        "PYTHONCOERCECLOCALE": "0",
        "PYTHONIOENCODING": "cp1252",
    }
    command = ["-m", "rattle.compare.cli.main"]
    done = python(*command, "study", "s.toml", cwd=tmp_path, PYTHONWARNDEFAULTENCODING="1", **plain)
    warned = [text for text in done.stderr.splitlines() if "EncodingWarning" in text]
    assert all("site-packages" in text for text in warned), warned
    for name in ("study.md", "study.html", "study.toml"):
        assert "\u4e2d" in (tmp_path / "s" / name).read_text(encoding="utf-8")
    with (tmp_path / "shown").open("wb") as shown:
        words = [sys.executable, *command, "show", "s"]
        subprocess.run(words, cwd=tmp_path, env=surroundings(plain), stdout=shown, check=True)
    assert b"\\u03c3 \\u4e2d" in (tmp_path / "shown").read_bytes()
