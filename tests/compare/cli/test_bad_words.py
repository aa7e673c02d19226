"""What a command cannot use is refused in one line that names the value and a remedy, before any
work and before anything is written."""

import re

import pytest
from commands import rattle

BAD = {
    "validate --sigma -1": "sigma = -1.0",
    "validate no/such.toml": "cannot be read",
    "validate --paths 0": "paths = 0: must be at least 1",
    "validate --workers 0": "workers = 0",
    "validate --seed -4": "must be 0 or greater|must be at least 0",
    "validate --dt 1": "must be at most 0.1",
    "validate --dt -1": "dt = -1.0",
    "validate --scheme euler-maruyama-located --sigma 0.1 --sigma 1e4 --dt 2e-3": (
        "must be at most 8.46e-05 .* throw a path through"
    ),
    "validate --scheme euler-mayurama": "did you mean 'euler-maruyama'",
    "validate --closure publishd": "did you mean 'published'",
    "validate --closure nowhere:mine": "closures = 'nowhere:mine': cannot be imported",
    "validate --order 9": "order = 9: must be at most 6",
    "validate --over 1e-3:2:12": r"write NAME=LOW:HIGH\[:POINTS\], as in --over sigma=",
    "validate --over alpha=1:2": "over = 'alpha': can be sigma alone here",
    "validate --over sigma=1:2:x": "sigma = '1:2:x': write NAME=LOW:HIGH",
    "validate --over sigma=1:2:5:ln": "sigma spacing = 'ln': valid are 'log'",
    "validate --over sigma=2:1:5": "sigma HIGH = 1.0: must be greater than LOW = 2",
    "validate --over sigma=0:1:5": "sigma LOW = 0.0: must be greater than 0",
    "validate --over sigma=nan:1:5": "sigma LOW = nan: give a finite number",
    "validate --over sigma=0.1:1:1": "sigma POINTS = 1: must be at least 2",
    "validate --over sigma=1:1.01:50": "take fewer",
    "validate --validity 1e-3:2:12": "--validity is now part of --over sigma=LOW:HIGH",
    "boundary --between 20 200 --over torque1": "--between is now part of --over NAME=LOW:HIGH",
    "boundary --and alpha --reach 0.5 3": "--reach is now part of --and NAME=LOW:HIGH",
    "boundary --over torque2=-1:2": "torque2 LOW = -1.0: must be greater than 0",
    "stationary --field epsilon --over 0.7:0.9:2": "--field is now part of --over",
    "validate --validity-paths 0": "validity-paths = 0: must be at least 1",
    "validate --budget 0": "budget = 0.0: must be greater than 0",
    "stationary --closure own:mine": "closure = 'own:mine': predicts impacts, not the long run",
    "stationary --closure corrected --no-closures": "closure",
    "check claims --paths 10": "paths = 10",
    "check claims --over alpha=1:0:3": "alpha HIGH = 0",
    "check claims --impacts 5": "impacts = 5",
    "check stability --axis gup": "axis = 'gup': did you mean 'gap'?",
    "check stability --points 8": "points = 8: must be at most 7",
    "tradeoff --accuracy 0": "accuracy = 0.0: must be greater than 0",
    "tradeoff --sigma 0": "sigma = 0.0: must be greater than 0",
    "tradeoff --impacts 0": "impacts = 0: must be at least 1",
    "chaos --over alpha=1:0:5": "alpha HIGH = 0.0: must be greater than LOW = 1",
    "chaos --over alpa=1:2": "did you mean 'alpha'",
    "chaos --over epsilon=0.5:1.5:3": "between 0 and 1",
    "chaos --width 0": "width",
    "chaos --points 3": "at least 100",
    "simulate --units metric": "units = 'metric': valid are",
    "simulate --paths 10 --scheme exact-flight --dt 1": "dt = 1.0: must be at most",
    "simulate --paths 1.5": "is not a whole number",
    "simulate --paths 1e999999999": "is not a whole number",
    "simulate --paths ''": "is not a whole number",
}


@pytest.mark.parametrize("words", BAD)
def test_bad_words_are_refused_before_anything_is_written(words, tmp_path):
    assert re.search(BAD[words], rattle(f"{words} --out {tmp_path / 'out'}", code=2).stderr)
    assert not any(tmp_path.iterdir())


def test_an_unknown_key_of_a_scene_and_a_folder_that_is_not_there(tmp_path):
    (tmp_path / "scene.toml").write_text("[scene]\nalpha = 1.0\nepsilom = 0.9\nbeta1 = 0.1\n")
    assert "'epsilon'" in rattle(f"validate {tmp_path / 'scene.toml'}", code=2).stderr
    assert "does not exist" in rattle("simulate --out no/such/folder/table.csv", code=2).stderr
