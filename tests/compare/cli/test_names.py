"""Names of files, studies and models may hold anything: what is said of them stays on one line that obeys nothing."""

import io
import unicodedata
from contextlib import redirect_stdout

import pytest
from commands import rattle, study
from hypothesis import given
from hypothesis import strategies as st

from rattle.compare.cli.shared import say

NAMES = ["two\nlines", "red \x1b[31m", "part\u2028part", "turned \u202e", "back\rover", "tab\tbell\a", "n" * 200]


def is_plain(row):
    return all(unicodedata.category(c) not in {"Cc", "Cf", "Zl", "Zp"} for c in row)


@given(st.text())
def test_whatever_is_said_is_one_line(text):
    with redirect_stdout(io.StringIO()) as out:
        say(f"Page: {text}")
    assert out.getvalue().endswith("\n")
    assert is_plain(out.getvalue()[:-1])


@pytest.mark.parametrize("name", NAMES)
def test_commands_name_files_and_studies_on_one_line(tmp_path, name):
    scene, file = tmp_path / f"{name}.toml", tmp_path / "study.toml"
    file.write_text(study(title="".join(f"\\u{ord(c):04x}" for c in name), sigma=(0.01, 0.02)))
    page = scene.with_suffix(".html")
    for rows, *words in (
        (1, "init", scene),
        (1, "animate", scene, "--impacts", 1, "--out", page),
        (None, "study", file, "--status"),
    ):
        said = rattle(*words).stdout.rstrip("\n").split("\n")
        assert len(said) == (rows or len(said))
        assert all(map(is_plain, said))
