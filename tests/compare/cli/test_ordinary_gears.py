"""Every command that takes a scene, on an engineer's gear pair, whose motion sticks."""

import pytest
from commands import commands, rattle
from places import ORDINARY_PAIR

SMALL_ON_PAIR = {
    "animate": "--impacts 5 --out",
    "assess": "--budget 5 --out",
    "boundary": "--impacts 2 --over sigma=0.001:2:3 --width 0.4 --out",
    "chaos": "--points 200 --impacts 20000 --events 128 --width 0.5 --over alpha=0.8:15:2 --out",
    "check order": "--impacts 2 --paths 1000",
    "run-up": "--over speed_rpm=800:900:2 --seconds 1 --budget 1 --out",
    "sensitivity": "--parameter epsilon --quantity power --accuracy 1 --out",
    "simulate": "--impacts 3 --paths 500 --out",
    "stationary": "--periods 64 --paths 16 --burn-in 10 --out",
    "tradeoff": "--impacts 2 --budget 0.2 --no-orders --accuracy 0.3 --out",
    "validate": "--impacts 3 --paths 2000 --no-validity --out",
}
COMMANDS_ON_PAIR = [
    command
    if command in ("animate", "check order", "simulate", "validate")
    else pytest.param(command, marks=pytest.mark.slow)
    for command in SMALL_ON_PAIR
    if command != "chaos"  # which runs on the pair in tests/compare/chaos
]


def test_these_are_all_commands_that_take_a_scene():
    assert {
        name for name, command in commands() if any(p.name == "scene" for p in command.params)
    } == set(SMALL_ON_PAIR)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("command", COMMANDS_ON_PAIR)
def test_every_command_runs(command, tmp_path):
    words = f"{command} {ORDINARY_PAIR} {SMALL_ON_PAIR[command]}"
    if not words.endswith("--out"):
        rattle(words)
        return
    out = tmp_path / {"animate": "out.html", "simulate": "out.csv"}.get(command, "out")
    rattle(f"{words} {out}")
    assert out.is_file() or any(path.suffix == ".html" for path in out.iterdir())
