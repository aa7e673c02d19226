"""Gears that come to rest do not look as if they rattle: every command says first that its impacts
are a transient."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from commands import rattle
from places import EXAMPLES

import rattle as rt
from rattle import DAT21, Order, Scene, Start
from rattle.compare.stationary.page import answer as long_answer
from rattle.compare.validation.transient import describe_transient
from rattle.scene.changes import change

PAIR = replace(DAT21, epsilon=0.6, damping1=0.0, damping2=0.0)
WITHOUT_GEARS = {"alpha": 1.0, "epsilon": 0.9, "beta1": 0.1, "gamma1": 0.3, "mu": 0.4}
REST = "not rattle in the long run: "


def one(torque, **scene):
    return Scene.from_gears(replace(PAIR, torque1=torque), stages=1, **scene)


def two(torque1, torque2, **scene):
    return Scene.from_gears(replace(PAIR, torque1=torque1, torque2=torque2), **scene)


QUIET_BOX = Scene.load(EXAMPLES / "gearbox5.toml").noise_free
TRANSIENTS = {
    "one stage": (
        one(9000.0),
        (
            "These gears do not rattle in the long run: the drag torque on wheel 1 is 9,000 N mm,"
            " above the threshold of 2,634"
        ),
    ),
    "held by wheel 2": (
        two(100.0, 9000.0),
        "2,557 N mm, which holds wheel 1 too. The first impacts are the transient",
    ),
    "orders": (
        one(30_000.0, drive=(Order(1), Order(3, 0.3, 1.0))),
        "is 30,000 N mm, above the threshold of 9,126 N mm. The first",
    ),
    "no gears": (
        Scene(**WITHOUT_GEARS | {"gamma1": 1.5}, stages=1),
        "This motion does not rattle in the long run: gamma1 is 1.5, above the threshold",
    ),
    "about to stick": (
        one(9000.0, start=Start(0.0, 0.5, 1e-9, 0.0, 0.0, 1)),
        "These gears do not rattle in the long run: ",
    ),
    "mesh 2 alone": (
        Scene(**WITHOUT_GEARS, gamma2=1.2),
        "Mesh 2 does not open by itself in the long run: gamma2 is 1.2, above",
    ),
    "mesh 3 of a tree": (
        change(QUIET_BOX, {"wheel.second.torque": 4000.0, "wheel.layshaft.torque": 20.0}),
        "Mesh 3 (second) does not open by itself in the long run: the drag torque on wheel second",
    ),
    "meshes of a tree": (
        change(QUIET_BOX, {"wheel.second.torque": 4000.0, "wheel.fifth.torque": 4000.0}),
        "mesh 5 (fifth) do not open by themselves in the long run: the drag torque on wheel",
    ),
    "mesh 1 alone": (
        Scene(**WITHOUT_GEARS | {"gamma1": 2.0}, gamma2=0.2),
        "Mesh 1 does not open by itself in the long run: gamma1",
    ),
}


@pytest.mark.parametrize("case", TRANSIENTS)
def test_what_does_not_open_is_said_with_the_threshold(case):
    scene, said = TRANSIENTS[case]
    assert said in describe_transient(scene)


@pytest.mark.parametrize("torque", [100.0, 2000.0])
def test_nothing_is_said_of_gears_that_rattle(torque):
    """Chatter that ends with closed teeth in each period, too."""
    assert describe_transient(one(torque)) == ""
    assert describe_transient(two(torque, torque, sigma=0.1)) == ""


def test_nothing_is_said_where_the_motion_goes_on_above_the_threshold():
    """As a ball can go on bouncing on a table whose acceleration is below that of gravity."""
    scene = Scene(alpha=1.0, epsilon=1.0, beta1=0.0, gamma1=1.05, stages=1)
    assert not any(wheel.opens for wheel in rt.rattle_threshold(scene))
    assert describe_transient(scene) == ""


@pytest.mark.usefixtures("undrawn")
def test_every_command_says_it_first(tmp_path):
    path = tmp_path / "quiet.toml"
    path.write_text(one(9000.0, sigma=0.02).to_toml())
    assert rattle("simulate --paths 64 --impacts 3", path).output.startswith(
        f"Without noise these gears do {REST}"
    )
    short = "validate --paths 256 --impacts 2 --no-validity --closure saltation --json --out"
    found = json.loads(rattle(short, tmp_path / "page", path).stdout)
    assert REST in found["long_run"] == found["answer"][0]
    page = (tmp_path / "page/report.md").read_text()
    assert page.index(REST) < page.index("For this gear pair")


def test_noise_at_rest_has_a_bound_in_place_of_zero():
    """Of a Poisson count of which none was seen: 3 in the time that was watched."""
    found = rt.stationary(one(9000.0, sigma=0.02), paths=32, rng=1)
    rate = found.table.loc["rate"]
    periods = int(re.search(r"in the last (\d+) periods", found.said)[1])
    assert (rate["value"], rate["low"]) == (0.0, 0.0)
    assert rate["high"] == pytest.approx(3.0 / (2.0 * np.pi * 32 * periods), rel=2e-3)
    assert np.isnan(found.table["high"]["power"])  # of impacts that were not seen
    assert long_answer(found)[0].startswith(
        "No impact was seen in the long run, so none faster than 6 mm/s (fewer"
    )
    exact = long_answer(rt.stationary(one(9000.0)))[0]
    assert exact.endswith("the motion comes to rest for good.")
