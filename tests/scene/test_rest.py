"""Meshes that close and open: the orbit through chatter and sticking phases."""

import math
from dataclasses import replace

import pytest
from needs import COMPILED
from scenes import STICKING, dat21

from rattle import Gears, Order, Scene, Start, follow, mean_map, rattle_threshold

SINGLE = STICKING["one stage"]


def test_two_meshes_that_throw_each_other_back_stick_though_never_on_their_walls_at_one_instant():
    """Impacts at mesh 1 and mesh 2 in turn, down to flights in which doubles no longer resolve a
    displacement."""
    gears = Gears(
        alpha=3.7333333333333334,
        epsilon=0.7,
        omega=167.6,
        inertia1=950.0,
        inertia2=620.0,
        radius1=38.0,
        radius2=30.0,
        backlash1=0.12,
        backlash2=0.1,
        damping1=20.0,
        damping2=15.0,
        torque1=60.0,
        torque2=40.0,
    )
    orbit = follow(Scene.from_gears(gears), 1000)
    times = [phase.closed for phase in orbit.sticking]
    one, other, *_ = (p for p in orbit.sticking if times.count(p.closed) == 2)
    assert {one.mesh, other.mesh} == {1, 2}
    struck = orbit.mesh[one.impact - 4 : one.impact + 1]
    assert (struck[1:] != struck[:-1]).all()


@COMPILED
def test_an_elastic_mesh_never_sticks():
    orbit = follow(
        Scene(alpha=0.0, epsilon=1.0, beta1=0.0, gamma1=1.0, stages=1, start=Start()), 5000
    )
    assert (orbit.found, orbit.sticking) == (5000, ())


def test_the_orbit_goes_on_and_linearisations_stop_at_sticking():
    orbit = follow(SINGLE, 40)
    assert (orbit.found, orbit.stopped) == (40, "")
    assert len(orbit.sticking) >= 2
    first = orbit.sticking[0].impact
    # which ends at the first impact that is too slow for it
    m = mean_map(SINGLE, impacts=40, closure="saltation")
    assert m.stopped == f"impact {m.trace.found + 1} grazes its wall"
    assert 0 < m.trace.found <= first


THREE_ORDERS = (Order(1, 1.0), Order(2, 0.4, 0.7), Order(5, 0.08, -1.1))
NEAR_THRESHOLD = {
    "one stage": Scene(alpha=1.5, epsilon=0.4, beta1=0.3, gamma1=1.0, stages=1),
    "two stages, three orders": replace(dat21(), epsilon=0.3, gears=None, drive=THREE_ORDERS),
}


def dragged(scene, factor, wheel):
    """The scene with one wheel at a factor of its threshold, the other well above."""
    if scene.stages == 2:
        scene = replace(
            scene, gamma2=rattle_threshold(scene)[1].least * (factor if wheel == 2 else 1.1)
        )
    return replace(scene, gamma1=rattle_threshold(scene)[0].least * (factor if wheel == 1 else 1.5))


@pytest.mark.parametrize("name", NEAR_THRESHOLD)
def test_closed_teeth_open_just_below_it_and_stay_closed_just_above(name):
    """A planted error of half a percent would be seen."""
    scene = NEAR_THRESHOLD[name]
    for wheel in range(1, scene.stages + 1):
        below = dragged(scene, 0.995, wheel)
        above = dragged(scene, 1.005, wheel)
        assert follow(above, 400).sticking[-1].opened == math.inf, wheel
        assert follow(below, 400).found == 400, wheel
        assert any(t.opens for t in rattle_threshold(below))
        assert not any(t.opens for t in rattle_threshold(above))


def test_torques_are_in_newton_millimetres():
    """Inertia times acceleration over the radius, for gears without damping."""
    gears = Gears(
        alpha=2.0,
        epsilon=0.5,
        omega=100.0,
        inertia1=500.0,
        radius1=40.0,
        backlash1=0.3,
        torque1=7.0,
    )
    (wheel,) = rattle_threshold(Scene.from_gears(gears, stages=1))
    assert wheel.drag == 7.0
    assert wheel.unit == "N mm"
    assert wheel.least == pytest.approx(500.0 * (2.0 * 0.3) * 100.0**2 / 40.0 / 1000.0)
