"""The README's examples run, and print what the README says."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from rattle.compare.cli.main import main
from rattle.compare.study import Study
from rattle.scene import Scene

README = Path(__file__).resolve().parent.parent / "README.md"
TEXT = README.read_text()
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
TOML = [text for language, text in BLOCKS if language == "toml"]

NOT_RUN = {
    "make report": "needs a clone and a minute; it is one `rattle validate`",
    "make test": "runs this test",
    "make audit": "needs the network",
    "python tests/fuzz/campaign.py --space wide": "takes half an hour",
    "pip install .": "changes the environment",
    "pip install rattle[cluster]": "changes the environment",
    "pip install rattle[gpu]": "changes the environment",
    "pytest -m selftest": "is part of the suite",
    "python -m rattle.montecarlo.cuda.launch": "needs a GPU",
}
"""Shell examples that no test can run, and why."""

APPENDED = {
    "validate": "--paths 600 --validity 0.01:0.02:2 --validity-paths 600",
    "chaos": "--points 2000 --impacts 40000 --events 300 --width 0.2 --no-sweep",
}
"""Options that a test appends to a command for less work; the last of an option's values holds."""


def examples():
    """Shell examples as they stand, with arguments: lines of shell blocks, and code within the text."""
    lines = [line for language, text in BLOCKS if language == "sh" for line in text.splitlines()]
    prose = re.sub(r"^```.*?^```", "", TEXT, flags=re.MULTILINE | re.DOTALL)
    lines += re.findall(r"`((?:rattle|make|pip|pytest|python) [^`]+)`", prose)
    found = dict.fromkeys(line.split(" # ")[0].strip() for line in lines if not line.startswith("#"))
    return [words for words in found if len(words.split()) > 2 or not words.startswith("rattle ")]


def smaller(study):
    """The same study of fewer paths and values."""
    small = re.sub(r"paths = \d+", "paths = 512", re.sub(r"(log = \[.*), \d+\]", r"\1, 3]", study))
    assert small != study
    return small


def rattle(*words):
    return CliRunner().invoke(main, list(words))


def test_the_worked_example_prints_what_it_says():
    code, published = re.search(r"```python\n(.*?)```.*?```\n(.*?)```", TEXT, re.DOTALL).groups()
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.split() == published.split()


def test_the_orbit_with_sticking_prints_what_it_says():
    section = TEXT.split("## Numerical stability")[1]
    code, published = re.search(r"```python\n(.*?)```.*?```\n(.*?)```", section, re.DOTALL).groups()
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.split() == published.split()


def test_the_committed_study_loads_as_it_says(monkeypatch):
    (code,) = (text for language, text in BLOCKS if language == "python" and "import load" in text)
    monkeypatch.chdir(README.parent)
    found = {}
    exec(code, found)
    assert len(found["results"].errors) == 24 * 4 * 12 * 2 * 6  # sigma, closure, impact, moment, quantity


def test_pictures_and_links_exist():
    for link in re.findall(r"\]\(([^)#]+)\)", TEXT):
        assert (README.parent / link).exists(), link


@pytest.mark.parametrize("number", range(len(TOML)))
def test_every_toml_example_is_read_whole(number):
    """A scene says all that it says again; of a study every point and every closure can be computed."""
    if "[study]" not in TOML[number]:
        scene = Scene.from_toml(TOML[number])
        assert Scene.from_toml(scene.to_toml()) == scene
        return
    study = Study.from_toml(TOML[number])
    assert len(study.points) == 48
    assert not [why for p in study.points for why in p.reasons.values()]


@pytest.mark.usefixtures("undrawn")
def test_the_study_in_it_runs_to_the_end(tmp_path):
    (text,) = (t for t in TOML if "[study]" in t)
    file = tmp_path / "study.toml"
    file.write_text(smaller(text))
    found = rattle("study", str(file))
    assert found.exit_code == 0, found.output
    assert "cannot be computed" not in found.output


@pytest.mark.usefixtures("undrawn")
def test_every_shell_example_runs_or_says_why_not(tmp_path, monkeypatch):
    """In the order of the README, but that what is shown or repeated is there before."""
    for name in ("noise", "restitution"):
        file = tmp_path / "reports" / "studies" / f"{name}.toml"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(smaller((README.parent / "reports" / "studies" / file.name).read_text()))
    (scene,) = (t for t in TOML if "[study]" not in t)
    (tmp_path / "SCENE.toml").write_text(scene)
    monkeypatch.chdir(tmp_path)
    first = ("validate [", "show", "validate --repeat", "")
    ran = [words for words in examples() if words not in NOT_RUN]
    assert len(ran) >= 7
    for words in sorted(ran, key=lambda w: next(i for i, start in enumerate(first) if start in w)):
        program, command, *rest = shlex.split(words.replace("[SCENE.toml]", "SCENE.toml"))
        assert program == "rattle", words
        if "--repeat" in rest:  # of a report that is there and small
            (tmp_path / "reports" / "dat21").mkdir()
            manifest = (tmp_path / "reports" / "mine" / "manifest.json").read_text()
            (tmp_path / "reports" / "dat21" / "manifest.json").write_text(manifest)
        else:
            rest += APPENDED.get(command, "").split()
        found = rattle(command, *rest)
        assert found.exit_code == 0, (words, found.output)


def test_every_command_that_it_names_is_there():
    for name in set(re.findall(r"`rattle (\w+)`", TEXT)):
        assert rattle(name, "--help").exit_code == 0, name
