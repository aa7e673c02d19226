"""A measured drive: orders and noise from made measurements of every kind, files of scenes, and bad
files."""

import math
import re

import numpy as np
import pytest
from commands import rattle
from measurements import OMEGA, QUANTITIES, RADIUS, TIMES, UNITS_OF_POWERS, measure, wander, write
from measurements import motion as moved
from places import EXAMPLES
from refusals import refusal
from scipy.integrate import cumulative_trapezoid

from rattle import Scene, measure_drive

SLOW_OMEGA = 167.6
MEASURED_ORDERS = ((1, 0.45, 0.3), (2, 0.08, 1.1), (5, 0.002, -0.4))  # amplitudes in mm
MEASURED_GEARS = """
[gears]
driver_radius = 32.0
omega = 167.6
epsilon = 0.7
inertia1 = 950.0
inertia2 = 620.0
radius1 = 38.0
radius2 = 30.0
backlash1 = 0.12
torque1 = 6.0
"""
FROM_FILE = '[drive]\nfile = "speed.csv"\n' + MEASURED_GEARS
DEGREES = {"displacement": "deg", "speed": "rpm", "acceleration": "rad/s^2"}


def noisy(seed, ratio, periods=60, memory=0.0):
    """The speed of a drive whose modulation is white noise, or one with a memory."""
    times = 2.0 * math.pi / SLOW_OMEGA / 32.0 * np.arange(32 * periods)
    settings = {"ratio": ratio, "seed": seed, "memory": memory}
    return measure(SLOW_OMEGA, MEASURED_ORDERS, times, quantity="speed", **settings)


@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize("angular", [False, True])
def test_the_orders_are_found_in_every_quantity_and_unit(quantity, angular):
    times = 2.0 * math.pi / SLOW_OMEGA / 40.0 * np.arange(40 * 30)
    unit = DEGREES[quantity] if angular else None
    extra = 7.0 * (quantity != "acceleration")  # a constant does not matter
    text = measure(SLOW_OMEGA, MEASURED_ORDERS, times, quantity=quantity, unit=unit, extra=extra)
    found = measure_drive(text, omega=1.01 * SLOW_OMEGA, driver_radius=RADIUS if angular else None)
    assert found.omega == pytest.approx(SLOW_OMEGA, rel=1e-6)
    assert found.amplitude == pytest.approx(0.45, rel=2e-4)
    for one, (order, amplitude, phase) in zip(found.drive, MEASURED_ORDERS, strict=True):
        assert one.order == order
        assert one.amplitude == pytest.approx(amplitude / 0.45, rel=2e-3)
        assert one.phase == pytest.approx(phase, abs=3e-3)
    assert found.left_out < 5e-3
    assert found.sigma_ratio < 1e-3


def test_noise_that_remembers_is_said():
    found = measure_drive(noisy(1, 0.05, periods=200, memory=20.0), omega=SLOW_OMEGA)
    assert found.memory > 0.4
    assert "the noise has a memory" in found.answer[-1]


def test_a_scene_file_takes_drive_and_noise_from_the_file_beside_it(tmp_path):
    (tmp_path / "speed.csv").write_text(noisy(3, 0.05))
    path = tmp_path / "gears.toml"
    path.write_text(FROM_FILE)
    scene = Scene.load(path)
    found = measure_drive(tmp_path / "speed.csv", omega=SLOW_OMEGA)
    assert scene.drive == found.drive
    assert scene.alpha == pytest.approx(found.amplitude / 0.12)
    assert scene.sigma == pytest.approx(found.sigma_ratio * scene.alpha)
    assert Scene.from_toml(scene.to_toml()) == scene  # without the measurement
    path.write_text(FROM_FILE + "[scene]\nsigma = 0.5\n")
    assert Scene.load(path).sigma == 0.5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (FROM_FILE.replace("speed", "no"), "cannot be read"),
        (FROM_FILE.replace("file", "fil"), "did you mean 'file'"),
        ("[drive]\nperiods = 3" + MEASURED_GEARS, "drive.file = None: is missing"),
        ("[drive]\nfile = 'speed.csv'\n[scene]\nalpha = 1.5", r"needs \[gears\]"),
        (FROM_FILE + "amplitude = 0.3", "leave it out: the file of the drive"),
        (
            'gears = "x"\n[drive]\nfile = "speed.csv"',
            r"gears = 'x': write it as a table: \[gears\]",
        ),
        ("scene = ['x']\n" + FROM_FILE, r"scene = \['x'\]: write it as a table: \[scene\]"),
    ],
)
def test_bad_scene_files_are_refused(text, message, tmp_path):
    (tmp_path / "speed.csv").write_text(noisy(3, 0.05))
    (tmp_path / "gears.toml").write_text(text)
    with refusal(message):
        Scene.load(tmp_path / "gears.toml")


def test_the_command_writes_its_page_and_refuses_a_scene_without_a_measurement(tmp_path):
    done = rattle("drive", EXAMPLES / "measured-drive.toml", "--out", tmp_path / "out")
    assert "order 3" in done.output
    for name in ("drive.html", "drive.svg", "orders.csv"):
        assert (tmp_path / "out" / name).exists()
    assert "has no measured drive" in rattle("drive", EXAMPLES / "gearbox.toml", code=2).output


def test_the_example_is_found_again():
    """Within four of its standard errors, and in its interval: what make_driver_speed.py put into
    the file."""
    found = measure_drive(EXAMPLES / "driver-speed.csv", omega=167.0, driver_radius=32.0)
    assert [one.order for one in found.drive] == [1, 2, 3]
    off = found.table["amplitude_mm"][:3] - 32.0 * np.array([0.014, 0.0025, 0.0006])
    assert (abs(off) / found.table["se_mm"][:3] < 4.0).all()
    assert found.low < 0.05 < found.high
    assert "95 % interval" in found.answer[1]


ONE_SINE = ((1, 0.3, 0.2),)
TWO_SINES = ((1, 1.0, -1.0), (4, 0.12, 0.5))
SIGMA_ERROR = 1.0 / math.sqrt(2.0 * 95.0)  # relative standard error of sigma from 95 periods
SWING = tuple(0.3 * OMEGA**power for power in range(3))  # of the sine in each unit


def find(times=TIMES, orders=ONE_SINE, **settings):
    """What is found in a made measurement."""
    return measure_drive(measure(OMEGA, orders, times, **settings), omega=OMEGA)


def assert_exact(found, amplitude=0.3, order=1):
    """The one order that was put into the file, and no noise."""
    assert [one.order for one in found.drive if one.amplitude > 0.01] == [order]
    assert found.amplitude == pytest.approx(amplitude, rel=1e-4)
    assert found.sigma_ratio < 1e-4
    assert found.low == 0.0
    assert "sigma is at most" in found.answer[1]


@pytest.mark.parametrize(
    ("per_turn", "speeds", "wrap"),
    [(1, (300.0, 1200.0), math.inf), (2, (900.0, 700.0), 360.0)],
)
def test_over_the_angle_the_mean_speed_may_change(per_turn, speeds, wrap):
    angle = np.arange(0.0, 360.0 * 40, 2.0)
    speed = np.linspace(*speeds, len(angle)) * (1.0 + 0.02 * np.sin(np.radians(2.0 * angle)))
    text = write(angle % wrap, speed, "crank angle [deg],speed [rpm]")
    found = measure_drive(text, driver_radius=30.0, periods_per_turn=per_turn)
    assert_exact(found, amplitude=30.0 * 0.02 / 2.0, order=2 // per_turn)
    mean = re.search(r"the mean speed from ([\d.]+) to ([\d.]+) rpm", found.remarks[0])
    assert [float(mean[1]), float(mean[2])] == pytest.approx(sorted(speeds), rel=2e-3)


def teeth(number=60, turns=100):
    """Times at which a driver with a mean speed of 80 rad/s passes its teeth."""
    angle = np.arange(0.0, turns * 2.0 * math.pi, 2.0 * math.pi / number)
    times = angle / 80.0
    for _ in range(50):
        times = (angle - 0.01 * np.sin(OMEGA * times)) / 80.0
    return times


@pytest.mark.parametrize(
    ("quantity", "settings"),
    [
        ("displacement", {"extra": 5.0 * TIMES**2 - 3.0}),
        ("displacement", {"extra": 2.0 * np.sin(2.0 * TIMES)}),
        ("speed", {"extra": 100.0 * TIMES + 2000.0}),
        ("acceleration", {"extra": 9810.0}),
        ("displacement", {"times": np.cumsum(2.5e-4 * np.linspace(1.0, 2.0, 8000))}),
        ("acceleration", {"times": np.delete(TIMES, np.arange(5, 8000, 60))}),
        ("speed", {"times": teeth()}),
    ],
)
def test_what_moves_slowly_is_no_order_and_the_times_are_used_as_they_are(quantity, settings):
    found = find(quantity=quantity, **settings)
    assert_exact(found)
    assert found.left_out < 1e-3
    assert abs(found.amplitude - 0.3) < max(10.0 * found.table["se_mm"][0], 1e-7)


@pytest.mark.parametrize(
    ("quantity", "order", "cycle", "ratio"),
    [
        ("displacement", 0.5, 2, 0.0),
        ("speed", 1.5, 2, 0.02),
        ("acceleration", 1 / 3, 3, 0.0),
    ],
)
def test_an_order_between_whole_ones_is_named_and_no_noise(quantity, order, cycle, ratio):
    power = QUANTITIES.index(quantity)
    size = 0.1 if ratio else 0.02
    extra = moved(OMEGA * TIMES, power, ((order, size, 1.0),)) * OMEGA**power
    found = find(quantity=quantity, ratio=ratio, extra=extra)
    said = next(remark for remark in found.remarks if "repeats only after" in remark)
    assert f"after {cycle} periods" in said
    assert f"order {order:.3g} " in said
    assert [one.order for one in found.drive] == [1]
    assert found.sigma_ratio == pytest.approx(ratio, rel=4.0 * SIGMA_ERROR, abs=1e-5)
    if ratio == 0.0:
        assert found.left_out == pytest.approx(0.02 * order**2 / 0.3, rel=0.02)


@pytest.mark.parametrize(
    ("power", "rows", "ratio", "jump"),
    [
        (0, [4000], 0.02, 1.5),
        (1, [100, 900, 4000, 5000, 7000], 0.0, 0.05),
        (2, [4000, 4001, 4002], 0.0, 1e6),
    ],
)
def test_bad_samples_are_named_and_decide_nothing(power, rows, ratio, jump):
    spikes = np.zeros(len(TIMES))
    spikes[rows] = jump * SWING[power]
    clean, found = (
        find(quantity=QUANTITIES[power], ratio=ratio, extra=extra, seed=3)
        for extra in (0.0, spikes)
    )
    assert f"line {rows[0] + 2} (" in found.remarks[0]
    assert found.amplitude == pytest.approx(clean.amplitude, rel=2e-3)
    assert found.sigma_ratio == pytest.approx(clean.sigma_ratio, rel=0.1, abs=1e-5)


def test_a_bad_stretch_costs_its_periods_alone():
    speed = 800.0 + 20.0 * np.sin(OMEGA * TIMES)
    speed[4000:4060] = 0.0
    text = write(TIMES, speed, "time [s],speed [rpm]")
    found = measure_drive(text, omega=OMEGA, driver_radius=30.0)
    assert_exact(found, amplitude=20.0 * math.pi / OMEGA)
    assert "2 of 95 periods are left out, far off the others: line 3940 to 4023" in found.answer[-1]


def drifting(power, ratio, wave):
    """A file whose frequency is 1 + `wave` of its mean."""
    tau = OMEGA * cumulative_trapezoid(1.0 + wave, TIMES, initial=0.0)
    values = moved(tau, power, ONE_SINE)
    if ratio:
        values += wander(np.random.default_rng(1), ratio, tau, power, ONE_SINE)
    head = f"time [s],{QUANTITIES[power]} [{UNITS_OF_POWERS[power]}]"
    return write(TIMES, values * (OMEGA * (1.0 + wave)) ** power, head)


@pytest.mark.parametrize(
    ("power", "ratio", "wave"),
    [
        (0, 0.03, 0.005 * (TIMES - 1.0)),
        (1, 0.0, 0.005 * np.sin(math.pi * TIMES)),
    ],
    ids=["ramp", "swing"],
)
def test_a_drifting_frequency_is_no_noise(power, ratio, wave):
    found = measure_drive(drifting(power, ratio, wave), omega=OMEGA)
    assert found.amplitude == pytest.approx(0.3, rel=1e-4 + 0.5 * ratio)
    assert found.sigma_ratio == pytest.approx(ratio, rel=4.0 * SIGMA_ERROR, abs=1e-5)
    said = re.search(r"frequency runs from ([\d.]+) to ([\d.]+)", found.remarks[0])
    limits = OMEGA * (1.0 + wave.min()), OMEGA * (1.0 + wave.max())
    assert [float(said[1]), float(said[2])] == pytest.approx(limits, rel=1e-4 + 0.05 * ratio)


@pytest.mark.parametrize(("exact", "stated"), [(50.5, 50), (99.0, 100)])
def test_a_wrong_number_of_periods_is_corrected_and_said(exact, stated):
    times = np.arange(round(exact * 2.0 * math.pi / OMEGA / 2.5e-4)) * 2.5e-4
    found = measure_drive(measure(OMEGA, ONE_SINE, times), periods=stated)
    assert_exact(found)
    assert found.omega == pytest.approx(OMEGA, rel=1e-6)
    assert f"The file has {exact:.4g} periods, not the {stated}"[:20] in found.remarks[-1]


def measure_often(quantity, ratio, seeds):
    """What is found in made measurements of 30 periods with some noise of the measurement."""
    times = 2.0 * math.pi / OMEGA / 40.0 * np.arange(40 * 30)
    given = {"quantity": quantity, "ratio": ratio}
    given["noise"] = 2e-4 * OMEGA ** QUANTITIES.index(quantity)
    return [find(times, TWO_SINES, seed=seed, **given) for seed in range(seeds)]


def assert_coverage(quantity, ratio, seeds):
    """95 % of the intervals hold the noise, within 3.5 standard errors; half as much again is
    hardly in any."""
    found = measure_often(quantity, ratio, seeds)
    holds = sum(one.low <= ratio <= one.high for one in found)
    assert abs(holds - 0.95 * seeds) <= 3.5 * math.sqrt(seeds * 0.05 * 0.95)
    assert sum(one.low <= 1.5 * ratio <= one.high for one in found) <= 0.3 * seeds


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_the_interval_holds_in_a_few(quantity):
    assert_coverage(quantity, 0.15, 10)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("quantity", "ratio"), [("displacement", 0.02), ("speed", 0.15), ("acceleration", 0.5)]
)
def test_the_interval_holds_for_each_quantity(quantity, ratio):
    assert_coverage(quantity, ratio, 100)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_noise_of_the_measurement_is_none_of_the_drive(quantity):
    """The 95 % interval of no noise starts at 0; the floor is what the scatter would be taken
    for."""
    found = measure_often(quantity, 0.0, 12)
    assert sum(one.low == 0.0 for one in found) >= 11
    assert all("sigma is at most" in one.answer[1] for one in found if one.low == 0.0)
    floor = np.mean([one.floor for one in found])
    assert np.mean([one.sigma_ratio for one in found]) < floor / 2.0
    assert np.mean([one.high for one in found]) < 2.0 * floor


CLEAN = noisy(3, 0.0, periods=20)


@pytest.mark.parametrize(
    ("text", "settings", "message"),
    [
        (CLEAN, {}, "gears.omega = None: give the frequency"),
        (CLEAN, {"omega": 1.3 * SLOW_OMEGA}, "is not in the file"),
        (
            measure(OMEGA, ONE_SINE, TIMES),
            {"periods": 66},
            "drive.periods = 66: is not in the file",
        ),
        (CLEAN, {"omega": SLOW_OMEGA, "periods": 19}, "periods = 19: would be a frequency of"),
        (CLEAN, {"omega": SLOW_OMEGA, "highest_order": 0}, "highest_order = 0"),
        (
            CLEAN.replace("mm/s", "rad/s"),
            {"omega": SLOW_OMEGA},
            "driver_radius = None: give it, in mm, for a drive in rad/s",
        ),
        (
            write(TIMES, 0.0 * TIMES + 3.0),
            {"omega": SLOW_OMEGA},
            r"displacement = 3\.0: is the same in all rows",
        ),
    ],
)
def test_what_holds_no_such_motion_is_refused(text, settings, message):
    with refusal(message):
        measure_drive(text, **settings)
