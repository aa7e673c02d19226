"""Options as they are typed: names, completion, units and defaults; and what is printed is one
line."""

import io
import json
import unicodedata
from contextlib import redirect_stdout
from inspect import signature

import pytest
from click.shell_completion import ShellComplete
from commands import commands, rattle
from hypothesis import given
from hypothesis import strategies as st
from places import EXAMPLES

from rattle import DAT21, Scene, boundary, boundary_map, simulate
from rattle.closure import CLOSURES
from rattle.compare.animation.record import SHOWN_PERIODS
from rattle.compare.cli.main import main
from rattle.compare.cli.shared import say
from rattle.compare.cli.simulate import STATIONARY_BUDGET
from rattle.compare.parameters.search import SEARCH_BUDGET
from rattle.compare.parameters.sensitivity import EFFECT_ACCURACY
from rattle.compare.study.parameters import SIGMA_RANGE
from rattle.compare.tradeoff.measure import ACCURACIES
from rattle.montecarlo import SCHEMES, default_step
from rattle.montecarlo.accuracy.simulate_to import INSTEAD
from rattle.montecarlo.long_run.run import ASKED, LONG_RUN_ACCURACY, LONG_RUN_PATHS, SET_PATHS
from rattle.montecarlo.schemes.quiet import QUIET_SHARE


def complete(words, begin=""):
    """What the shell offers after the words that stand there."""
    shell = ShellComplete(main, {}, "rattle", "_RATTLE_COMPLETE")
    return [item.value for item in shell.get_completions(words.split(), begin)]


@pytest.mark.parametrize(
    ("words", "table"),
    [
        ("simulate --scheme", SCHEMES),
        ("validate --closure", CLOSURES),
    ],
)
def test_the_shell_completes_the_names_of_the_modules(words, table):
    assert sorted(complete(words)) == sorted(table)
    assert complete(words, "e") == [name for name in complete(words) if name.startswith("e")]


def test_simulate_in_physical_units(tmp_path):
    words = "simulate --impacts 2 --paths 1e2 --sigma 0.1"
    physical = json.loads(rattle(f"{words} --units physical --json").output)
    plain = json.loads(rattle(f"{words} --json").output)
    assert (physical["units"], plain["units"]) == ("physical", "dimensionless")
    assert physical["section"][1]["y2_mm_per_s"] == pytest.approx(60.0 * plain["section"][1]["y2"])
    rattle(f"{words} --units physical --out {tmp_path / 'table.csv'}")
    assert "tau_ms" in (tmp_path / "table.csv").read_text()


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_an_example_loads_and_simulates(path):
    scene = Scene.load(path)
    run = simulate(scene, paths=64, impacts=3, rng=1)
    assert (run.section_in("physical") if scene.gears else run.section).iloc[:, 0].notna().all()
    assert run.unfinished == 0


@given(st.text())
def test_whatever_is_said_is_one_line(text):
    with redirect_stdout(io.StringIO()) as out:
        say(f"Page: {text}")
    *line, end = out.getvalue()
    assert end == "\n"
    assert not {unicodedata.category(c) for c in line} & {"Cc", "Cf", "Zl", "Zp"}


STEP_DEFAULT = (
    f"the scheme's, {default_step(Scene.from_gears(DAT21), 'euler-maruyama'):g} for Euler-Maruyama"
)
DEFAULTS = signature(boundary).parameters
REAL = {
    "animate --periods": f"{SHOWN_PERIODS}",
    "boundary --closure": DEFAULTS["closure"].default,
    "boundary --budget": f"{SEARCH_BUDGET:g}; none with --and",
    "boundary --over": (
        f"sigma={SIGMA_RANGE[0]:g}:{SIGMA_RANGE[1]:g}:{DEFAULTS['points'].default}; a fourth of"
        " another's value to four times it"
    ),
    "boundary --and": (
        f"half its value to twice it, {signature(boundary_map).parameters['values'].default} values"
    ),
    "sensitivity --accuracy": f"{EFFECT_ACCURACY:g}",
    "simulate --dt": STEP_DEFAULT,
    "simulate --budget": f"an hour; beyond it the answer is what {INSTEAD:g} s give",
    "stationary --accuracy": f"{LONG_RUN_ACCURACY:g}",
    "stationary --budget": f"{STATIONARY_BUDGET:g}; with --periods refused above an hour",
    "stationary --paths": (
        f"{LONG_RUN_PATHS}; {SET_PATHS} where each is a gear set with backlashes of its own"
    ),
    "stationary --quantity": ", ".join(ASKED),
    "stationary --resolve": f"slow / {1.0 / QUIET_SHARE:g}",
    "tradeoff --accuracy": f"{ACCURACIES[0]:g} to {ACCURACIES[-1]:g}",
    "validate --dt": STEP_DEFAULT,
}
"""Defaults that a help text states in words of its own and that hold a number or a name."""


def test_the_defaults_that_a_help_states_are_the_real_ones():
    options = {
        f"{name} {option.opts[0]}": getattr(option, "help", None) or ""
        for name, command in commands()
        for option in command.params
    }
    for option, default in REAL.items():
        assert f"[default: {default}]" in options[option], option
