"""The run-up: the ramp's equations against the physical ones, a slow ramp against constant speeds,
and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from commands import rattle
from refusals import refusal_in_words
from scenes import dat21
from scipy.integrate import solve_ivp

from rattle import Gears, Scene, Tolerance
from rattle.compare import run_up
from rattle.compare.ramp import measure
from rattle.compare.ramp.speed import read_ramp
from rattle.montecarlo.kernel.blocks import Budget
from rattle.scene.flight import flow

RAMPED_GEARS = Gears.driven(
    amplitude=0.2,
    epsilon=0.9,
    omega=300.0,
    speed_rpm=1500.0,
    driver_radius=35.0,
    inertia1=950.0,
    radius1=38.0,
    backlash1=0.12,
    damping1=0.3,
    torque1_over_rpm=((500.0, 40.0), (1500.0, 60.0), (4000.0, 90.0)),
)
RAMPED = Scene.from_gears(RAMPED_GEARS, sigma=0.5, stages=1)
RAMP = {"rpm": (1500.0, 2500.0), "points": 3, "budget": 1.0, "rng": 7}


@pytest.fixture(autouse=True)
def _no_clock(monkeypatch):
    """The plan alone decides what is run, on a slow machine too."""
    monkeypatch.setattr(measure, "Budget", lambda seconds: Budget(1e6))


SHAFT_VALUES = {
    "name": "shaft",
    "inertia": 9000.0,
    "radius": 45.0,
    "backlash": 0.12,
    "damping": 0.3,
}
GEAR_TREE = Gears.driven(
    amplitude=0.2,
    epsilon=0.8,
    omega=300.0,
    speed_rpm=1500.0,
    wheels=[
        Gears.Wheel(
            parent_radius=35.0, torque_over_rpm=((500.0, 300.0), (4000.0, 600.0)), **SHAFT_VALUES
        ),
        Gears.Wheel(
            name="first",
            meshes="shaft",
            parent_radius=20.0,
            inertia=1500.0,
            radius=58.0,
            torque=80.0,
        ),
        Gears.Wheel(
            name="third",
            meshes="first",
            parent_radius=50.0,
            inertia=900.0,
            radius=42.0,
            torque=70.0,
            damping=0.1,
        ),
        Gears.Wheel(name="pump", parent_radius=28.0, inertia=700.0, radius=30.0, torque=90.0),
    ],
)
ON_TREE = Scene.from_gears(GEAR_TREE, sigma=0.5)
SECOND_RATIO = 20.0 / 45.0
THIRD = 50.0 / 58.0
PUMP = 28.0 / 35.0
"""By wheel: radius of the parent there over that at the parent's own mesh."""
TURNS = np.array([1.0, SECOND_RATIO, SECOND_RATIO * THIRD, PUMP])
"""Speed of the rim over the driver's at the first wheel."""
RATES = np.array([0.3, -0.1, 0.2, 0.15])
"""Of the gaps at the beginning."""


def in_gaps(driver, rims):
    """Gaps of all meshes, where the driver and the rims have moved so much; or their rates."""
    shaft, first, third, pump = rims
    gaps = [
        driver - shaft,
        first - SECOND_RATIO * shaft,
        third - THIRD * first,
        PUMP * driver - pump,
    ]
    return np.array(gaps)


def fly_physically(ramp, periods):
    """Gaps (mm) and their rates (mm/s) after so many periods without impacts, in physical time with
    the mean rotation accelerated."""
    g = ramp.gears
    first, _, rate = ramp.rates
    order = g.omega / ramp.file_rpm
    rim = 35.0 * 2.0 * math.pi / 60.0 * (ramp.last - ramp.first) / ramp.seconds
    amplitude = 0.2
    end = (math.sqrt(first**2 + 4.0 * math.pi * rate * periods) - first) / rate

    wheels = [(wheel.radius, wheel.inertia, wheel.damping) for wheel in g.tree]
    radius, inertia, damping = np.array(wheels).T

    def rates(t, state):
        rpm = (first + rate * t) / order
        torque = np.array([np.interp(rpm, (500.0, 4000.0), (300.0, 600.0)), 80.0, 70.0, 90.0])
        mean = rpm * 2.0 * math.pi / 60.0 * 35.0 * TURNS / radius
        brake = 1000.0 * (torque + damping * mean)  # kg mm^2 / s^2
        slower = 1000.0 * damping / inertia * state[4:]
        return [*state[4:], *(-brake * radius / inertia - slower - TURNS * rim)]

    # rims whose gaps have the rates that are wanted
    to_gaps = np.array([in_gaps(0.0, unit) for unit in np.eye(4)]).T
    wanted = 0.12 * first * RATES
    speeds = np.linalg.solve(to_gaps, wanted - in_gaps(amplitude * first, np.zeros(4)))
    settings = {"rtol": 1e-11, "atol": 1e-13}
    moved = solve_ivp(rates, (0.0, end), [*np.zeros(4), *speeds], **settings).y[:, -1]
    omega = first + rate * end
    return np.concatenate([in_gaps(0.0, moved[:4]), in_gaps(amplitude * omega, moved[4:])])


def fly_in_stretches(ramp, periods, stretch):
    """The same by the dimensionless motion with the constants of the ramp."""
    state = np.zeros(8)
    state[1::2] = RATES
    for rpm in ramp.rpm_at(stretch * np.arange(0.5, periods // stretch)).tolist():
        state = flow(ramp.constants_at(rpm), 0.0, state, 2.0 * math.pi * stretch)
    omega = float(ramp.rates[0]) * float(ramp.rpm_at(np.array(periods)) / ramp.first)
    return 0.12 * np.concatenate([state[::2], omega * state[1::2]])


@pytest.mark.parametrize("rpm", [(1500.0, 2500.0), (2500.0, 1500.0)], ids=["up", "down"])
def test_the_ramp_is_the_physical_motion_but_for_its_stretches(rpm):
    """Second order in the stretch; without the acceleration of the mean rotation, or with the
    frequency of the start, it is another motion."""
    ramp = read_ramp(ON_TREE, rpm, 8.0)
    exact = fly_physically(ramp, 8)
    errors = [np.abs(fly_in_stretches(ramp, 8, n) - exact) / np.abs(exact) for n in (1, 2, 4)]
    assert (errors[0] < 1e-3).all()
    for fine, coarse in ((errors[0], errors[1]), (errors[1], errors[2])):
        assert coarse / fine == pytest.approx(4.0, rel=0.1)
    for name, planted in (("rim_acceleration", 0.0), ("rates", (*ramp.rates[:2], 0.0))):
        wrong = read_ramp(ON_TREE, rpm, 8.0)
        speeds = {"rim_acceleration": wrong.rim_acceleration, "rates": wrong.rates}
        vars(wrong).update(speeds | {name: planted})
        off = np.abs(fly_in_stretches(wrong, 8, 1) - exact) / np.abs(exact)
        assert (off > 20.0 * errors[0]).any()


def test_a_slow_ramp_is_as_constant_speeds_and_a_fast_one_is_not():
    """Within 4 standard errors and the allowance, of nine rows; sharp to 2 % of a value."""
    slow = run_up(RAMPED, seconds=20.0, **RAMP)
    rows = slow.table
    within = 4.0 * rows["se_difference"] + rows["allowance"]
    assert (rows["difference"].abs() < within).all()
    assert not rows["differs"].any()
    power = rows[rows["quantity"] != "speed_above"]
    assert (within[power.index] < 0.08 * power["value"]).all()
    assert abs(slow.overall["change"]).max() < 0.03
    fast = run_up(RAMPED, seconds=0.5, **RAMP)
    assert fast.table["differs"].any()
    assert fast.added_torque[0] == pytest.approx(40.0 * slow.added_torque[0])
    assert "differ (95 % for all rows together)" in repr(fast)


def test_the_same_gear_sets_are_compared():
    """Where backlashes differ by 30 % the difference is known several times better than either
    side: within 4 standard errors and the allowance, which 10 % more power would not be."""
    scene = replace(RAMPED, sigma=0.1, tolerance=Tolerance(c1_max=0.15, draw="path"))
    rows = run_up(scene, seconds=8.0, **RAMP).table.set_index("quantity").loc["power"]
    apart = np.hypot(rows["se"], rows["se_ramp"])
    assert (rows["se_difference"] < 0.5 * apart).all()
    within = 4.0 * rows["se_difference"] + rows["allowance"]
    assert (rows["difference"].abs() < within).all()
    planted = 0.1 * rows["value"]
    assert (rows["difference"] + planted > within).all()
    assert (planted < 4.0 * apart).all()  # other gear sets would not show it


def test_its_thresholds_are_those_of_the_speed_and_it_says_where_it_begins():
    quiet = Scene.from_gears(Gears.driven(**RAMPED_GEARS.values | {"amplitude": 0.1}), stages=1)
    ramp = read_ramp(quiet, (600.0, 2500.0), 10.0)
    ((rpm, above),) = ramp.openings(1, [600.0, 1500.0, 2500.0], ramp=False)
    assert above
    assert [ramp.opens(1, rpm * factor, ramp=False) for factor in (0.999, 1.001)] == [False, True]
    ((in_ramp, _),) = ramp.openings(1, [600.0, 1500.0, 2500.0], ramp=True)
    assert in_ramp > rpm  # it adds to the drag


@pytest.mark.parametrize(
    ("scene", "changed", "words"),
    [
        (
            Scene(alpha=1.0, epsilon=0.9, beta1=0.0, gamma1=0.1, stages=1),
            {},
            "a run-up needs gears",
        ),
        (dat21(), {}, "gears.speed_rpm = None: give the driver's mean speed"),
        (RAMPED, {"rpm": (400.0, 2000.0)}, "the table ends at 500 and 4000 1/min"),
        (RAMPED, {"rpm": (900.0, 900.0)}, "give two different speeds"),
        (RAMPED, {"seconds": 0.05}, "is too short: 3 periods of the excitation for 3 speeds"),
        (RAMPED, {"rpm": (2500.0, 1500.0), "seconds": 0.5}, "wheel 1 would be slowed down by more"),
    ],
)
def test_what_cannot_be_ramped_is_refused_in_a_sentence(scene, changed, words):
    with refusal_in_words(words):
        run_up(scene, **RAMP | changed)


def test_the_command_writes_a_page_and_says_where_it_rattles_most(tmp_path):
    file = tmp_path / "gears.toml"
    file.write_text(replace(ON_TREE, start=None).to_toml())
    out = tmp_path / "out"
    over = "--over speed_rpm=1500:2500:2 --seconds 1"
    said = rattle(f"run-up {file} {over} --budget 1 --out {out} --workers 1").output
    assert "It rattles most at" in said
    assert "the drag of wheel 1 (shaft)" in said
    thresholds = said.partition("Threshold of rattle")[2]
    page = (out / "run-up.md").read_text()
    for wheel in ("1 (shaft)", "2 (first)", "4 (pump)"):
        assert wheel in thresholds
        assert f"| {wheel} |" in page
