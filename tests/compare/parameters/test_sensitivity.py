"""Effects of parameters against exact laws, with planted errors; what is not linear; bad input."""

import math
from dataclasses import replace

import numpy as np
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
    for name, power in {"sigma": 2.0, "epsilon": 0.0, "gap1": 0.0}.items():
        exact = 1.01**power - 1.0
        assert abs(rows.loc[name, "effect"] - exact) < 4.0 * rows.loc[name, "se"] + 1e-12
    planted = 1.01 - 1.0  # the power in proportion to the noise
    assert abs(rows.loc["sigma", "effect"] - planted) > 4.0 * rows.loc["sigma", "se"]
    assert abs(balance.values.loc["power", "value"] - 0.25) < 0.01
    assert "energy lost per unit of dimensionless time (now" in balance.answer[0]


def logs(power, noise=0.0, bend=0.0, groups=6):
    """Logarithms at each factor of a quantity that grows as a power, with noise and a term of third
    order."""
    x = np.log([1.0 + sign * step for step in RELATIVE_CHANGES for sign in (-1.0, 1.0)])
    rng = np.random.default_rng(5)
    return power * x + bend * x**3 + noise * rng.standard_normal((groups, 4))


def test_what_bends_is_extrapolated_or_called_not_linear():
    straight, slightly, strongly = (
        _effect(logs(2.0, 1e-5, bend), 10) for bend in (0.0, 60.0, 600.0)
    )
    assert [found["linear"] for found in (straight, slightly, strongly)] == [True, True, False]
    for found in (straight, slightly):
        assert found["effect"] == pytest.approx(1.01**2 - 1.0, abs=1e-4)
    assert slightly["large_step"] - 0.0201 > 5e-4  # what one step alone would be off by
    assert strongly["effect"] == strongly["small_step"]


def test_intervals_have_their_coverage():
    """2,000 effects of pure noise: 95 % at the least, within 4 standard errors, for an interval
    reaches to where a bend would put the effect; an interval of z in place of t is caught."""
    rng = np.random.default_rng(7)
    found = [_effect(0.01 * rng.standard_normal((4, 4)), 1) for _ in range(2000)]
    hit = np.mean([e["low"] < 0.0 < e["high"] for e in found])
    short = np.mean([abs(e["effect"]) < 1.96 * e["se"] for e in found])
    error = 4.0 * math.sqrt(0.95 * 0.05 / 2000)
    assert short + error < 0.95 < hit + error


def test_the_interval_allows_for_a_bend_that_is_not_seen():
    """Where a bend of twice its standard error passes for chance, the interval has the effect at a
    small step three times in four; without what both steps miss it hardly ever has it."""
    rng = np.random.default_rng(8)
    exact = 1.01**2 - 1.0
    bent = logs(2.0, 0.0, 100.0)
    found = [_effect(bent + 4e-3 * rng.standard_normal((6, 4)), 100) for _ in range(500)]
    pooled = [e for e in found if e["linear"] and e["effect"] != e["small_step"]]
    hit = np.mean([e["low"] < exact < e["high"] for e in pooled])
    alone = np.mean([abs(e["effect"] - exact) < 2.6 * e["se"] for e in pooled])
    assert hit > 0.7
    assert alone < 0.2


def test_a_parameter_that_cannot_be_changed_has_a_remark(results, tmp_path):
    scene = replace(results["balance"].scene, epsilon=0.97)
    names = ["power", "rate"]
    found = sensitivity(scene, quantities=names, parameters=["epsilon", "sigma"], accuracy=0.1)
    remarks = found.table.query("parameter == 'epsilon'")["remark"]
    assert remarks.str.contains("cannot be changed by 4%").all()
    assert found.table.query("parameter == 'sigma'")["effect"].notna().all()
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
    wrong = planted.table[planted.table["verdict"] == "inaccurate"]
    assert wrong[["quantity", "moment"]].to_numpy().tolist() == [["y1", "sd"]]
    assert "1 inaccurate" in planted.answer[0]
    assert repr(planted).startswith("Sensitivity of too_large")
    assert planted.to_dict()["paths"] == planted.paths == 4096
    assert "too_large" in page_of(planted, tmp_path)


def test_where_another_mesh_is_struck_a_change_is_not_linear():
    bent = closure_sensitivity(WEAK, parameters=["backlash1"], impacts=1, paths=1024)
    assert not bent.table.query("quantity == 'tau'")["linear"].any()
    assert "not linear" in bent.answer[-1]
