"""A drive of several orders: input, files, and the physics against plain numpy."""

import math
from dataclasses import replace

import pytest
from oracle import gearbox
from refusals import refusal
from scenes import ORDERS, THREE, dat21

from rattle import Order, Scene, follow
from rattle.closure import refusals

# the second is too far from the first for a recurrence
SPARSE = (
    Order(3, 0.3, 0.1),
    Order(40, 1e-3, 1.0),
)


@pytest.mark.parametrize("orders", [ORDERS, SPARSE])
def test_noise_free_flights_are_those_of_an_ode_solver(orders):
    scene = dat21(drive=orders)
    orbit = follow(scene, 12)
    shifted = (replace(orders[0], phase=orders[0].phase + 1e-3), *orders[1:])
    box, wrong = (gearbox(scene.constants, drive) for drive in (orders, shifted))
    assert box.largest_error(orbit) < 1e-11 < wrong.largest_error(orbit)


def test_one_order_that_is_the_sine_is_the_default():
    plain = dat21(0.1)
    for drive in ((Order(1),), (Order(2, 0.0), Order(1, 1.0, 0.0))):
        assert replace(plain, drive=drive).constants.drive == plain.constants.drive
    assert "drive" not in plain.to_dict()
    assert "drive" not in repr(plain)
    assert "correlation_time" not in plain.to_toml()


GEARS_TEXT = (
    "[gears]\nepsilon = 0.9\nomega = 300.0\ninertia1 = 4000.0\nradius1 = 41.0\nbacklash1 = 0.2\n"
)
GEARS_TEXT += "[scene]\nstages = 1\n"


@pytest.mark.parametrize(
    ("gears", "amplitude", "values"),
    [
        ("alpha = 1.5", "amplitude", (1.0, 0.5)),
        ("alpha = 1.5", "amplitude_mm", (0.3, 0.15)),
        ("", "amplitude_mm", (0.3, 0.15)),
        ("driver_radius = 30.0", "amplitude_rad", (0.01, 0.005)),
    ],
)
def test_amplitudes_may_be_given_on_the_pitch_circle_or_as_angles(gears, amplitude, values):
    orders = (
        f"[[drive]]\norder = {order}\n{amplitude} = {value}\n"
        for order, value in enumerate(values, 1)
    )
    scene = Scene.from_toml(GEARS_TEXT.replace("omega", f"{gears}\nomega") + "".join(orders))
    assert scene.alpha == pytest.approx(1.5)
    assert [o.amplitude for o in scene.drive] == pytest.approx([1.0, 0.5])


ONE_TEXT = "[scene]\nalpha = 1.0\nepsilon = 0.5\nbeta1 = 0.1\ngamma1 = 0.1\nstages = 1\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[drive]]\norder = 0\namplitude = 1.0", "drive.order = 0: must be at least 1"),
        ("[[drive]]\norder = 1.5\namplitude = 1.0", "drive.order = 1.5: give a whole number"),
        ("[[drive]]\norder = 1001\namplitude = 1.0", "drive.order = 1001: must be at most 1000"),
        ("[[drive]]\namplitude = 1.0", "drive.order = None: is missing"),
        ("[[drive]]\norder = 2", "give the amplitude of order 2 once"),
        (
            "[[drive]]\norder = 2\namplitude = 0.1\namplitude_mm = 1.0",
            "give the amplitude of order 2 once",
        ),
        ("[[drive]]\norder = 2\namplitude_mm = 1.0", r"needs \[gears\]"),
        ("[[drive]]\norder = 2\namplitude = nan", "drive.amplitude = nan: give a finite number"),
        ("[[drive]]\norder = 2\namplitude = 0.1\nfase = 1.0", "did you mean 'phase'"),
        ("[[drive]]\norder = 2\namplitude = 0.0", "has no order with an amplitude"),
        ("[drive]\norder = 2\namplitude = 1.0", r"write each order as a table: \[\[drive\]\]"),
        ("[[scene.drive]]\norder = 2\namplitude = 1.0", r"\[\[drive\]\] beside \[scene\]"),
        (
            "[[drive]]\norder = 2\namplitude = 1.0\n[[drive]]\norder = 2\namplitude = 0.5",
            "is given twice",
        ),
    ],
)
def test_a_drive_that_is_none_is_refused(text, message):
    with refusal(message):
        Scene.from_toml(ONE_TEXT + text)


@pytest.mark.parametrize(
    ("drive", "message"),
    [((), "has no order"), (3, "give a sequence of Order"), ((2,), "give a sequence of Order")],
)
def test_a_drive_that_holds_no_orders_is_refused(drive, message):
    with refusal(message):
        dat21(drive=drive)


def test_the_published_closure_is_for_one_order_and_most_are_for_white_noise():
    assert list(refusals(THREE)) == ["published"]
    assert "for one order only" in refusals(THREE)["published"]
    coloured = refusals(dat21(0.1, correlation_time=1.0))
    assert list(coloured) == ["published", "corrected", "branching"]
    assert all("for white noise only" in why for why in coloured.values())


@pytest.mark.parametrize("theta", [-1.0, 1e-5, math.nan, math.inf])
def test_a_correlation_time_that_no_step_resolves_is_refused(theta):
    with refusal("correlation_time"):
        dat21(correlation_time=theta)
