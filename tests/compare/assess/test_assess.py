"""The engineer's answer: its four parts, its requirement, its page and command, and bad input."""

from dataclasses import replace

import pandas as pd
import pytest
from commands import rattle, strict
from refusals import refusal
from scenes import dat21

from rattle import DAT21, Gears, Scene, assess
from rattle.compare import Boundary
from rattle.compare.assess.assess import assess_in_rounds
from rattle.compare.assess.assessment import describe_use
from rattle.compare.assess.requirement import Fulfilment, read_requirement

HELD = replace(DAT21, torque1=1e5, torque2=1e5)  # more drag than the drive can overcome
ASSESSED_WITH = {"require": None, "slow": 0.1, "rng": 0, "workers": 1, "progress": None}


@pytest.fixture(scope="module")
def loud():
    return assess(dat21(0.5), budget=5.0, require="rate_above > 10", rng=3)


def test_the_four_answers_agree_with_their_parts(loud):
    does, hard, helps, use, required, took = loud.answer
    assert loud.rattles
    assert does.startswith("Does it rattle? Yes.")
    rate = loud.table.loc["rate_above"]
    assert rate["unit"] == "1/s"
    assert rate["low"] < float(hard.split()[2].replace(",", "")) < rate["high"]
    assert "Mesh 2:" in hard
    levers = loud.levers.of("power")
    assert levers.index[0] == "epsilon"
    assert levers["low"]["omega"] > 0.0
    assert "a higher restitution (1 % more:" in helps
    assert "`branching`" in use
    assert required == "Required: `rate_above > 10`. Met."
    assert "of 5 processor seconds" in took


def test_one_wheel_without_units():
    hard = assess(
        Scene(alpha=1.0, epsilon=0.8, beta1=0.1, gamma1=0.1, stages=1, sigma=0.2), budget=5.0
    ).answer[1]
    assert "a unit of time are faster than 0.1;" in hard
    assert "Mesh" not in hard


def test_what_cannot_be_known_is_said():
    """Without noise there may be several motions, and then no one long run."""
    found = assess(Scene(alpha=0.3, epsilon=0.8, beta1=0.05, gamma1=0.0, stages=1), budget=5.0)
    assert found.motion is None
    assert "attractors" in found.missing["the long run"]
    assert "The long run is not known" in found.answer[0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("rate_above < 70", Fulfilment.MET),
        ("rate_above<30", Fulfilment.MISSED),
        ("rate_above > 70", Fulfilment.MISSED),
        ("rate_above < 50", Fulfilment.OPEN),
        ("power < 50", Fulfilment.UNKNOWN),
    ],
)
def test_a_requirement_is_decided_by_the_whole_interval(text, expected):
    motion = pd.DataFrame({"low": [40.0], "high": [60.0]}, index=["rate_above"])
    assert read_requirement(text, 2).decide(motion) is expected


def points(*rows):
    """A search along the noise that judged these values."""
    return Boundary(
        dat21(0.5), "saltation", "sigma", (), pd.DataFrame(rows, columns=["value", "verdict"]), 0
    )


def test_a_closure_is_used_only_where_it_is_accurate():
    edge = points((0.01, "accurate"), (0.1, "accurate"), (1.0, "inaccurate"), (2.0, "accurate"))
    assert "it can be used" in describe_use(edge, 0.05)
    assert "not decided" in describe_use(edge, 0.5)
    assert "do not use it" in describe_use(edge, 1.5)
    assert "do not use it" in describe_use(points((0.01, "inaccurate")), 0.005)
    assert describe_use(points((0.01, "undecided")), 0.01) == "is not decided"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"budget": 1.0}, "budget = 1.0: give 5 processor seconds or more"),
        ({"require": "rate_above = 50"}, "write QUANTITY < NUMBER"),
        ({"require": "rate_abov < 50"}, "did you mean 'rate_above'"),
        ({"require": "rate_above < many"}, "'many' is not a number"),
    ],
)
def test_bad_input_is_named_before_any_work(settings, message):
    with refusal(message):
        assess_in_rounds(dat21(0.5), **{"budget": 60.0, **ASSESSED_WITH, **settings})


def test_a_larger_budget_gives_a_first_answer_and_a_better_one():
    first, better = assess_in_rounds(HELD, budget=24.0, **ASSESSED_WITH)
    assert first.motion is better.motion  # exact already


def test_gears_are_taken_as_they_are():
    found = assess(
        Gears(
            alpha=1.0,
            epsilon=0.5,
            omega=170.0,
            inertia1=950.0,
            radius1=38.0,
            backlash1=0.12,
            torque1=1e6,
        ),
        budget=5.0,
    )
    assert not found.rattles
    assert found.answer[0].startswith("Does it rattle? No. The motion comes to rest")
    assert not any(text.startswith(("How hard", "What helps")) for text in found.answer)


@pytest.mark.usefixtures("undrawn")
def test_the_command_writes_its_page_and_ends_by_the_requirement(tmp_path):
    file = tmp_path / "held.toml"
    file.write_text(Scene.from_gears(HELD, sigma=0.01).to_toml())
    out = tmp_path / "report"
    rattle(f"assess {file} --budget 5 --require 'rate_above < 50' --out {out}")
    page = (out / "assess.md").read_text()
    assert "Does it rattle? No." in page
    assert "threshold.svg" in page
    facts = strict(
        rattle(f"assess {file} --budget 5 --require 'rate_above > 50' --json", code=3).stdout
    )
    assert facts["rattles"] is False
    assert facts["requirement"] == {"text": "rate_above > 50", "fulfilment": "not met"}
    rattle(f"assess {file} --require 'rate < '", code=2)
