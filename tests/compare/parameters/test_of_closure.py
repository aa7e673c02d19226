"""What closures say of parameters: `saltation` is right at small noise, a planted error and `corrected` are not."""

import pytest
from test_boundary import page_of

from rattle import DAT21, Scene, closure_sensitivity, mean_map

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
    assert verdicts["saltation"] <= {"accurate", "undecided", "not judged"}
    assert (found["saltation"].table["verdict"] == "accurate").sum() > 70
    assert "inaccurate" in verdicts["corrected"]


@pytest.mark.slow
def test_twice_the_noise_is_twice_the_sd_at_small_noise(found):
    rows = found["saltation"].table.query("parameter == 'sigma' and moment == 'sd' and verdict == 'accurate'")
    assert len(rows) > 10
    assert rows["simulated"].to_numpy() == pytest.approx(0.00995, abs=3e-4)


def test_a_planted_error_is_shown(tmp_path):
    planted = closure_sensitivity(SMALL, closure=too_large, parameters=["epsilon"], impacts=1, paths=4096)
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
    one, two = (closure_sensitivity(SMALL, parameters=["omega"], impacts=1, paths=1024, workers=n) for n in (1, 2))
    assert one.table.equals(two.table)
