"""Start, walls and impacts in the section map, at values known beforehand."""

import numpy as np
import pytest

from rattle.closure.moments import largest_error
from rattle.closure.section_map import (
    column,
    pieces,
    random_tolerance,
    start_covariance,
    start_pieces,
)
from rattle.scene import DAT21, Scene, Tolerance
from rattle.scene.impact import contact_matrix


def gears(*tolerance, **more):
    return Scene.from_gears(DAT21, tolerance=Tolerance(*tolerance, **more))


def test_the_variances_of_uniform_flanks():
    assert start_covariance(gears(0.03, 0.06)).diagonal()[5:] == pytest.approx(
        [0.0003, 0.0003, 0.0012, 0.0012]
    )
    assert random_tolerance(gears(0.1, distribution="fixed")) is None


@pytest.mark.parametrize("distribution", ["uniform", "normal"])
def test_pieces_of_a_flank_have_its_moments(distribution):
    """A uniform deviation in units of its half width; a normal one, which is cut at three sds, of
    its sd."""
    cut = pieces(distribution)
    assert cut.weight.sum() == pytest.approx(1.0)
    assert cut.weight @ cut.mean == pytest.approx(0.0, abs=1e-12)
    assert distribution == "normal" or cut.weight @ (cut.variance + cut.mean**2) == pytest.approx(
        1.0 / 3.0
    )
    parts = start_pieces(gears(0.03, 0.0))
    assert parts.weight @ parts.mean == pytest.approx(np.zeros(9), abs=1e-12)


def test_an_impact_turns_the_speed_across_its_flank():
    assert [column(mesh, side) for mesh in (1, 2) for side in (1, -1)] == [5, 6, 7, 8]
    struck = contact_matrix(Scene.from_gears(DAT21).constants, 1, 5, 1) @ np.array(
        [0.3, 0.5, 2.0, 0.1, 2.0]
    )
    assert struck == pytest.approx([0.3, 0.5, -1.8, 0.1, -1.8])


def test_the_largest_error_is_of_what_is_known():
    assert largest_error(np.array([0.1, np.nan, 0.3])) == 0.3
