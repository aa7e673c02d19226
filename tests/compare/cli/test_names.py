"""Names of files, studies and models may hold anything: what is said of them stays on one line that obeys nothing."""

import io
import unicodedata
from contextlib import redirect_stdout

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from rattle.compare.cli.main import main
from rattle.compare.cli.shared import say

NAMES = ["two\nlines", "red \x1b[31m", "part\u2028part", "turned \u202e", "back\rover", "tab\tbell\a", "n" * 200]
STUDY = """[study]
title = {}
impacts = 2
closures = ["saltation"]
paths = 64
[scene]
alpha = 1.0
epsilon = 0.5
beta1 = 0.1
gamma1 = 0.1
stages = 1
[[axes]]
sigma = [0.01, 0.02]
"""


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
    scene, study = tmp_path / f"{name}.toml", tmp_path / "study.toml"
    study.write_text(STUDY.format('"' + "".join(f"\\u{ord(c):04x}" for c in name) + '"'))
    page = scene.with_suffix(".html")
    for rows, *words in (
        (1, "init", scene),
        (1, "animate", scene, "--impacts", 1, "--out", page),
        (None, "study", study, "--status"),
    ):
        done = CliRunner().invoke(main, list(map(str, words)))
        assert done.exit_code == 0, done.output
        said = done.stdout.rstrip("\n").split("\n")
        assert len(said) == (rows or len(said))
        assert all(map(is_plain, said))
