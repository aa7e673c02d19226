"""The scene file that ``rattle init`` writes: it loads, it has every key, and what it comments out
can be taken in."""

import math
import re
import tomllib
from dataclasses import fields

import pytest
from commands import rattle
from places import EXAMPLES

from rattle import DAT21, Gears, Scene, Start, Tolerance, rattle_threshold


@pytest.fixture
def file(tmp_path):
    rattle(f"init {tmp_path / 'gears.toml'}")
    return tmp_path / "gears.toml"


def numbers(scene):
    wheels = [(w.beta, w.gamma, w.gap, w.mass, w.epsilon) for w in scene.tree]
    return [scene.alpha, *(value for values in wheels for value in values)]


def test_it_loads_and_replaces_nothing(file):
    scene = Scene.load(file)
    assert numbers(scene) == pytest.approx(numbers(Scene.from_gears(DAT21)), rel=1e-12)
    assert scene.sigma == 0.08
    file.write_text("mine")
    assert "exists already" in rattle(f"init {file}", code=2).output
    assert file.read_text() == "mine"


def test_it_has_every_key(file):
    text = file.read_text()
    of_others = {"wheels", "state", "noise", "bodies"}  # of more than two wheels, of no gears
    keys = {field.name for kind in (Gears, Scene, Start, Tolerance) for field in fields(kind)}
    assert not [
        key
        for key in keys - {"gears", "start", "tolerance", "drive"} - of_others
        if f"{key} = " not in text
    ]
    assert "[[drive]]" in text


def test_a_file_without_noise_is_said_to_have_none_once(file):
    file.write_text(file.read_text().replace("sigma = 0.08 ", "# "))
    words = f"simulate {file} --impacts 2 --paths 100 --scheme euler-maruyama"
    said = rattle(words).output
    assert said.count(f"{file}: no sigma, so there is no noise") == 1
    assert "moves the noise-free path by" not in said
    assert "no sigma" not in rattle(f"{words} --sigma 0.1").output


def test_what_is_commented_out_can_be_taken_in(file):
    text = file.read_text()
    gears = Scene.from_toml(re.sub("(?m)^# (?=speed_rpm|driver_radius)", "", text)).gears
    assert gears.torque2 == pytest.approx(
        50.0 + 100.0 * (2.0 * math.pi * 800.0 / 60.0 * 30.0) / 26.4
    )
    drawn, scene = (
        Scene.from_toml(text.replace(part, re.sub("(?m)^# ", "", part)))
        for part in re.findall(r"(?s)# \[\w+\.tolerance\].*?\n\n", text)
    )
    assert scene.tolerance == Tolerance(0.05, 0.05)
    widths, expected = ([wheel.tolerance for wheel in s.tree] for s in (drawn, scene))
    assert widths == pytest.approx(expected)
    plain = re.sub("(?m)^# ", "", text.partition("all dimensionless:")[2])
    assert numbers(Scene(**tomllib.loads(plain))) == pytest.approx(numbers(drawn), abs=1e-5)


def test_what_it_recommends_answers_in_seconds_whatever_the_gears_are(tmp_path, monkeypatch):
    """A number of paths, not an accuracy, which a soft pair reaches after minutes."""
    monkeypatch.chdir(tmp_path)
    words = re.search(r"in seconds: rattle (.*)", rattle("init").output)[1]
    file = tmp_path / "gears.toml"
    file.write_text(file.read_text().replace("epsilon = 0.9", "epsilon = 0.3"))
    assert "10,000 paths" in rattle(words).output


def test_a_gearbox_loads_and_has_every_key_of_a_wheel(tmp_path):
    for wheels in (5, 32):
        file = tmp_path / f"box{wheels}.toml"
        rattle(f"init {file} --wheels {wheels}")
        thresholds = rattle_threshold(Scene.load(file))
        assert [wheel.opens for wheel in thresholds] == [True] * wheels
    text = (tmp_path / "box5.toml").read_text()
    assert not [field.name for field in fields(Gears.Wheel) if f"{field.name} = " not in text]
    assert (
        "wheels = 33: must be at most 32"
        in rattle(f"init {tmp_path / 'box33.toml'} --wheels 33", code=2).output
    )


@pytest.mark.parametrize(("system", "body"), [("ball", 1), ("oscillator", 1), ("pair", 0)])
def test_another_system_loads_simulates_and_is_an_example(system, body, tmp_path):
    file = tmp_path / "mine.toml"
    assert "mine.toml --paths 10000" in rattle(f"init {file} --system {system}").output
    scene = Scene.load(file)
    assert (scene.bodies, scene.noisy_wheel) == (True, body)
    run = rattle(f"simulate {file} --paths 100 --impacts 2").output
    assert "of the body" in run
    assert not re.search(r"wheel|gear|teeth", run)
    name = system.replace("pair", "impact-pair")
    assert file.read_text() == (EXAMPLES / f"{name}.toml").read_text().replace(
        f"{name}.toml", "mine.toml"
    )


def test_a_file_without_a_name_has_that_of_its_system(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rattle("init --system ball")
    assert (tmp_path / "ball.toml").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [("bal", "did you mean 'ball'"), ("ball --wheels 2", "give one of them")],
)
def test_a_wrong_system_is_refused(words, said, tmp_path):
    file = tmp_path / "mine.toml"
    assert said in rattle(f"init {file} --system {words}", code=2).output
    assert not file.exists()
