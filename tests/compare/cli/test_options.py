"""Options as they are typed: whole numbers, names, completion, units; the template and the
examples."""

import io
import json
import math
import re
import tomllib
import unicodedata
from contextlib import redirect_stdout
from dataclasses import fields, replace
from inspect import signature
from pathlib import Path

import pytest
from click.shell_completion import ShellComplete
from commands import rattle, study
from hypothesis import given
from hypothesis import strategies as st

from rattle import boundary
from rattle.closure import CLOSURES
from rattle.compare.checks.stability.chart import AXES
from rattle.compare.cli import shared
from rattle.compare.cli.main import main
from rattle.compare.cli.shared import say
from rattle.compare.cli.show import template
from rattle.compare.parameters.boundary import SIGMA_RANGE
from rattle.compare.parameters.sensitivity import default_quantities
from rattle.compare.stationary.verdicts import CLOSURES_JUDGED
from rattle.compare.tradeoff.measure import ACCURACIES
from rattle.montecarlo import SCHEMES, default_step, simulate
from rattle.montecarlo.accuracy.simulate_to import INSTEAD
from rattle.montecarlo.long_run.run import ASKED, LONG_RUN_ACCURACY
from rattle.scene import DAT21, Gears, Scene, Start, Tolerance

EXAMPLES = sorted((Path(__file__).resolve().parents[3] / "examples").glob("*.toml"))


@pytest.mark.parametrize(
    ("listed", "table"),
    [(shared.SCHEME_NAMES, SCHEMES), (shared.CLOSURE_NAMES, CLOSURES), (shared.AXIS_NAMES, AXES)],
)
def test_the_lists_of_the_options_are_those_of_the_modules(listed, table):
    assert sorted(listed) == sorted(table)


@pytest.mark.parametrize(
    ("text", "number"), [("1e5", 100_000), ("1_000", 1000), ("-3", -3), (7, 7), ("1.5e1", 15)]
)
def test_a_whole_number_is_read_as_people_write_it(text, number):
    found = shared.WHOLE.convert(text, None, None)
    assert (found, type(found)) == (number, int)


@pytest.mark.parametrize("text", ["1.5", "1e-3", "many", "nan", "inf", "1e999999999", ""])
def test_another_number_is_refused_at_once(text):
    assert "is not a whole number" in rattle("simulate", "--paths", text, code=2).output


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("validate", "--closure", "nowhere:mine"),
            "closures = 'nowhere:mine': cannot be imported",
        ),
        (
            ("stationary", "--closure", "own:mine"),
            "closure = 'own:mine': predicts impacts, not the long run",
        ),
        (("check", "stability", "--axis", "gup"), "axis = 'gup': did you mean 'gap'?"),
        (("simulate", "--units", "metric"), "units = 'metric': valid are"),
        (("simulate", "--scheme", "fast"), "scheme = 'fast'"),
        (("simulate", "--accuracy", "0"), "accuracy = 0.0: must be greater than 0"),
        (("simulate", "--sigma", "-1"), "sigma = -1.0"),
        (("simulate", "--out", "no/such/folder/table.csv"), "does not exist"),
        (
            ("simulate", "--paths", "10", "--scheme", "exact-flight", "--dt", "1"),
            "dt = 1.0: must be at most",
        ),
    ],
)
def test_what_is_wrong_is_one_line_and_code_2(words, message):
    assert message in rattle(*words, code=2).output


def test_help_lists_the_names_and_tells_of_completion():
    assert "[euler-maruyama|euler-maruyama-located|exact-flight]" in rattle(
        "simulate", "--help"
    ).output.replace("\n", "")
    assert "saltation" in rattle("validate", "--help").output
    assert "_RATTLE_COMPLETE=bash_source" in rattle("--help").output


def test_the_shell_completes_names():
    found = ShellComplete(main, {}, "rattle", "_RATTLE_COMPLETE").get_completions(
        ["simulate", "--scheme"], "ex"
    )
    assert [item.value for item in found] == ["exact-flight"]


def test_simulate_in_physical_units(tmp_path):
    shared = ("simulate", "--impacts", "2", "--paths", "1e2", "--sigma", "0.1")
    physical = json.loads(rattle(*shared, "--units", "physical", "--json").output)
    plain = json.loads(rattle(*shared, "--json").output)
    assert (physical["units"], plain["units"]) == ("physical", "dimensionless")
    assert (plain["scheme"], plain["paths"], plain["reach"]) == ("exact-flight", 100, None)
    assert len(plain["section"]) == 2
    assert physical["section"][1]["y2_mm_per_s"] == pytest.approx(60.0 * plain["section"][1]["y2"])
    out = rattle(*shared, "--units", "physical", "--out", tmp_path / "table.csv").output
    for name in ("tau_ms", "sd_y1_mm_per_s", "agreement"):
        assert name in out.splitlines()[0]
    assert "impacts_per_s" not in out  # which is said of the long run alone
    assert "tau_ms" in (tmp_path / "table.csv").read_text()


def test_physical_units_of_a_scene_without_gears_are_refused_before_the_work(tmp_path):
    path = tmp_path / "plain.toml"
    path.write_text("[scene]\nalpha = 1.5\nepsilon = 0.9\nbeta1 = 0.1\ngamma1 = 0.0\nmu = 0.5\n")
    result = rattle("simulate", path, "--units", "physical", "--accuracy", "1e-9", code=2)
    assert "was not made from gears" in result.output


def test_init_writes_a_scene_that_loads_and_never_replaces_one(tmp_path):
    path = tmp_path / "gears.toml"
    rattle("init", path)
    scene = Scene.load(path)
    assert scene.constants[:11] == pytest.approx(
        Scene.from_gears(DAT21, sigma=0.08).constants[:11], rel=1e-12
    )
    path.write_text("mine")
    assert "exists already" in rattle("init", path, code=2).output
    assert path.read_text() == "mine"
    rattle("init", tmp_path / "none" / "gears.toml", code=2)


def test_the_template_has_every_key():
    text = template("gears.toml")
    for kind in (Gears, Scene, Start, Tolerance):
        for f in fields(kind):
            assert f"{f.name} = " in text or f.name in (
                "gears",
                "start",
                "tolerance",
                "drive",
            ), f.name
    assert "[[drive]]" in text


def test_a_file_without_noise_is_said_to_have_none_once(tmp_path):
    path = tmp_path / "quiet.toml"
    path.write_text(template("quiet.toml").replace("sigma = 0.08 ", "# "))
    for words in (("--accuracy", "0.05"), ("--paths", "100", "--scheme", "euler-maruyama")):
        result = rattle("simulate", path, "--impacts", "2", *words)
        assert result.output.count(f"{path}: no sigma, so there is no noise") == 1
        assert not re.search(r"moves the noise-free path by .* sd", result.output)
        assert (
            "no sigma"
            not in rattle("simulate", path, "--impacts", "2", *words, "--sigma", "0.1").output
        )


def test_the_mean_rotation_that_the_template_comments_out_adds_to_the_drag():
    text = template("gears.toml")
    for name in ("speed_rpm", "driver_radius"):
        text = text.replace(f"# {name} = ", f"{name} = ")
    gears = Scene.from_toml(text).gears
    speed = 2.0 * math.pi * 800.0 / 60.0 * 30.0
    assert gears.torque1 == pytest.approx(100.0 + 100.0 * speed / 41.0)
    assert gears.torque2 == pytest.approx(50.0 + 100.0 * speed / 26.4)


def test_what_the_template_comments_out_can_be_taken_in():
    lines = template("gears.toml").splitlines()
    begin = lines.index("# [scene.tolerance]          # in place of [gears.tolerance]")
    taken = [line.removeprefix("# ") for line in lines[begin : begin + 5]]
    scene = Scene.from_toml("\n".join([*lines[:begin], *taken]))
    assert scene.tolerance == Tolerance(0.05, 0.05)
    begin = next(i for i, line in enumerate(lines) if line.startswith("# [gears.tolerance]"))
    taken = [line.removeprefix("# ") for line in lines[begin : begin + 5]]
    drawn = Scene.from_toml("\n".join([*lines[:begin], *taken, *lines[begin + 5 :]]))
    assert drawn.tolerance.variances == pytest.approx(scene.tolerance.variances)
    assert replace(drawn, tolerance=None) == replace(scene, tolerance=None)
    plain = [
        line.removeprefix("# ")
        for line in lines[lines.index("# alpha = 1.5              # amplitude of the drive") :]
    ]
    found = Scene(**tomllib.loads("\n".join(plain))).constants
    assert found[:11] == pytest.approx((*drawn.constants[:9], 0.0, 2), abs=1e-6)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_loads_and_simulates(path):
    scene = Scene.load(path)
    run = simulate(scene, paths=64, impacts=3, rng=1)
    assert run.section_in("physical")["tau_ms"].notna().all()
    assert run.unfinished == 0


NAMES = [
    "two\nlines",
    "red \x1b[31m",
    "part\u2028part",
    "turned \u202e",
    "back\rover",
    "tab\tbell\a",
    "n" * 200,
]


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
    scene = tmp_path / f"{name}.toml"
    file = tmp_path / "study.toml"
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


def commands(command=main, path=()):
    """Every command with its name."""
    for name, inner in getattr(command, "commands", {}).items():
        yield from commands(inner, (*path, name))
    if not hasattr(command, "commands"):
        yield " ".join(path), command


STEP = (
    f"the scheme's, {default_step(Scene.from_gears(DAT21), 'euler-maruyama'):g} for Euler-Maruyama"
)
REAL = {
    "animate --sigma": "the scene's; 0.1 on DAT21",
    "boundary --closure": signature(boundary).parameters["closure"].default,
    "boundary --between": f"{SIGMA_RANGE[0]:g} {SIGMA_RANGE[1]:g} for sigma",
    "claims --sigma": "0.01, 0.1",
    "simulate --accuracy": "0.01",
    "simulate --dt": STEP,
    "simulate --budget": f"an hour; beyond it the answer is what {INSTEAD:g} s give",
    "stationary --accuracy": f"{LONG_RUN_ACCURACY:g}",
    "stationary --quantity": ", ".join(ASKED),
    "tradeoff --sigma": "the scene's, or 0.1",
    "tradeoff --accuracy": f"{ACCURACIES[0]:g} to {ACCURACIES[-1]:g}",
    "validate --dt": STEP,
}
"""Defaults that a help text states in words of its own and that hold a number or a name."""


def test_every_default_that_a_help_states_is_the_real_one():
    stated = {
        f"{name} {option.opts[0]}": found[1]
        for name, command in commands()
        for option in command.params
        if (found := re.search(r"\[default: (.*)\]", getattr(option, "help", None) or ""))
    }
    checked = {
        key: text
        for key, text in stated.items()
        if re.search(r"\d|_", text) and "sqrt(alpha)" not in text
    }
    assert checked | {"boundary --closure": stated["boundary --closure"]} == REAL
    assert set(CLOSURES_JUDGED) == set(CLOSURES)  # "all"
    assert set(default_quantities(1)) == {"power", "rate_above", "speed_above", "q95_speed_above"}


def test_init_recommends_what_answers_in_seconds_whatever_the_gears_are(tmp_path, monkeypatch):
    """A number of paths, not an accuracy, which a soft pair reaches after minutes."""
    monkeypatch.chdir(tmp_path)
    said = rattle("init", "gears.toml").output
    command = re.search(r"in seconds: rattle (.*)", said)[1]
    assert "--paths 10000" in command
    soft = (tmp_path / "gears.toml").read_text().replace("epsilon = 0.9", "epsilon = 0.3")
    (tmp_path / "gears.toml").write_text(soft)
    assert "10,000 paths" in rattle(*command.split()).output
