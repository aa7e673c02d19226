"""The report of the long run: exact values, closures with verdicts, physical units, the command,
and refusals."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from commands import rattle
from refusals import refusal, refusal_in_words
from scenes import IMPACT_PAIR, dat21

import rattle as rt
from rattle import Scene, Start
from rattle.closure.stationary import linear_law
from rattle.compare.stationary.page import answer
from rattle.montecarlo.long_run.estimates import estimates
from rattle.montecarlo.long_run.sums import NUMBER, SLOW
from rattle.scene.long_orbit import attractor

RESTING = {"alpha": 0.1, "epsilon": 0.3, "beta1": 0.1, "gamma1": 1.0, "stages": 1}


def test_periodic_orbit_without_noise_is_exact():
    found = rt.stationary(IMPACT_PAIR)
    assert "period of the excitation" in found.said
    assert found.table["se"]["rate"] == 0.0
    value = found.table["value"]
    assert value["rate"] == pytest.approx(1.0 / math.pi)
    assert value["energy"] == pytest.approx(
        0.5 * 0.75 * (value["speed"] ** 2 + value["sd_speed"] ** 2)
    )


@pytest.mark.parametrize("sigma", [0.0, 1e-3])
def test_motion_that_comes_to_rest_says_so(sigma):
    found = rt.stationary(Scene(**RESTING, sigma=sigma))
    assert "rest" in found.said
    assert found.table["value"]["rate"] == 0.0
    assert found.table["value"]["contact_share_mesh1"] == 1.0
    assert found.densities == ()


def test_several_attractors_are_named_with_their_shares():
    """Beside the symmetric orbit with two impacts a period there is one with six impacts in three
    periods."""
    with refusal(
        r"(?s)of 12 starts, the motion of \d+%.*3 periods of the excitation and 6 impacts"
    ):
        rt.stationary(Scene(alpha=0.3, epsilon=0.8, beta1=0.05, gamma1=0.0, stages=1))


def test_attractors_that_the_noise_does_not_connect_have_no_one_long_run():
    """One path bounces once a period, as it starts; all others come to rest: no average says
    anything."""
    ball = Scene.load("examples/ball.toml")
    with refusal_in_words(
        "that the noise does not connect",
        "or noise that connects them",
        "comes to rest for good: a contact stays closed",
    ):
        rt.stationary(replace(ball, alpha=0.6, sigma=0.03), budget=1.0)


def test_an_error_that_nobody_knows_is_not_stated():
    """Of 64 paths one alone had impacts that are not slow, and their mean speed has no error."""
    found = rt.stationary(dat21(0.5), periods=64, paths=64, closures=[])
    sums = found.run.sums
    main = sums.main.copy()
    power = sums.power.copy()
    main[1:] = power[1:] = 0.0  # planted
    main[:, :, :NUMBER] = 0.0  # nothing that is known of the noise
    planted = estimates(sums._replace(main=main, power=power))
    assert np.isnan(planted["energy"].se)
    said = " ".join(
        answer(replace(found, table=pd.DataFrame(planted, index=found.table.columns).T))
    )
    assert "(error not known)" in said
    assert "impacts per unit" not in said
    assert "at most" in said


def test_linear_law_of_two_stages():
    """A cycle through both meshes; its stationary sds against the far end of the closure itself."""
    weak = replace(dat21(1e-4), alpha=0.2, start=None)
    end = attractor(weak)
    law = linear_law(weak, end)
    begin = Start(float(end.tau[0]), *end.before[0].tolist(), mesh=int(end.mesh[0]))
    far = rt.mean_map(replace(weak, start=begin), impacts=150 * end.impacts)
    far = far.section[-end.impacts :]
    assert sorted(far["sd_y1"].where(far["mesh"] == 1, far["sd_y2"])) == pytest.approx(
        sorted(law.sd_speed), rel=1e-5
    )
    assert sorted(far["sd_flight"]) == pytest.approx(sorted(law.sd_flight), rel=1e-5)


def test_intervals_that_rest_on_few_paths_are_named():
    """A few paths carry nearly all slow impacts: the interval is wider for that, and the answer
    says so."""
    found = rt.stationary(dat21(0.5), periods=64, paths=32, closures=[])
    assert "slow_share" not in found.few.index
    sums = found.run.sums
    main = sums.main.copy()
    main[3, 0, SLOW] += 400.0  # planted: one burst
    planted = estimates(sums._replace(main=main), ("slow_share",))["slow_share"]
    # what is left of it in the other paths' control variates counts too
    assert planted.effective_paths < 3.0
    assert planted.high - planted.low > 8.0 * planted.se  # 4 for normal parts
    assert planted.low == 0.0  # as a share is never less
    found.table.loc["slow_share", "effective_paths"] = 2.2
    assert "`slow_share` rests on about 2 of 32 paths" in " ".join(answer(found))


def test_command_draws_the_bifurcation_with_noise(tmp_path):
    out = tmp_path / "report"
    words = "stationary --sigma 0.3 --periods 64 --paths 32 --no-closures --over epsilon=0.7:0.9:2"
    assert "impacts a second" in rattle(f"{words} --out {out}").output
    assert (out / "bifurcation.svg").exists()
    assert set(pd.read_csv(out / "bifurcation.csv").iloc[:, 0]) == {"without noise", "with noise"}


def test_a_diagram_without_impacts_is_refused_before_the_long_run(monkeypatch, tmp_path):
    monkeypatch.setattr("rattle.compare.stationary.measure.stationary", None)
    scene = tmp_path / "resting.toml"
    scene.write_text(Scene(**RESTING | {"sigma": 0.01}).to_toml())
    done = rattle(f"stationary {scene} --over alpha=0.1:0.2:2 --out {tmp_path / 'report'}", code=2)
    assert "mesh 1 is not struck" in done.output
