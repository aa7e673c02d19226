"""Accuracy thresholds for closures of a gear pair: copy this folder and put your own model in.

pytest                               quick: 32 768 simulated paths, kept in pytest's cache;
undecided, up to 262 144 pytest --rattle-profile=full         1 048 576 paths, and up to 8 388 608
pytest --rattle-undecided=skip       lets a test pass over what that cannot decide; by default it
fails pytest --rattle-baselines=record     writes the baselines that are missing
"""

import pandas as pd
import pytest

from rattle.closure import mean_map
from rattle.scene import Scene

pytestmark = pytest.mark.rattle(scene="dat21.toml", impacts=4)


def my_model(scene: Scene, impacts: int) -> pd.DataFrame:
    """Your own model: a row for each impact, means in `tau, y1, y2`, sds in `sd_tau, sd_y1, sd_y2`.

    Here it is the linearised closure, with nothing of second order.
    """
    return mean_map(scene, impacts=impacts, order=2).section[
        ["tau", "sd_tau", "y1", "sd_y1", "y2", "sd_y2"]
    ]


@pytest.mark.rattle(within={"mean": 0.05, "sd": 0.05})
@pytest.mark.parametrize("closure", ["saltation", "branching"])
def test_closures_hold_at_small_noise(rattle, closure):
    """Means and sds within 5 % of an sd, at each path's own impacts."""
    rattle.check(closure)


@pytest.mark.rattle(quantities="tau", moments="mean", absolute=1e-3)
def test_my_impact_times(rattle):
    """Mean impact times to a thousandth of a radian of the drive."""
    rattle.check(my_model)


@pytest.mark.rattle(impacts=range(1, 4), within=0.1, paths=8192)
def test_my_model(rattle):
    """Everything else to a tenth of an sd, for which fewer paths do."""
    rattle.check(my_model)


def test_my_model_is_what_it_was(rattle):
    """The numbers themselves, against those in baselines/."""
    rattle.baseline(my_model, relative=1e-6)
