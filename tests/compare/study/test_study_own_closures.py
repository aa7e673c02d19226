"""A closure of one's own in a study: computed once, again when its source changes, and missed where
it fails."""

import pickle
import sys

import pytest
from commands import rattle
from studies import study_text

from rattle import Study

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
    text = study_text(sigmas=(0.01, 0.1), paths=512)
    (tmp_path / "study.toml").write_text(text.replace('"corrected"', '"own_closures:mine"'))

    def write(shift):
        (tmp_path / "own_closures.py").write_text(OWN.format(shift=shift))
        sys.modules.pop("own_closures", None)
        return Study.load("study.toml")

    yield write
    sys.modules.pop("own_closures", None)


def test_its_source_is_in_the_key_of_its_cells_and_of_no_others(own):
    def keys(shift):
        return [cell.key for cell in own(shift).points[0].predictions]

    saltation, mine = keys("0.0")
    assert keys("0.0") == [saltation, mine]
    same, other = keys("0.00")
    assert same == saltation
    assert other != mine


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
