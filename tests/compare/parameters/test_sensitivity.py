"""Effects of parameters against exact laws, with planted errors; what is not linear; bad input."""

import math
from dataclasses import replace

import numpy as np
import pytest
from test_boundary import page_of

from rattle import DAT21, InputError, Order, Scene, Tolerance, mean_map, sensitivity
from rattle.compare import closure_sensitivity
from rattle.compare.parameters.figures import tornado
from rattle.compare.parameters.sensitivity import _effect
from rattle.compare.study.parameters import RELATIVE_CHANGES, find_parameter, find_parameters

# Noise alone drives this stage: in the long run all that it supplies, sigma^2 (1 + beta1^2) / 4, is
# lost in impacts.
NOISE_ALONE = Scene(alpha=0.0, epsilon=0.5, beta1=0.0, gamma1=0.0, sigma=1.0, stages=1)
DRIVEN = Scene.from_gears(DAT21, sigma=0.5)


@pytest.fixture(scope="module")
def balance():
    return sensitivity(NOISE_ALONE, quantities=["power"], accuracy=0.002, rng=3)


def test_the_energy_lost_follows_the_balance(balance):
    """Twice the noise, four times the power; restitution and gap do not matter.  Three checks, 4
    errors each."""
    rows = balance.of("power")
    for name, power in {"sigma": 2.0, "epsilon": 0.0, "gap1": 0.0}.items():
        exact = 1.01**power - 1.0
        assert abs(rows.loc[name, "effect"] - exact) < 4.0 * rows.loc[name, "se"] + 1e-12
    assert (
        abs(rows.loc["sigma", "effect"] - (1.01 - 1.0)) > 4.0 * rows.loc["sigma", "se"]
    )  # a planted error
    assert abs(balance.values.loc["power", "value"] - 0.25) < 0.01


def test_the_result_shows_itself(balance):
    assert "noise intensity (now 1): 1 % more adds 1.997" in repr(balance)
    assert "<table" in balance._repr_html_()
    assert balance.plot().axes[0].get_xlabel().startswith("change (%)")
    assert balance.to_dict()["groups"] == balance.groups
    with pytest.raises(InputError, match="quantity = 'flight'"):
        balance.of("flight")


def test_the_result_does_not_depend_on_the_workers():
    settings = {"quantities": ["power"], "parameters": ["sigma"], "accuracy": 0.1}
    one, two = (sensitivity(NOISE_ALONE, **settings, workers=n) for n in (1, 2))
    assert one.table.equals(two.table)


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
    """2,000 effects of pure noise: within 4 standard errors of 95 %; an interval of z in place of t
    is caught."""
    rng = np.random.default_rng(7)
    found = [_effect(0.01 * rng.standard_normal((4, 4)), 1) for _ in range(2000)]
    hit = np.mean([e["low"] < 0.0 < e["high"] for e in found])
    short = np.mean([abs(e["effect"]) < 1.96 * e["se"] for e in found])
    error = 4.0 * math.sqrt(0.95 * 0.05 / 2000)
    assert abs(hit - 0.95) < error < abs(short - 0.95)


def test_parameters_of_gears_are_physical():
    found = find_parameters(replace(DRIVEN, tolerance=Tolerance(0.01, 0.02)))
    assert found["amplitude"][1:3] == (pytest.approx(0.3), "mm")
    wider = found["backlash1"].scene_at(0.4)
    assert (wider.gears.amplitude, wider.tolerance.c1_max, wider.sigma) == (
        pytest.approx(0.3),
        0.005,
        0.5,
    )
    assert found["torque2"].words == "drag torque on wheel 2"
    single = find_parameters(replace(DRIVEN, stages=1))
    assert not [name for name in single if name.endswith("2")]
    assert "gap1" in find_parameters(NOISE_ALONE)


def test_what_gears_do_not_fix_stays_while_they_change():
    scene = replace(DRIVEN, drive=(Order(1), Order(2, 0.3)), correlation_time=0.5)
    assert find_parameters(scene)["drive.2.amplitude"].words == "order 2 of the drive"
    assert find_parameters(scene)["correlation_time"].scene_at(0.6).correlation_time == 0.6
    for name in ("torque1", "backlash1", "amplitude"):
        changed = find_parameters(scene)[name].scene_at(0.31)
        assert (changed.drive, changed.correlation_time) == (scene.drive, 0.5)


@pytest.mark.parametrize(
    "name",
    [
        "alpha",
        "amplitude",
        "torque1",
        "beta1",
        "gap2",
        "sigma",
        "drive.1.amplitude",
        "drive.3.phase",
        "start.y1",
    ],
)
def test_any_number_of_a_scene_can_be_another(name):
    found = find_parameter(DRIVEN, name)
    changed = found.scene_at(0.31)
    assert find_parameter(changed, name).value == pytest.approx(0.31)
    assert found.scene_at(0.32) != changed


def test_a_parameter_that_cannot_be_changed_has_a_remark(tmp_path):
    scene = replace(NOISE_ALONE, epsilon=0.97)
    found = sensitivity(
        scene, quantities=["power", "rate"], parameters=["epsilon", "sigma"], accuracy=0.1
    )
    assert (
        found.table.query("parameter == 'epsilon'")["remark"]
        .str.contains("cannot be changed by 4%")
        .all()
    )
    assert found.table.query("parameter == 'sigma'")["effect"].notna().all()
    assert "cannot be changed" in page_of(found, tmp_path)
    assert len(tornado(found.table, ["power", "rate"]).axes) == 2
    assert len(found.answer) == 3  # a sentence for each quantity, and what was simulated


SMALL = Scene.from_gears(DAT21, sigma=0.01)
CHANGED = ["amplitude", "epsilon", "sigma"]


def too_large(scene, impacts):
    """Saltation with an sd of y1 that grows with epsilon as it should not."""
    section = mean_map(scene, impacts=impacts).section
    return section.assign(sd_y1=(scene.epsilon / 0.9) ** 2 * section["sd_y1"])


@pytest.fixture(scope="module")
def found():
    return {
        closure: closure_sensitivity(SMALL, closure=closure, parameters=CHANGED, impacts=3)
        for closure in ("saltation", "corrected")
    }


@pytest.mark.slow
def test_saltation_is_right_at_small_noise_and_corrected_is_not(found):
    verdicts = {closure: set(one.table["verdict"]) for closure, one in found.items()}
    assert verdicts["saltation"] <= {"accurate", "undecided", "excluded"}
    assert (found["saltation"].table["verdict"] == "accurate").sum() > 70
    assert "inaccurate" in verdicts["corrected"]


@pytest.mark.slow
def test_twice_the_noise_is_twice_the_sd_at_small_noise(found):
    rows = found["saltation"].table.query(
        "parameter == 'sigma' and moment == 'sd' and verdict == 'accurate'"
    )
    assert len(rows) > 10
    assert rows["simulated"].to_numpy() == pytest.approx(0.00995, abs=3e-4)


def test_a_planted_error_is_shown(tmp_path):
    planted = closure_sensitivity(
        SMALL, closure=too_large, parameters=["epsilon"], impacts=1, paths=4096
    )
    wrong = planted.table[planted.table["verdict"] == "inaccurate"]
    assert wrong[["quantity", "moment"]].to_numpy().tolist() == [["y1", "sd"]]
    assert "1 inaccurate" in planted.answer[0]
    assert repr(planted).startswith("Sensitivity of too_large")
    assert "<table" in planted._repr_html_()
    assert planted.to_dict()["paths"] == planted.paths == 4096
    assert "too_large" in page_of(planted, tmp_path)


def test_where_another_mesh_is_struck_a_change_is_not_linear():
    bent = closure_sensitivity(SMALL, parameters=["backlash1"], impacts=1, paths=1024)
    assert not bent.table.query("quantity == 'tau'")["linear"].any()
    assert "not linear" in bent.answer[-1]


def test_workers_do_not_matter():
    one, two = (
        closure_sensitivity(SMALL, parameters=["omega"], impacts=1, paths=1024, workers=n)
        for n in (1, 2)
    )
    assert one.table.equals(two.table)
