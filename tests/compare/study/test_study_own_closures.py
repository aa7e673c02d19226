"""A closure of one's own in a study: computed once, again when its source changes, and missed where
it fails."""

import pickle
import sys

import pytest
from commands import rattle
from studies import study_text

from rattle import Study

OWN_STUDY = study_text(sigmas=(0.01, 0.1), paths=512).replace('"corrected"', '"{}"')
OWN = """from rattle import mean_map

def mine(scene, impacts):
    if scene.sigma > 0.05:
        raise ValueError("too strong")
    return {shift} + mean_map(scene, impacts=impacts, closure="saltation").section[["tau", "y1"]]
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    """Writes a module with a closure that is wrong by a shift, and forgets an earlier one."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    (tmp_path / "study.toml").write_text(OWN_STUDY.format("own_closures:mine"))

    def write(shift):
        (tmp_path / "own_closures.py").write_text(OWN.format(shift=shift))
        sys.modules.pop("own_closures", None)
        return Study.load("study.toml")

    yield write
    sys.modules.pop("own_closures", None)


def test_its_source_is_in_the_key_of_its_cells_and_of_no_others(own):
    cells = (own(shift).points[0].predictions for shift in ("0.0", "0.0", "0.00"))
    first, same, other = ({cell.closure: cell.key for cell in of_point} for of_point in cells)
    assert first == same
    assert first["saltation"] == other["saltation"]
    assert first["mine"] != other["mine"]


def test_a_cell_goes_to_another_process(own):
    cell = own("0.0").points[0].predictions[1]
    assert pickle.loads(pickle.dumps(cell)).key == cell.key


@pytest.mark.usefixtures("undrawn")
def test_where_it_fails_the_study_is_complete_but_for_that(own):
    own("0.0")
    done = rattle("study", "study.toml", code=1)
    assert "mine cannot be computed at 1 of 2 points" in done.stderr
    assert "raised ValueError: too strong" in done.stderr
    assert "`mine`: accurate up to sigma = 0.01" in done.stdout
