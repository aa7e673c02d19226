import pickle
from dataclasses import replace

import numpy as np
import pytest
from refusals import refusal_in_words
from scenes import FOUR, OSCILLATOR, THREE, TREES, chain, dat21

import rattle.scene
from rattle import DAT21, Gears, InputError, Order, Scene, Start, Tolerance, Wheel
from rattle.scene import Restitution

VALUES = {
    "alpha": 1.5,
    "epsilon": 0.9,
    "beta1": 0.08,
    "beta2": 0.13,
    "gamma1": 0.06,
    "gamma2": 0.03,
    "mu": 0.6,
    "gap1": 0.5,
    "gap2": 0.4,
    "sigma": 0.1,
}
NON_NEGATIVE = ("alpha", "beta1", "beta2", "gamma1", "gamma2", "sigma")
POSITIVE = ("omega", "inertia1", "inertia2", "radius1", "radius2", "backlash1", "backlash2")
GIVEN = {
    Scene: VALUES,
    Gears: DAT21.values,
    Wheel: {"beta": 0.1, "gamma": 0.2},
    Tolerance: {},
    Start: {},
}


BAD_VALUES = {
    Scene: [
        *((name, -1e-9, "must be 0 or greater") for name in NON_NEGATIVE),
        ("gap1", 0.0, "must be greater than 0"),
        ("epsilon", -0.01, "must lie between 0 and 1"),
        ("epsilon", 1.2, "must lie between 0 and 1"),
        ("epsilon", None, "is needed, or give wheels"),
        ("mu", 0.0, "between 0 and 1"),
        ("mu", 1.0, "between 0 and 1"),
        ("stages", 0, "must be at least 1"),
        ("stages", 3, "must be at most 2"),
        ("stages", 2.0, "give a whole number"),
        ("stages", True, "give a whole number"),
        ("tolerance", False, "give a Tolerance"),
        ("start", (0.0, 0.5, 2.0, 0.5, 2.0), "give a Start"),
        ("alpha", float("-inf"), "give a finite number"),
        ("alpha", "0.5", "give a number"),
        ("alpha", True, "give a number"),
    ],
    Gears: [
        *((name, 0.0, "must be greater than 0") for name in POSITIVE),
        *((name, -1.0, "must be 0 or greater") for name in ("damping2", "torque1", "torque2")),
        ("epsilon", 1.1, "must lie between 0 and 1"),
        ("omega", 1j, "give a number"),
    ],
    Wheel: [(name, 0.0, "must be greater than 0") for name in ("gap", "mass", "ratio")],
    Tolerance: [
        ("c1_max", -0.1, "must be 0 or greater"),
        ("distribution", "unifrom", "did you mean 'uniform'?"),
        ("distribution", "zzz", "valid are 'fixed', 'uniform', 'normal'"),
        ("draw", None, "valid are 'path', 'contact'"),
    ],
    Start: [
        ("mesh", 33, "must be at most 32"),
        ("mesh", -1, "must be at least 0"),
        ("mesh", 2.0, "give a whole number"),
    ],
}
FINITE = {
    Scene: VALUES,
    Gears: DAT21.values,
    Tolerance: ("c1_max", "c2_max"),
    Start: ("tau", "x1", "y1", "x2", "y2"),
}
for kind, names in FINITE.items():
    BAD_VALUES[kind] += [(name, float("nan"), "give a finite number") for name in names]


@pytest.mark.parametrize(
    ("kind", "field", "value", "remedy"),
    [(kind, *row) for kind in BAD_VALUES for row in BAD_VALUES[kind]],
)
def test_a_bad_value_is_refused_by_field_value_and_remedy(kind, field, value, remedy):
    prefix = "" if kind in (Scene, Gears) else f"{kind.__name__.lower()}."
    with refusal_in_words(f"{prefix}{field} = {value!r}: …{remedy}"):
        kind(**GIVEN[kind] | {field: value})


FIRST_WHEEL = Wheel(beta=0.1, gamma=0.2)
SECOND_WHEEL = replace(FIRST_WHEEL, parent=1, name="two")


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"tolerance": Tolerance(c1_max=0.5)}, "tolerance.c1_max = 0.5: must be below gap1 = 0.5"),
        ({"tolerance": Tolerance(c2_max=0.4)}, "tolerance.c2_max = 0.4: must be below gap2 = 0.4"),
        ({"start": Start(x1=0.6)}, "start.x1 = 0.6: must lie on a flank (+-0.5) or inside +-0.5"),
        ({"start": Start(x1=0.5, y1=0.0, mesh=1)}, "start.mesh = 1: … given x1 = 0.5, y1 = 0.0"),
        ({"start": Start(x1=0.4, y1=1.0, mesh=1)}, "start.mesh = 1: … needs x1 = +-0.5"),
        ({"start": Start(x2=-0.4, y2=1.0, mesh=2)}, "start.mesh = 2: … y2 outward"),
        ({"start": Start(x2=-0.4, y2=0.0)}, "start.y2 = 0.0: … must move inward, or give mesh=2"),
        ({"start": Start(mesh=3)}, "start.mesh = 3: a scene of 2 wheels has no mesh 3"),
        (
            {"tolerance": Tolerance(c1_max=0.1), "start": Start(x1=0.45)},
            "start.x1 = 0.45: … inside +-0.4",
        ),
        (
            {"stages": 1, "start": Start(x2=0.4, y2=1.0, mesh=2)},
            "start.mesh = 2: a single-stage scene has mesh 1 only",
        ),
        ({"wheels": FIRST_WHEEL}, f"wheels = {FIRST_WHEEL!r}: give a sequence of Wheel"),
        ({"wheels": [FIRST_WHEEL, 3]}, "wheels = 3: give a sequence of Wheel"),
        ({"wheels": [FIRST_WHEEL] * 33}, "wheels = 33: at most 32 wheels"),
        (
            {"wheels": [FIRST_WHEEL, replace(FIRST_WHEEL, parent=3)]},
            "wheel.2.parent = 3: there are 2 wheels",
        ),
        (
            {"wheels": [FIRST_WHEEL, replace(FIRST_WHEEL, parent="tow")]},
            "wheel.2.parent = 'tow': no wheel has",
        ),
        (
            {"wheels": [replace(FIRST_WHEEL, parent=2), SECOND_WHEEL]},
            "wheel.1.parent = 2: … itself in a circle",
        ),
        (
            {"wheels": [FIRST_WHEEL, SECOND_WHEEL, SECOND_WHEEL]},
            "wheel.3.name = 'two': two wheels have this name",
        ),
        (
            {"wheels": [FIRST_WHEEL], "epsilon": None},
            "wheel.1.epsilon = None: give it one, or the scene",
        ),
        ({"wheels": [FIRST_WHEEL], "beta1": 0.1}, "beta1 = 0.1: give it, or wheels; not both"),
        (
            {"wheels": [FIRST_WHEEL] * 2, "start": Start(state=(0.1, 0.2, 0.6, 0.0))},
            "start.x2 = 0.6: must lie on a flank",
        ),
    ],
)
def test_a_start_or_wheels_that_cannot_be_are_refused(settings, said):
    given = {"alpha": 1.0, "epsilon": 0.5} if "wheels" in settings else VALUES
    with refusal_in_words(said):
        Scene(**given | settings)


def test_two_wheels_in_a_row_are_the_short_form():
    row = [replace(FIRST_WHEEL, mass=2.0), Wheel(beta=0.3, gamma=0.1, gap=0.4, mass=3.0, parent=1)]
    scene = Scene(alpha=1.0, epsilon=0.5, wheels=row)
    short = {"beta1": 0.1, "gamma1": 0.2, "beta2": 0.3, "gamma2": 0.1, "gap2": 0.4, "mu": 0.6}
    assert scene == Scene(alpha=1.0, epsilon=0.5, **short)
    assert Scene(alpha=1.0, wheels=[replace(FIRST_WHEEL, epsilon=0.5)]).stages == 1


def test_what_a_scene_keeps_of_its_wheels_is_never_that_of_another():
    scene = FOUR
    walls = scene.constants.wheels["wall"]
    wide = replace(scene, wheels=[replace(wheel, tolerance=0.1) for wheel in scene.wheels])
    for other, gap in ((wide.noise_free, 1.0), (scene.scaled(2.0), 2.0)):
        assert other.constants.wheels["wall"].tolist() == (gap * walls).tolist()
    assert {wheel.tolerance for wheel in wide.noise_free.tree} == {0.0}
    assert (wide.differs_by_set, scene.differs_by_set) == (True, False)
    assert pickle.loads(pickle.dumps(scene)) == scene
    several = replace(scene, drive=(Order(1), Order(2, 0.3)))
    assert several.constants.drive.waves is not several.constants.drive.waves


def test_a_scene_keeps_its_gears_while_they_are_its_gears():
    scene = Scene.from_gears(DAT21, sigma=0.1)
    for same in ({}, {"stages": 1}, {"tolerance": Tolerance(0.1, 0.1)}, {"start": Start()}):
        assert replace(scene, **same).gears is DAT21
        assert "[gears]" in replace(scene, **same).to_toml()
    for other in ({"alpha": 2.0}, {"gap2": 0.6}, {"gears": None}):
        assert replace(scene, **other).gears is None
    assert replace(scene, alpha=2.0).alpha == 2.0
    assert Scene.from_toml(replace(scene, alpha=2.0).to_toml()).alpha == 2.0


@pytest.mark.parametrize("distribution", ["fixed", "uniform", "normal"])
def test_only_a_fixed_tolerance_moves_the_walls_and_stays_where_there_is_no_noise(distribution):
    tolerance = Tolerance(0.05, 0.0, distribution=distribution)
    scene = Scene(**VALUES, tolerance=tolerance)
    fixed = distribution == "fixed"
    # Eqs. 20, 21 use g + c_max for every distribution
    assert scene.windows == pytest.approx((0.55, 0.4))
    assert scene.start_state == pytest.approx((0.55 if fixed else 0.5, 2.0, 0.4, 2.0))
    assert scene.noise_free.sigma == 0.0
    assert scene.noise_free.tolerance == (tolerance if fixed else None)


MINIMAL = "alpha = 1.5\nepsilon = 0.9\nbeta1 = 0.1\ngamma1 = 0.0\nmu = 0.5\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "[scene]\n" + MINIMAL + "gama2 = 0.1",
            "scene = 'gama2': unknown key; did you mean 'gamma2'?",
        ),
        ("[scen]\n" + MINIMAL, "top level = 'scen': unknown key; did you mean 'scene'?"),
        (
            "[scene]\n" + MINIMAL + "[scene.start]\nmesch = 1",
            "scene.start = 'mesch': unknown key; did you mean 'mesh'",
        ),
        ("[scene]\n" + MINIMAL + "qqqq = 1", "valid are 'alpha', "),
        ("[scene]\nalpha = 1.0", "scene = ['epsilon', 'beta1', 'gamma1']: these keys are missing"),
        ("[gears]\nalpha = 1.0", "gears = ['epsilon', 'omega', "),
        ("[gears]\nOmegga = 1.0", "did you mean 'omega'?"),
        ("scene = 3", "scene = 3: write it as a table: [scene]"),
        (
            "[scene]\n" + MINIMAL + "start = 1",
            "scene.start = 1: write it as a table: [scene.start]",
        ),
        ("", "these keys are missing"),
    ],
)
def test_toml_refuses_in_words(text, words):
    with refusal_in_words(words):
        Scene.from_toml(text)


NAMESPACE = vars(rattle.scene)
LOOSE = replace(DAT21, backlash2=0.25)
FIRST_OF_FOUR = replace(FOUR.wheels[0], tolerance=0.01, name="in")
NAMED = replace(
    FOUR, wheels=[FIRST_OF_FOUR, *FOUR.wheels[1:]], noise={"drive": 1, "in": 0.2, "3": 0.5}
)


@pytest.mark.parametrize(
    "scene",
    [
        Scene.from_gears(LOOSE, sigma=0.1, tolerance=Tolerance(0.01, 1e-3, draw="contact")),
        Scene(alpha=1.5, epsilon=0.9, beta1=1 / 3, gamma1=0.0, stages=1, start=Start(tau=7.0)),
        Scene(alpha=1.5, epsilon=0.9, beta1=0.1, gamma1=0.0, mu=0.5, sigma=-0.0),
        TREES["chain of 5"],
        NAMED,
        THREE,
        replace(THREE, correlation_time=0.3, alpha=1.2),
        replace(dat21(0.1, noise=2), gears=None),
        replace(OSCILLATOR, sigma=0.1, noise={"drive": 1.0, 1: 0.5}),
        chain(Restitution(sd=0.05, least=0.8, speed=2.0), 0.1),
        chain(Restitution(table=[(0.5, 0.8), (2.0, 0.6)]), 0.1),
    ],
)
def test_its_repr_and_its_toml_make_a_scene_again_to_the_last_bit(scene):
    for again in (eval(repr(scene), NAMESPACE), Scene.from_toml(scene.to_toml())):
        assert (again, again.gears, repr(again)) == (scene, scene.gears, repr(scene))
    # one bit would be noticed
    assert repr(replace(scene, alpha=np.nextafter(scene.alpha, 9.0))) != repr(scene)
    assert "<pre>Scene" in scene._repr_html_()


def test_one_unit_of_dat21():
    time, length, speed, energy = DAT21.units
    assert (time, length, speed) == (pytest.approx(1000.0 / 300.0), 0.2, pytest.approx(60.0))
    rim_mass = 4000e-6 / 0.041**2  # kg
    assert energy == pytest.approx(1e3 * rim_mass * 0.060**2)  # mJ


def test_an_error_keeps_its_place_between_processes():
    error = InputError("sigma", -1.0, "must be 0 or greater", "mine.toml, line 2")
    error = pickle.loads(pickle.dumps(error))
    assert str(error) == "mine.toml, line 2: sigma = -1.0: must be 0 or greater"
    assert error.where == "mine.toml, line 2"
