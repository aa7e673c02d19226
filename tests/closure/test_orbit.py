import numpy as np
import pytest
from reference_dynamics import contact, first_crossing

from rattle.closure.orbit import follow
from rattle.scene import DAT21, Scene, Start

FIELDS = ("tau", "mesh", "side", "before", "after")


def test_the_paper_s_orbit_is_that_of_an_integrator_with_events():
    scene = Scene.from_gears(DAT21)
    c, orbit = scene.constants, follow(scene, 12)
    tau, state = 0.0, contact(c, 1, (0.5, 2.0, 0.5, 2.0))
    for k in range(1, 13):
        t, mesh, side, before = first_crossing(c, tau, state, 20.0)
        tau, state = tau + t, contact(c, mesh, before)
        assert (orbit.mesh[k], orbit.side[k]) == (mesh, side)
        # 1e-13 of the integrator, stretched by the divergence of a chaotic orbit over 12 impacts
        assert orbit.tau[k] == pytest.approx(tau, rel=0, abs=1e-9)
        assert orbit.before[k] == pytest.approx(before, rel=0, abs=1e-9)
        assert orbit.after[k] == pytest.approx(state, rel=0, abs=1e-9)


def test_an_orbit_without_the_mesh_2_impact_rule_is_distinguished():
    """Eq. 10 applied after every impact, as the paper has it, leaves the true orbit at its first mesh-2 impact."""
    orbit = follow(Scene.from_gears(DAT21), 12)
    c = Scene.from_gears(DAT21).constants
    k = int(np.flatnonzero(orbit.mesh == 2)[0])
    assert abs(contact(c, 1, orbit.before[k]) - orbit.after[k]).max() > 0.1


@pytest.mark.parametrize("k", [1, 2, 5, 9])
def test_an_orbit_restarted_at_its_own_impact_repeats_itself(k):
    scene = Scene.from_gears(DAT21)
    orbit = follow(scene, 12)
    start = Start(orbit.tau[k], *orbit.before[k], mesh=int(orbit.mesh[k]))
    scene = Scene.from_gears(DAT21, start=start)
    again = follow(scene, 12 - k)
    for name in FIELDS:
        found, expected = getattr(again, name), getattr(orbit, name)[k:]
        if scene.phase == start.tau:
            assert np.array_equal(found, expected)  # the same numbers, the same steps
        else:  # in local time, a whole period less
            found = scene.to_absolute_time(found) if name == "tau" else found
            assert found == pytest.approx(expected, rel=0, abs=1e-13)
