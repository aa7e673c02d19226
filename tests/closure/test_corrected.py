import math
from itertools import pairwise

import numpy as np
import pytest
from oracle import follow_covariance, gearbox
from reference_moments import stage_moments_after_flight
from scenes import UNEQUAL, dat21

from rattle import Start, follow, mean_map
from rattle.scene import state_names

PHI0 = 1 / math.sqrt(2 * math.pi)


CORRECTED = {
    "DAT21": dat21(0.3),
    "unequal": UNEQUAL,
    "from mesh 2": dat21(0.1, start=Start(0.4, 0.1, 0.9, -0.5, -1.0, mesh=2)),
}


@pytest.mark.parametrize("name", CORRECTED)
def test_covariance_is_that_of_its_own_equation(name):
    scene = CORRECTED[name]
    _, before_impacts = follow_covariance(scene, follow(scene, 12), bends=False)
    m = mean_map(scene, impacts=12, closure="corrected")
    found = m.trace.covariance
    assert not found[0].any()
    # covariances grow along the orbit; the integrator holds 1e-12 of each
    for one, exact in zip(found[1:], before_impacts, strict=True):
        assert one == pytest.approx(exact, rel=0, abs=1e-9 * abs(exact).max())
    before = m.at_times([m.trace.tau[12] - 1e-10]).iloc[0]  # the impact
    assert before["cov_y1_y2"] == pytest.approx(found[12][1, 3], abs=1e-8 * abs(found[12]).max())
    assert before[[*state_names(2)]].to_numpy() == pytest.approx(m.trace.mean[12], abs=1e-8)


def test_raw_moments_of_a_stage_are_those_of_their_hierarchy():
    """Nothing Gaussian is assumed there; at an impact Eq. 15 with (-eps)^p."""
    scene = dat21(0.3, stages=1)
    box = gearbox(scene.constants)
    m = mean_map(scene, impacts=3, closure="corrected", order=6)
    raw = np.zeros((7, 7))
    raw[0, 0] = 1.0
    for begin, end in pairwise(m.trace.tau[:4]):
        raw = stage_moments_after_flight(
            raw * (-scene.epsilon) ** np.arange(7),
            scene.beta1,
            begin,
            end - begin,
            lambda s: (scene.sigma * box.modulation(s)[0]) ** 2,
        )
    assert m.trace.raw[3, 0] == pytest.approx(raw, rel=1e-7, abs=1e-10)


def test_an_impact_shifts_the_struck_mean_inward_by_phi_0_sd():
    """Eqs. 20, 21: the window ends at the struck wall and holds half of a Gaussian whose other wall
    is far."""
    scene = dat21(0.01)
    orbit = follow(scene, 4)
    m = mean_map(scene, impacts=4, closure="corrected")
    assert set(orbit.mesh[1:]) == {1, 2}
    for k in range(1, 5):
        mesh = orbit.mesh[k]
        struck = slice(2 * mesh - 2, 2 * mesh)
        shift = (m.trace.mean[k] - orbit.before[k])[struck]
        sd = m.trace.sd[k, 2:][struck]
        assert sd[0] < 0.1  # so that the other wall is at least ten sds away
        unit = np.array([1.0, m.section.loc[k, f"rho{mesh}"]]) * sd
        assert shift == pytest.approx(-orbit.side[k] * PHI0 * unit, rel=1e-9)
