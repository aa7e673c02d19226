"""The run-up: the ramp's equations against the physical ones, a slow ramp against constant speeds,
and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from commands import rattle
from refusals import refusal_in_words
from scenes import IMPACT_PAIR, dat21
from scipy.integrate import solve_ivp

from rattle import Scene, Tolerance
from rattle.compare import run_up
from rattle.compare.ramp import measure
from rattle.compare.ramp.speed import read_ramp
from rattle.montecarlo.kernel.blocks import Budget
from rattle.scene.flight import flow

RAMPED = Scene.from_toml("""
[gears]
amplitude = 0.2
epsilon = 0.9
omega = 300.0
speed_rpm = 1500.0
driver_radius = 35.0
inertia1 = 950.0
radius1 = 38.0
backlash1 = 0.12
damping1 = 0.3
torque1_over_rpm = [[500.0, 40.0], [1500.0, 60.0], [4000.0, 90.0]]

[scene]
sigma = 0.5
stages = 1
""")
RAMP = {"rpm": (1500.0, 2500.0), "points": 3, "budget": 1.0, "rng": 7}


@pytest.fixture(autouse=True)
def _no_clock(monkeypatch):
    """The plan alone decides what is run, on a slow machine too."""
    monkeypatch.setattr(measure, "Budget", lambda seconds: Budget(1e6))


ON_TREE = Scene.from_toml("""
[gears]
amplitude = 0.2
epsilon = 0.8
omega = 300.0
speed_rpm = 1500.0

[scene]
sigma = 0.5

[[wheel]]
name = "shaft"
parent_radius = 35.0
inertia = 9000.0
radius = 45.0
backlash = 0.12
damping = 0.3
torque_over_rpm = [[500.0, 300.0], [4000.0, 600.0]]

[[wheel]]
name = "first"
meshes = "shaft"
parent_radius = 20.0
inertia = 1500.0
radius = 58.0
torque = 80.0

[[wheel]]
name = "third"
meshes = "first"
parent_radius = 50.0
inertia = 900.0
radius = 42.0
damping = 0.1
torque = 70.0

[[wheel]]
name = "pump"
parent_radius = 28.0
inertia = 700.0
radius = 30.0
torque = 90.0
""")
SECOND = 20.0 / 45.0
THIRD = 50.0 / 58.0
PUMP = 28.0 / 35.0
"""By wheel: radius of the parent there over that at the parent's own mesh."""
TURNS = np.array([1.0, SECOND, SECOND * THIRD, PUMP])
"""Speed of the rim over the driver's at the first wheel."""
BY_DRIVER = np.array([1.0, 0.0, 0.0, PUMP])
BY_RIMS = np.diag([-1.0, 1.0, 1.0, -1.0]) - np.diag([SECOND, THIRD, 0.0], -1)
"""What the driver and the rims do to the gaps when they move."""
RATES = np.array([0.3, -0.1, 0.2, 0.15])
"""Of the gaps at the beginning."""


def fly_physically(ramp, periods):
    """Gaps (mm) and their rates (mm/s) after so many periods without impacts, in physical time with
    the mean rotation accelerated."""
    first, _, rate = ramp.rates
    end = (math.sqrt(first**2 + 4.0 * math.pi * rate * periods) - first) / rate
    rpm_of_omega = ramp.file_rpm / ramp.gears.omega
    rim = 35.0 * 2.0 * math.pi / 60.0 * rpm_of_omega
    wheels = [(wheel.radius, wheel.inertia, wheel.damping) for wheel in ramp.gears.tree]
    radius, inertia, damping = np.transpose(wheels)

    def rates(t, state):
        omega = first + rate * t
        at = np.interp(omega * rpm_of_omega, (500.0, 4000.0), (300.0, 600.0))
        brake = np.array([at, 80.0, 70.0, 90.0]) * radius
        brake += damping * (rim * omega * TURNS + state[4:])
        return [*state[4:], *(-1000.0 * brake / inertia - rim * rate * TURNS)]  # kg mm^2 / s^2

    # rims whose gaps have the rates that are wanted
    speeds = np.linalg.solve(BY_RIMS, first * (0.12 * RATES - 0.2 * BY_DRIVER))
    state = [0.0, 0.0, 0.0, 0.0, *speeds]
    moved = solve_ivp(rates, (0.0, end), state, rtol=1e-11, atol=1e-13).y[:, -1]
    driver = 0.2 * (first + rate * end) * BY_DRIVER
    return np.concatenate([BY_RIMS @ moved[:4], BY_RIMS @ moved[4:] + driver])


def fly_in_stretches(ramp, periods, stretch):
    """The same by the dimensionless motion with the constants of the ramp."""
    state = np.zeros(8)
    state[1::2] = RATES
    for rpm in ramp.rpm_at(stretch * np.arange(0.5, periods // stretch)).tolist():
        state = flow(ramp.constants_at(rpm), 0.0, state, 2.0 * math.pi * stretch)
    omega = ramp.omega_at(ramp.rpm_at(periods))
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
    for name, planted in {"rim_acceleration": 0.0, "rates": (*ramp.rates[:2], 0.0)}.items():
        wrong = read_ramp(ON_TREE, rpm, 8.0)
        vars(wrong)[name] = planted
        off = np.abs(fly_in_stretches(wrong, 8, 1) - exact) / np.abs(exact)
        assert (off > 20.0 * errors[0]).any()


def test_a_slow_ramp_is_as_constant_speeds_and_a_fast_one_is_not():
    """Within 4 standard errors and the allowance, of nine rows; sharp to 2 % of a value."""
    slow = run_up(RAMPED, seconds=20.0, **RAMP)
    rows = slow.table
    within = 4.0 * rows["se_difference"] + rows["allowance"]
    assert (rows["difference"].abs() < within).all()
    assert not rows["differs"].any()
    power = rows.query("quantity != 'speed_above'")
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
    rows = run_up(scene, seconds=8.0, **RAMP).table.query("quantity == 'power'")
    apart = np.hypot(rows["se"], rows["se_ramp"])
    assert (rows["se_difference"] < 0.5 * apart).all()
    within = 4.0 * rows["se_difference"] + rows["allowance"]
    assert (rows["difference"].abs() < within).all()
    planted = 0.1 * rows["value"]
    assert (rows["difference"] + planted > within).all()
    assert (planted < 4.0 * apart).all()  # other gear sets would not show it


def test_its_thresholds_are_those_of_the_speed_and_it_says_where_it_begins():
    ramp = read_ramp(RAMPED.with_gears(amplitude=0.1), (600.0, 2500.0), 10.0)
    ((rpm, above),) = ramp.openings(1, [600.0, 1500.0, 2500.0], ramp=False)
    assert above
    assert not ramp.opens(1, 0.999 * rpm, ramp=False)
    assert ramp.opens(1, 1.001 * rpm, ramp=False)
    ((in_ramp, _),) = ramp.openings(1, [600.0, 1500.0, 2500.0], ramp=True)
    assert in_ramp > rpm  # it adds to the drag


@pytest.mark.parametrize(
    ("scene", "changed", "words"),
    [
        (IMPACT_PAIR, {}, "a run-up needs gears"),
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
