"""Commands whose output is not Unicode show what it lacks as escapes; files are in UTF-8 in every
locale."""

import re
import subprocess
import sys

from commands import study
from programs import python, surroundings


def test_files_are_in_utf_8_in_a_locale_without_it(tmp_path):
    (tmp_path / "s.toml").write_text(study(title="\u03c3 \u4e2d"), encoding="utf-8")
    plain = {
        "LC_ALL": "C",
        "PYTHONUTF8": "0",
        "PYTHONCOERCECLOCALE": "0",
        "PYTHONIOENCODING": "cp1252:strict",
    }
    command = ["-m", "rattle.compare.cli.main"]
    done = python(*command, "study", "s.toml", cwd=tmp_path, PYTHONWARNDEFAULTENCODING="1", **plain)
    assert not re.search("(?m)^(?!.*site-packages).*EncodingWarning", done.stderr), done.stderr
    for name in ("study.md", "study.html", "study.toml"):
        assert "\u4e2d" in (tmp_path / "s" / name).read_text(encoding="utf-8")
    words = [sys.executable, *command, "show", tmp_path / "s"]
    shown = subprocess.run(words, env=surroundings(plain), stdout=subprocess.PIPE, check=True)
    assert b"\\u03c3 \\u4e2d" in shown.stdout
