"""The examples of the README and of the documentation run, and print what is said there.

Code cells of the documentation are run when the site is built (tests/page/test_docs_site.py).
"""

import re
import shutil

import pytest
from commands import commands, rattle
from places import BUILT, ROOT
from programs import python
from source_tree import PACKAGES

from rattle import Scene
from rattle.compare.judge.verdict import Verdict

README = (ROOT / "README.md").read_text()
PAGES = [
    p
    for p in sorted((ROOT / "docs").rglob("*.md"))
    if not BUILT.intersection(p.relative_to(ROOT).parts)
]
FENCE = re.compile(r"^```(\{?[\w-]*\}?)[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
ALL_TEXT = "\n".join([README, *(page.read_text() for page in PAGES)])
FENCED = FENCE.findall(ALL_TEXT)
TOML = [text for language, text in FENCED if language == "toml"]
STUDY_TEXTS = [text for text in TOML if "[study]" in text]
SCENE_TEXTS = [text for text in TOML if "[study]" not in text]

NOT_RUN = {
    "make report": "needs a clone and a minute; it is one `rattle validate`",
    "make test": "runs this test",
    "make test-all": "runs this test",
    "pytest -m slow": "runs this test",
    "make docs": "tests/page/test_docs_site.py builds the site",
    "make audit": "needs the network",
    "make pins": "needs the network",
    "pip install .": "changes the environment",
    "pip install .[xarray]": "changes the environment",
    "pip install rattle[cluster]": "changes the environment",
    "pytest -m published": "is part of the suite",
}
"""Shell examples of other programs, and why no test runs them."""

MEASUREMENT = "python tests/", "python docs/results/"  # what is measured by hand
"""What makes the tables of the pages again; each takes minutes to hours.  Only the file is looked
for."""


def examples():
    """Shell examples as they stand, with arguments: lines of shell blocks, and code within the
    text."""
    lines = [line for language, text in FENCED if language == "sh" for line in text.splitlines()]
    lines += re.findall(r"`((?:rattle|make|pip|pytest|python) [^`]+)`", FENCE.sub("", ALL_TEXT))
    words = dict.fromkeys(line.split(" # ")[0].strip() for line in lines if line[:1] != "#")
    return [line for line in words if not re.fullmatch(r"rattle \S+", line)]


def smaller(study):
    """The same study of fewer paths, impacts and values."""
    small = study
    for pattern, fewer in {
        r"(log = \[.*), \d+\]": r"\1, 3]",
        r"paths = \d+": "paths = 512",
        r"(?m)^impacts = \d+": "impacts = 3",
        r"(?m)^accuracy = .*": "periods = 64\npaths = 32",
    }.items():
        small = re.sub(pattern, fewer, small)
    assert small != study
    return small


def check_print(text, folder):
    """The first Python example of a text prints what the text says that it does."""
    code, published = re.search(r"(?s)```python\n(.*?)```.*?```\w*\n(.*?)```", text).groups()
    assert python("-c", code, cwd=folder).stdout.split() == published.split()


def test_a_gear_pair_of_ones_own_takes_ten_lines():
    gears, scene = re.split(r"\n\n", SCENE_TEXTS[0].strip())
    assert len(gears.splitlines()) <= 10
    assert len(scene.splitlines()) == 2


def test_the_worked_example_prints_what_it_says(tmp_path):
    (tmp_path / "gears.toml").write_text(SCENE_TEXTS[0])
    check_print(README, tmp_path)


@pytest.mark.slow
def test_the_orbit_with_sticking_prints_what_it_says(tmp_path):
    check_print((ROOT / "docs/results/stability.md").read_text(), tmp_path)


def test_the_committed_study_loads_as_it_says(monkeypatch):
    (code,) = (text for language, text in FENCED if language == "python" and "load_study" in text)
    monkeypatch.chdir(ROOT)
    found = {}
    exec(code, found)
    errors = found["results"].errors
    assert len(errors) == 24 * 4 * 12 * 2 * 6  # sigma, closure, impact, moment, quantity
    # the study may be older than the words of its verdicts
    assert set(errors["verdict"]) <= set(Verdict)


def test_pictures_and_links_exist():
    for link in re.findall(r"\]\(([^)#]+)\)", README):
        assert (ROOT / link).exists(), link


@pytest.mark.parametrize("number", range(len(SCENE_TEXTS)))
def test_every_scene_is_read_whole(number):
    """A scene says all that it says again."""
    scene = Scene.from_toml(SCENE_TEXTS[number])
    assert Scene.from_toml(scene.to_toml()) == scene


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("number", range(len(STUDY_TEXTS)))
def test_every_study_runs_to_the_end(tmp_path, number):
    file = tmp_path / "study.toml"
    file.write_text(smaller(STUDY_TEXTS[number]))
    assert "cannot be computed" not in rattle(f"study {file}").output


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_every_shell_example_is_understood_and_the_quick_ones_run(tmp_path, monkeypatch):
    for name, command in commands():
        # of the others, which tests/compare/cli runs, the words are read
        if name not in ("init", "simulate", "drive", "show"):
            monkeypatch.setattr(command, "callback", lambda **_: None)
    (tmp_path / "gears.toml").write_text(SCENE_TEXTS[0])
    (tmp_path / "SCENE.toml").write_text(SCENE_TEXTS[-1])
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    shutil.copytree(ROOT / "reports/dat21", tmp_path / "reports/mine")
    monkeypatch.chdir(tmp_path)
    lines = [
        line for line in examples() if line not in NOT_RUN and not line.startswith(MEASUREMENT)
    ]
    assert len(lines) > 30
    for line in lines:
        assert line.startswith("rattle "), line
        rattle(line.replace("[SCENE.toml]", "SCENE.toml").removeprefix("rattle "))
    with pytest.raises(AssertionError, match="No such option"):  # a planted error
        rattle("boundary gears.toml --closures branching")


def test_every_measurement_that_is_named_is_there():
    measurements = [line.split()[1] for line in examples() if line.startswith(MEASUREMENT)]
    assert len(measurements) >= 4
    for file in measurements:
        assert (ROOT / file).is_file(), file


def test_the_commands_that_are_named_are_those_that_exist():
    """Pages name every command and no other; so do the Makefile, what commands print, and
    docstrings."""
    files = [ROOT / "Makefile", ROOT / "CONTRIBUTING.md", ROOT / ".ci/run"]
    for package in PACKAGES:
        files += (ROOT / package).rglob("*.py")
    pages = ALL_TEXT + "".join(f"`{words}`\n" for words in examples())
    exist = dict(commands())
    groups = {name.split()[0] for name in exist if " " in name}

    def named(text):
        for first, second in re.findall(r"[`/(]rattle ([a-z][\w-]*)(?: ([a-z][\w-]*))?", text):
            yield f"{first} {second}".strip() if first in groups else first

    assert set(named(pages)) - groups == set(exist)
    for file in files:
        assert set(named(file.read_text())) <= {*exist, *groups}, file


def test_the_page_of_commands_has_one_line_for_each():
    text = rattle("--help", terminal_width=80).output
    listed = text[text.index("Commands:") :].split("\n\n")[0].splitlines()[1:]
    names = {name.split()[0] for name, _ in commands()}
    assert [line.split()[0] for line in listed] == sorted(names)
    assert all(line.endswith(".") and not line.endswith("...") for line in listed)
