"""Effects of parameters against exact laws, with planted errors; what is not linear; bad input."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from refusals import refusal
from searches import WEAK, page_of

from rattle import mean_map, sensitivity
from rattle.compare import closure_sensitivity
from rattle.compare.parameters.sensitivity import _effect
from rattle.compare.study.parameters import RELATIVE_CHANGES


def test_the_energy_lost_follows_the_balance(results):
    """Twice the noise, four times the power; restitution and gap do not matter.  Three checks, 4
    errors each."""
    balance = results["balance"]
    rows = balance.of("power")
    with refusal("quantity = 'flight'"):
        balance.of("flight")
    exact = pd.Series({"sigma": 1.01**2 - 1.0, "epsilon": 0.0, "gap1": 0.0})
    assert ((rows["effect"] - exact).abs() < 4.0 * rows["se"] + 1e-12)[exact.index].all()
    planted = 1.01 - 1.0  # the power in proportion to the noise
    assert abs(rows["effect"]["sigma"] - planted) > 4.0 * rows["se"]["sigma"]
    assert abs(balance.values["value"]["power"] - 0.25) < 0.01


def logs(power, noise=0.0, bend=0.0, groups=6):
    """Logarithms at each factor of a quantity that grows as a power, with noise and a term of third
    order."""
    x = np.log([1.0 + sign * step for step in RELATIVE_CHANGES for sign in (-1.0, 1.0)])
    return power * x + bend * x**3 + noise * np.random.default_rng(5).standard_normal((groups, 4))


def test_what_bends_is_extrapolated_or_called_not_linear():
    found = pd.DataFrame([_effect(logs(2.0, 1e-5, bend), 10) for bend in (0.0, 60.0, 600.0)])
    assert found["linear"].tolist() == [True, True, False]
    assert found["effect"][:2].tolist() == pytest.approx([0.0201, 0.0201], abs=1e-4)
    assert found["large_step"][1] - 0.0201 > 5e-4  # what one step alone would be off by
    assert found["effect"][2] == found["small_step"][2]


def test_intervals_have_their_coverage():
    """2,000 effects of pure noise: 95 % at the least, within 4 standard errors, for an interval
    reaches to where a bend would put the effect; an interval of z in place of t is caught."""
    noise = 0.01 * np.random.default_rng(7).standard_normal((2000, 4, 4))
    found = pd.DataFrame([_effect(one, 1) for one in noise])
    hit = found.eval("low < 0.0 < high").mean()
    short = found.eval("abs(effect) < 1.96 * se").mean()
    error = 4.0 * math.sqrt(0.95 * 0.05 / 2000)
    assert short + error < 0.95 < hit + error


def test_the_interval_allows_for_a_bend_that_is_not_seen():
    """Where a bend of twice its standard error passes for chance, the interval has the effect at a
    small step three times in four; without what both steps miss it hardly ever has it."""
    noise = 4e-3 * np.random.default_rng(8).standard_normal((500, 6, 4))
    found = pd.DataFrame([_effect(one, 100) for one in logs(2.0, 0.0, 100.0) + noise])
    pooled = found.query("linear and effect != small_step")
    assert pooled.eval("low < 0.0201 < high").mean() > 0.7
    assert pooled.eval("abs(effect - 0.0201) < 2.6 * se").mean() < 0.2


def test_a_parameter_that_cannot_be_changed_has_a_remark(results, tmp_path):
    scene = replace(results["balance"].scene, epsilon=0.97)
    found = sensitivity(
        scene, quantities=["power", "rate"], parameters=["epsilon", "sigma"], accuracy=0.1
    )
    refused = found.table["remark"].str.contains("cannot be changed by 4%")
    assert (refused == (found.table["parameter"] == "epsilon")).all()
    assert (refused == found.table["effect"].isna()).all()
    assert "cannot be changed" in page_of(found, tmp_path)
    assert len(found.answer) == 3  # a sentence for each quantity, and what was simulated


def too_large(scene, impacts):
    """Saltation with an sd of y1 that grows with epsilon as it should not."""
    section = mean_map(scene, impacts=impacts).section
    return section.assign(sd_y1=(scene.epsilon / 0.9) ** 2 * section["sd_y1"])


@pytest.mark.slow
def test_saltation_is_right_at_small_noise_and_corrected_is_not():
    """And twice the noise is twice the sd."""
    saltation = closure_sensitivity(
        WEAK, parameters=["amplitude", "epsilon", "sigma"], impacts=3
    ).table
    corrected = closure_sensitivity(
        WEAK, closure="corrected", parameters=["sigma"], impacts=3, paths=4096
    ).table
    assert set(saltation["verdict"]) <= {"accurate", "undecided", "excluded"}
    assert (saltation["verdict"] == "accurate").sum() > 70
    assert "inaccurate" in set(corrected["verdict"])
    rows = saltation.query("parameter == 'sigma' and moment == 'sd' and verdict == 'accurate'")
    assert len(rows) > 10
    assert rows["simulated"].to_numpy() == pytest.approx(0.00995, abs=3e-4)


def test_a_planted_error_is_shown(tmp_path):
    planted = closure_sensitivity(
        WEAK, closure=too_large, parameters=["epsilon"], impacts=1, paths=4096
    )
    wrong = planted.table.query("verdict == 'inaccurate'")
    assert wrong[["quantity", "moment"]].to_numpy().tolist() == [["y1", "sd"]]
    assert "1 inaccurate" in planted.answer[0]
    assert repr(planted).startswith("Sensitivity of too_large")
    assert planted.to_dict()["paths"] == planted.paths == 4096
    assert "too_large" in page_of(planted, tmp_path)


def test_where_another_mesh_is_struck_a_change_is_not_linear():
    bent = closure_sensitivity(WEAK, parameters=["backlash1"], impacts=1, paths=1024)
    assert not bent.table.query("quantity == 'tau'")["linear"].any()
    assert "not linear" in bent.answer[-1]
