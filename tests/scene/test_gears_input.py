"""Gears as an engineer writes them: the drive as an amplitude, tolerances of a drawing, and what
cannot be right."""

import re
from dataclasses import replace

import pytest
from refusals import refusal, refusal_in_words
from scenes import BESIDE_ALPHA

from rattle import DAT21, Gears, Scene, Start, Tolerance

DAT21_TEXT = "[gears]\n" + "".join(f"{name} = {value!r}\n" for name, value in BESIDE_ALPHA.items())
MOVING = "alpha = 1.5\nspeed_rpm = 800.0\ndriver_radius = 30.0\n"


def written(tmp_path, text):
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("drive", "words"),
    [
        ("alpha = 1.5\namplitude = 0.3", "gears = ['alpha', 'amplitude']: give the drive once"),
        ("", "gears = ['alpha']: these keys are missing"),
        ("amplitude_rad = 0.01", "gears.driver_radius = None: goes with amplitude_rad"),
        ("alpha = 1.0\ndriver_radius = 3.0", "gears.driver_radius = 3.0: goes with amplitude_rad"),
        ("amplitude = -0.3", "gears.amplitude = -0.3: must be 0 or greater"),
        (
            "alpha = 1.5\nspeed_rpm = 800",
            "gears.driver_radius = None: give the driver's base radius in mm",
        ),
        (
            "alpha = 1.5\ndriver_radius = 30.0\nspeed_rpm = 8\nspeed_rad_s = 9",
            "give the mean speed of the driver once",
        ),
        (
            "alpha = 1.5\ndriver_radius = 30.0\nspeed_rpm = -8",
            "gears.speed_rpm = -8: must be 0 or greater",
        ),
        (
            "alpha = 1.5\ntorque1_over_rpm = [[600, 5], [900, 6]]",
            "gears.speed_rpm = None: give it, and driver_radius: torque1_over_rpm is read at",
        ),
        (
            f"{MOVING}torque1_over_rpm = [[600, 5], [900]]",
            "gears.torque1_over_rpm = [900]: point 2 leaves a gap in the table",
        ),
        (
            f"{MOVING}torque1_over_rpm = [[600, 5], [900, nan]]",
            "gears.torque1_over_rpm: torque of point 2 = nan",
        ),
        (
            f"{MOVING}torque1_over_rpm = [[600, 5], [500, 6]]",
            "gears.torque1_over_rpm = 500: must be above 600",
        ),
        (
            f"{MOVING}torque1_over_rpm = [[600, 5], [900, 6]]",
            "gears.torque1 = 100.0: torque1_over_rpm is given too",
        ),
        (f"{MOVING}torque1_over_rpm = 5.0", "gears.torque1_over_rpm = 5.0: write it as"),
        (
            f"{MOVING}torque1_over_rpm = {{ polynomial = [5, 0.01] }}",
            "write { polynomial = [a0, a1, a2], rpm = [lowest, highest] }",
        ),
        (
            f"{MOVING}torque1_over_rpm = {{ polynomial = [5, 'a'], rpm = [600, 900] }}",
            "gears.torque1_over_rpm: a1 = 'a': give a number",
        ),
        (
            f"{MOVING}torque1_over_rpm = {{ polynomial = [5, 0.01], rpm = [900, 600] }}",
            "gears.torque1_over_rpm = [900, 600]: give a lowest speed and a higher one",
        ),
        (  # 5 at both ends, and less than nothing between them
            f"{MOVING}torque1_over_rpm = {{ polynomial = [545, -1.5, 1e-3], rpm = [600, 900] }}",
            "is -17.5 N mm at 750 1/min; drag cannot push a wheel",
        ),
        (
            "amplitude_rad = 0.01\ndriver_radius = 0.0",
            "gears.driver_radius = 0.0: must be greater than 0",
        ),
        ("amplitud = 0.3", "did you mean 'amplitude'?"),
        (
            "amplitude = 0.3\n[gears.tolerance]\nbacklash1 = 0.2",
            "gears.tolerance.backlash1 = 0.2: must be below",
        ),
        ("amplitude = 0.3\n[gears.tolerance]\nbacklash = 0.2", "did you mean 'backlash"),
        ("amplitude = 0.3\ntolerance = 1", "gears.tolerance = 1: write it as a table"),
        ("alpha = 1.5\n[gears.tolerance]\n[scene.tolerance]\nc1_max = 0.1", "give it once"),
    ],
)
def test_a_drive_or_tolerance_is_refused_in_words(drive, words):
    with refusal_in_words(words):
        Scene.from_toml(DAT21_TEXT + drive)


def test_the_tolerance_of_a_drawing_is_that_of_the_full_backlash():
    table = (
        '[gears.tolerance]\nbacklash1 = 0.05\nbacklash2 = 0.1\ndistribution = "normal"\ndraw ='
        ' "contact"\n'
    )
    scene = Scene.from_toml(DAT21_TEXT + "alpha = 1.5\n" + table)
    assert scene.tolerance == Tolerance(0.125, 0.25, distribution="normal", draw="contact")
    assert Scene.from_toml(scene.to_toml()) == scene


FIRST_WHEEL_TEXT = re.sub(".*2 = .*\n", "", DAT21_TEXT) + "alpha = 1.5\n"


def test_a_single_stage_needs_no_second_wheel_and_invents_none():
    scene = Scene.from_toml(FIRST_WHEEL_TEXT + "[scene]\nstages = 1")
    assert scene.tree == Scene.from_gears(DAT21, stages=1).tree
    assert not re.search("(inertia|radius|backlash|damping|torque)2", scene.to_toml() + repr(scene))
    assert Scene.from_toml(scene.to_toml()).gears == scene.gears
    with refusal(r"gears = \['inertia2', 'radius2'\]: .* write stages = 1 in \[scene\]"):
        Scene.from_toml(FIRST_WHEEL_TEXT)
    with refusal(r"gears\.tolerance\.backlash2 = 0\.1: belongs to wheel 2"):
        Scene.from_toml(
            FIRST_WHEEL_TEXT + "[gears.tolerance]\nbacklash2 = 0.1\n[scene]\nstages = 1"
        )


def test_the_mean_speed_adds_what_damping_takes_to_the_drag():
    """d Omega_i of each wheel at its own speed: R_i Omega_i is the same on all pitch circles."""
    moving = "amplitude = 0.3\ndriver_radius = 30.0\nspeed_rad_s = 80.0"
    gears = Scene.from_toml(DAT21_TEXT + moving).gears
    rim = 80.0 * 30.0
    assert gears.torque1 == pytest.approx(100.0 + 100.0 * rim / DAT21.radius1, rel=1e-14)
    assert gears.torque2 == pytest.approx(50.0 + 100.0 * rim / DAT21.radius2, rel=1e-14)
    assert gears.damping1 == DAT21.damping1


def test_what_acts_on_no_wheel_is_left_out_and_what_is_missing_is_named():
    text = re.sub(r"(backlash2|damping|torque).*\n", "", DAT21_TEXT)
    lines = [*text.splitlines(), "alpha = 1.5"]
    scene = Scene.from_toml("\n".join(lines))
    plain = replace(DAT21, damping1=0.0, damping2=0.0, torque1=0.0, torque2=0.0)
    assert scene.tree == Scene.from_gears(plain).tree
    assert scene.gears == plain
    for line in lines[1:]:
        name = line.split()[0]
        with refusal(rf"gears = \['{name}'\]: these keys are missing"):
            Scene.from_toml("\n".join(other for other in lines if other != line))


def load_changed(tmp_path, changes):
    """DAT21 with these values, from a file."""
    lines = [f"{name} = {value!r}\n" for name, value in (DAT21.values | changes).items()]
    return Scene.load(written(tmp_path, "[gears]\n" + "".join(lines)))


@pytest.mark.parametrize(
    ("changes", "field", "conversion"),
    [
        (
            {"inertia1": 0.004},
            "gears.inertia1",
            "the unit is kg mm^2: if 0.004 is in kg m^2, write 4000",
        ),
        ({"radius1": 0.041}, "gears.radius1", "the unit is mm: if 0.041 is in m, write 41"),
        ({"backlash2": 0.0002}, "gears.backlash2", "if 0.0002 is in m, write 0.2"),
        ({"backlash1": 200.0}, "gears.backlash1", "if 200 is in um, write 0.2"),
        ({"omega": 1e9}, "gears.omega", "faster than sound"),
        ({"torque1": 0.5}, "gears.torque1", "the unit is N mm: if 0.5 is in N m, write 500"),
        ({"alpha": 300.0}, "gears.alpha", "swings the driver's pitch circle by 60 mm"),
    ],
)
def test_gears_that_cannot_be_are_questioned_in_the_users_unit(
    tmp_path, changes, field, conversion
):
    with refusal_in_words(conversion, field=field):
        load_changed(tmp_path, changes)


@pytest.mark.parametrize(
    "changes",
    [
        {"inertia1": 4e7, "torque1": 1e5},
        {"omega": 1e5},
        {
            "radius1": 0.3,
            "radius2": 0.2,
            "inertia1": 1e-4,
            "inertia2": 1e-5,
            "backlash1": 0.01,
            "backlash2": 0.01,
            "damping1": 0.0,
            "damping2": 0.0,
            "torque1": 1.0,
            "torque2": 1.0,
        },
    ],
)
def test_gears_of_watches_and_of_ships_are_not(tmp_path, changes):
    assert load_changed(tmp_path, changes).gears == replace(DAT21, **changes)


def test_only_what_was_written_in_a_file_is_questioned(tmp_path):
    text = DAT21_TEXT.replace("inertia1 = 4000.0", "inertia1 = 0.004") + "alpha = 1.5"
    text = text.replace("damping1 = 100.0", "damping1 = 0.0")
    assert Scene.from_toml(text).beta1 == 0.0
    with refusal_in_words("mine.toml, line 4: gears.inertia1 = 0.004: is too little"):
        Scene.load(written(tmp_path, text))


@pytest.mark.parametrize(
    ("changes", "field", "parameter"),
    [
        ({"inertia1": 0.004}, "gears.inertia1", "beta1 = 8.33e+04"),
        ({"omega": 1e-4}, "gears.omega", "beta1"),
        ({"torque1": 1e11}, "gears.torque1", "gamma1"),
        ({"radius1": 1e-12, "radius2": 1e6}, "gears.radius1", "mu"),
        ({"backlash2": 1e-11}, "gears.backlash2", "gap2"),
    ],
)
def test_what_follows_from_gears_is_refused_by_their_fields(changes, field, parameter):
    with refusal_in_words(parameter, field=field):
        Scene.from_gears(replace(DAT21, **changes))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Scene(alhpa=1.0), "Scene = 'alhpa': unknown key; did you mean 'alpha'?"),
        (lambda: Scene.from_gears(DAT21, sigm=0.1), "did you mean 'sigma'?"),
        (lambda: Scene.from_gears(DAT21, beta1=0.1), "from_gears = 'beta1': unknown key"),
        (lambda: Start(tua=1.0), "did you mean 'tau'?"),
        (lambda: Tolerance(c1_mx=0.1), "did you mean 'c1_max'?"),
        (lambda: Gears(omgea=1.0), "did you mean 'omega'?"),
        (lambda: Gears(amplitude=1.0), "give it to Gears.driven"),
        (lambda: replace(DAT21, omgea=1.0), "did you mean 'omega'?"),
    ],
)
def test_an_unknown_keyword_suggests_the_nearest(make, words):
    with refusal_in_words(words):
        make()


@pytest.mark.parametrize(
    ("text", "where"),
    [
        (
            "[scene]\nalpha = 1.5\nepsilon = 2\nbeta1 = 0.1\ngamma1 = 0.0\nmu = 0.5\n",
            "line 3: epsilon = 2",
        ),
        ("[scene]\nalpha = 1.5\n", "mine.toml: scene = ['epsilon'"),
        (DAT21_TEXT + "alpha = 1.5\n[scene.start]\n\ny1 = 'fast'", "line 17: start.y1 = 'fast'"),
        (
            DAT21_TEXT.replace("epsilon = 0.9", "epsilon = 9.0") + "alpha = 1.5",
            "line 2: gears.epsilon = 9.0",
        ),
        (DAT21_TEXT + "alpha = \n", "mine.toml: TOML = 'Invalid value (at line 14, column 9)'"),
        (DAT21_TEXT + "alpha = 1,5\n", "use a decimal point: 1.5"),
        (
            "name,value\nalpha,1.5\n",
            "write each value on a line as name = value, with a decimal point",
        ),
        ("alpha;epsilon\n1,5;0,9\n", "this looks like a table (CSV)"),
        (
            DAT21_TEXT + "amplitude_rad = 2.8\ndriver_radius = 30.0",
            "line 14: gears.amplitude_rad = 2.8: swings…if 2.8 is in degrees, write 0.0488692",
        ),
    ],
)
def test_an_error_from_a_file_names_file_line_and_key(tmp_path, text, where):
    with refusal_in_words("mine.toml", where.removeprefix("mine.toml")):
        Scene.load(written(tmp_path, text))
