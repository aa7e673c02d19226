"""Every command that takes a scene, on an engineer's gear pair, whose motion sticks, and on one of
the examples."""

from pathlib import Path

import pytest
from commands import commands, rattle

HERE = Path(__file__).parent
EXAMPLES = HERE.parents[2] / "examples"
SMALL = {
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
ON_EXAMPLES = {
    "animate": "drawing-tolerances",
    "assess": "single-stage",
    "boundary": "single-stage",
    "chaos": "single-stage",
    "check order": "gearbox",
    "sensitivity": "drawing-tolerances",
    "stationary": "single-stage",
    "tradeoff": "gearbox",
    "validate": "gearbox",
}
"""Each command once: all of them on all examples take ten minutes; `simulate` runs on every one
elsewhere."""
QUICK = [
    (command, HERE / "pair.toml") for command in ("animate", "check order", "simulate", "validate")
]
# `chaos` runs on the pair in tests/compare/chaos
ELSEWHERE = (*dict(QUICK), "chaos")
LONG = [(command, HERE / "pair.toml") for command in SMALL if command not in ELSEWHERE]
LONG += [(command, EXAMPLES / f"{name}.toml") for command, name in ON_EXAMPLES.items()]
CASES = QUICK + [pytest.param(*case, marks=pytest.mark.slow) for case in LONG]


def test_these_are_all_commands_that_take_a_scene():
    takes = {name for name, command in commands() if any(p.name == "scene" for p in command.params)}
    assert takes == set(SMALL)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("command", "scene"), CASES, ids=lambda part: part if isinstance(part, str) else part.stem
)
def test_every_command_runs(command, scene, tmp_path):
    words = f"{command} {scene} {SMALL[command]}"
    if not words.endswith("--out"):
        rattle(words)
        return
    out = tmp_path / {"animate": "out.html", "simulate": "out.csv"}.get(command, "out")
    rattle(f"{words} {out}")
    assert out.is_file() or any(path.suffix == ".html" for path in out.iterdir())
