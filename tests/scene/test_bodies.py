"""Bodies that are no gears: springs, walls that stand alone, noise that acts on a body, and what is
refused."""

import math
from dataclasses import replace
from itertools import product

import mpmath
import numpy as np
import pytest
from oracle import PRECISE, gearbox
from refusals import refusal, refusal_in_words
from scenes import FOUR, ORDERS, THREE, dat21, tree
from scipy.integrate import solve_ivp

from rattle import Order, Scene, Start, Wheel, follow, mean_map
from rattle.compare.study.design import read_axes
from rattle.compare.study.parameters import find_parameter
from rattle.scene.changes import change, parameter_names
from rattle.scene.flight import field, field_rate, flow, jacobian, noise_covariance
from rattle.scene.spring import sprung


def oscillator(noise=1, **wheel):
    """A body that a spring holds, on a table that shakes with three orders."""
    held = Wheel(**({"beta": 0.1, "gamma": 0.2, "gap": 0.4, "stiffness": 2.0} | wheel))
    start = Start(0.3, -0.05, 0.5)
    return Scene(
        alpha=1.2, epsilon=0.8, sigma=0.1, noise=noise, drive=ORDERS, wheels=[held], start=start
    )


OSCILLATORS = {
    "two walls": oscillator(),
    "one wall": oscillator(one_sided=True),
    "wall in the middle": oscillator(one_sided=True, gap=0.0),
    "critically damped": oscillator(beta=2.0 * math.sqrt(2.0)),
    "overdamped": oscillator(beta=6.0, gap=0.1),
    "noise of the table": oscillator(noise="drive"),
}
BODIES = OSCILLATORS | {
    "noise on the second of two wheels": replace(tree((0, 1)), sigma=0.1, noise=2),
    "noise on a wheel that drives two": replace(FOUR, noise="2"),
}


@mpmath.workdps(120)
def response(beta, stiffness, t):
    """The response of a body that a spring holds, and the size of its growing part."""
    b, k, t = (mpmath.mpf(value) for value in (beta, stiffness, t))
    b += mpmath.mpf("1e-50")  # never critical
    root = mpmath.sqrt(b * b / 4 - k)
    up, down = (mpmath.exp((sign * root - b / 2) * t) for sign in (1, -1))
    e = mpmath.re((up - down) / (2 * root))
    d = mpmath.re(up + down) / 2 - b / 2 * e
    return np.array([e, d, (1 - d - b * e) / k], float), float(max(abs(up), abs(down)))


CRITICAL = [2.0 * (1.0 + off) for off in (0.0, 3e-16, -4e-16, 1e-14, -1e-10, 1e-7, -1e-5, 1e-3)]
DAMPING_RATIOS = (0.0, 1e-9, 1e-3, 1.0, *CRITICAL, 3.0, 1e3)  # over the root of the stiffness
RESPONSE_TIMES = (1e-12, 1e-3, 0.1, 0.5, 0.99, 1.0, 3.0, 10.0, 1e3, -1e-12, -1e-3, -0.5, -5.0)
INPUT_CHANGE = 1e-8
"""Relative change of an input that shows how much its rounding changes the response."""


def worst_response(planted=1.0):
    """The largest error of a response, in units of what the rounding of its inputs and of itself
    changes; `planted` is a factor on the damping."""
    worst = 0.0
    for frequency, damping, t in product((1e-3, 1.0, 6.1, 1e2), DAMPING_RATIOS, RESPONSE_TIMES):
        if t < 0.0 and (damping + 1.0) * frequency * abs(t) > 100.0:
            continue
        inputs = np.array([damping * frequency, frequency**2, t])
        exact, growth = response(*inputs)
        # what a sine or a difference of two exponentials is small against
        unit = np.maximum(abs(exact), [growth * min(abs(t), 1.0 / frequency), growth, 0.0])
        for step in INPUT_CHANGE * np.eye(3):
            changed, _ = response(*inputs * (1.0 + step))
            unit += abs(changed - exact) / INPUT_CHANGE
        error = abs(sprung(*inputs * [planted, 1.0, 1.0]) - exact)
        worst = max(worst, (error / np.maximum(1e-16 * unit, 1e-290)).max())
    return worst


def test_response_of_a_spring_is_exact_to_rounding():
    assert worst_response() < 10.0 < worst_response(planted=1.0 + 1e-14)


@pytest.mark.parametrize("scene", OSCILLATORS.values(), ids=OSCILLATORS)
def test_impacts_of_an_oscillator_are_those_of_an_ode_solver(scene):
    orbit = follow(scene, 12)
    assert orbit.found == 12
    (body,) = scene.constants.wheels
    walls = np.where(orbit.side[1:] == 1, body.wall, -body.low)
    assert (orbit.before[1:, 0] == walls).all()
    assert gearbox(scene.constants, scene.drive).largest_error(orbit) < 1e-9


def test_a_table_may_shake_at_another_phase_than_a_force():
    """A body on a spring to the ground, pushed by a force, above a table with a phase of its own:
    in absolute places it flies as on the drive that the guide gives; on that of the table alone it
    does not."""
    body = Wheel(beta=0.2, gamma=0.3, stiffness=1.5, one_sided=True, gap=0.4)
    table = 0.6
    force = 0.8
    phase = 1.1

    def fly(tau, z):
        pushed = force * math.sin(tau + phase) - body.gamma
        return [z[1], pushed - body.beta * z[1] - body.stiffness * z[0]]

    def place(tau, state):
        return table * np.array([math.sin(tau), math.cos(tau)]) - state

    def largest_error(drive):
        order = Order(1, 1.0, float(np.angle(drive)))
        scene = Scene(alpha=abs(drive), epsilon=0.8, drive=(order,), wheels=[body], start=Start())
        orbit = follow(scene, 6)
        errors = []
        for k in range(6):
            begin, end = orbit.tau[k : k + 2]
            flown = solve_ivp(fly, (begin, end), place(begin, orbit.after[k]), **PRECISE)
            errors.append(flown.y[:, -1] - place(end, orbit.before[k + 1]))
        return np.abs(errors).max()

    own = complex(-1.0, body.beta)
    drive = (table * (own + body.stiffness) - force * np.exp(1j * phase)) / own
    assert largest_error(drive) < 1e-7 < largest_error(table)


@pytest.mark.parametrize("scene", [*BODIES.values(), THREE], ids=[*BODIES, "three orders"])
def test_noise_of_a_flight_is_that_of_an_ode_solver(scene):
    box = gearbox(scene.constants, scene.drive)
    other = replace(scene, noise="drive" if scene.noisy_wheel else 1)  # negative control
    for t in (0.3, 7.0):
        exact = box.covariance(0.4, np.zeros((2 * scene.stages, 2 * scene.stages)), t)
        sd = np.sqrt(exact.diagonal())
        unit = np.outer(sd, sd)
        off, wrong = (abs(noise_covariance(s.constants, 0.4, t) - exact) for s in (scene, other))
        assert (off <= 1e-9 * unit).all()
        assert (wrong > 1e-2 * unit)[unit > 0.0].any()
    # a short flight: the variance of an integral of white noise, without loss of digits
    short = noise_covariance(scene.constants, 0.4, 1e-9)
    push = scene.sigma * box.noise_direction(0.4 + 1e-9)[1::2]
    assert short[::2, ::2] == pytest.approx(np.outer(push, push) * 1e-27 / 3.0, rel=1e-7, abs=0.0)


@pytest.mark.parametrize("name", BODIES)
def test_covariances_of_independent_noises_add(name):
    scene = BODIES[name]
    intensities = {"drive": 1.0} | {i: 0.3 + i for i in range(1, scene.stages + 1)}

    def covariance(noise):
        return noise_covariance(replace(scene, noise=noise).constants, 0.4, 7.0)

    parts = [size**2 * covariance(source) for source, size in intensities.items()]
    assert covariance(intensities) == pytest.approx(sum(parts), rel=1e-12)
    del intensities["drive"]
    assert covariance(intensities) == pytest.approx(sum(parts[1:]), rel=1e-12)


@pytest.mark.parametrize("name", BODIES)
def test_derivatives_are_differences(name):
    c = BODIES[name].constants
    state = np.linspace(-0.3, 0.4, 2 * c.wheels.size)
    unit = np.eye(state.size)
    begin = flow(c, 0.4, state, 1.3)
    across = np.array([flow(c, 0.4, state + step, 1.3) - begin for step in unit]).T
    assert jacobian(c, 1.3) == pytest.approx(across, abs=1e-13)
    h = 1e-4
    rate = (field(c, 0.4 + h, state) - field(c, 0.4 - h, state)) / (2.0 * h)
    # with the wheels' own speeds the driver's moves too
    assert field_rate(c, 0.4) == pytest.approx(rate, abs=1e-5)


def test_a_ball_bounces_geometrically_until_it_rests():
    body = Wheel(gamma=9.8, gap=0.0, one_sided=True, epsilon=0.6)
    scene = Scene(alpha=0.0, wheels=[body], start=Start(0.5, 0.0, -3.0))
    orbit = follow(scene, 60)
    assert orbit.found > 20
    impacts = slice(1, orbit.found + 1)
    speeds = 3.0 * 0.6 ** np.arange(orbit.found)
    assert orbit.before[impacts, 1] == pytest.approx(speeds, rel=1e-9)
    assert orbit.flight[impacts] == pytest.approx(2.0 * speeds / 9.8, rel=1e-9)
    assert (orbit.side[impacts] == 1).all()
    (rest,) = orbit.sticking
    assert rest.closed == pytest.approx(0.5 + 2.0 * 3.0 / 9.8 / 0.4, rel=1e-9)
    assert rest.opened == math.inf


def test_the_intensity_of_one_noise_of_several_is_a_value():
    scene = replace(OSCILLATORS["one wall"], noise={"drive": 1.0, 1: 0.5})
    assert "noise.1" in parameter_names(scene)
    assert change(scene, {"noise.1": 0.7}) == replace(scene, noise={"drive": 1.0, 1: 0.7})


BALL_VALUES = {"gamma": 1.0, "one_sided": True, "name": "ball"}
ON_SPRING = Wheel(stiffness=2.0, name="mass")
REFUSED = [  # body, scene, and what is said
    ({}, {"noise": "bal"}, "noise = 'bal': … one of: drive, ball"),
    ({}, {"noise": {1: 0.2, "ball": 0.3}}, "noise = … each source once"),
    ({}, {"noise": {"ball": 0.0}}, "noise = … one that is not 0"),
    ({}, {"noise": {"ball": -1.0}}, "noise.ball = -1.0: must be 0 or greater"),
    ({}, {"noise": {"drive": 2.0}}, "noise.drive = 2.0: … is sigma itself"),
    (
        {},
        {"noise": {"drive": 1, "ball": 1.0}, "correlation_time": 0.3},
        "correlation_time = 0.3: of several noises each is white",
    ),
    ({"stiffness": -1.0}, {}, "wheel.stiffness = -1.0: must be 0 or greater"),
    ({"tolerance": 0.1}, {}, "wheel.tolerance = 0.1: … has no tolerance"),
    ({"one_sided": 1}, {}, "wheel.one_sided = 1: … true or false"),
    ({"one_sided": False, "gap": 0.0}, {}, "wheel.gap = 0.0: must be greater than 0"),
    ({}, {"start": Start(0.0, 0.6, 0.0)}, "start.x1 = 0.6: … or before it"),
    ({}, {"start": Start(0.0, 0.5, 1.0)}, "start.y1 = 1.0: … must move inward"),
    ({}, {"start": Start(0.0, 0.5, -1.0, mesh=1)}, "start.mesh = 1: … y1 outward"),
    (
        {},
        {"wheels": [ON_SPRING, Wheel(parent=1)]},
        "body.mass.stiffness = 2.0: … drives no other",
    ),
    (
        {},
        {"wheels": [Wheel(name="any"), replace(ON_SPRING, parent="any")]},
        "body.mass.stiffness = 2.0: … strikes the driver",
    ),
]


@pytest.mark.parametrize(("body", "scene", "said"), REFUSED)
def test_what_cannot_be_is_refused(body, scene, said):
    with refusal_in_words(said):
        Scene(**({"alpha": 0.0, "epsilon": 0.8, "wheels": [Wheel(**BALL_VALUES | body)]} | scene))


TWO_BODIES = """[scene]
epsilon = 0.8

[[body]]
one_sided = true

[[body]]
name = "mass"
"""


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ("stiffness = -1.0", "line 9: body.mass.stiffness = -1.0: must be 0 or greater"),
        ("restitution.sd = 2", "line 9: body.mass.restitution.sd = 2: must lie between 0 and 1"),
        ('parent = "bal"', "line 9: body.mass.parent = 'bal': no body has this name"),
        ("stiff = 1.0", "line 9: body = 'stiff': unknown key; did you mean 'stiffness'"),
        ("[[body]]\ngap = -0.1", "line 10: body.3.gap = -0.1: must be greater than 0"),
        ("[scene.start]\nmesh = 3", "line 10: start.mesh = 3: a scene of 2 bodies has no contact"),
    ],
)
def test_an_error_in_a_file_names_body_line_and_remedy(tmp_path, key, said):
    path = tmp_path / "bodies.toml"
    path.write_text(TWO_BODIES + key)
    with refusal_in_words(said):
        Scene.load(path)


@pytest.mark.parametrize(
    "name", ["body.mass.stiffness", "wheel.mass.stiffness", "body.1.stiffness"]
)
def test_a_value_of_a_body_by_its_name(name):
    scene = Scene(alpha=1.0, epsilon=0.8, wheels=[ON_SPRING])
    parameter = find_parameter(scene, name)
    assert (parameter.name, parameter.value) == ("body.mass.stiffness", 2.0)
    assert parameter.scene_at(3.0).wheels == (replace(ON_SPRING, stiffness=3.0),)
    (axis,) = read_axes([{name: [1.0, 2.0]}], scene)
    assert axis.names == ("body.mass.stiffness",)
    with refusal(r"did you mean 'body\.mass\.stiffness'"):
        find_parameter(scene, name.replace("ness", "nes"))


def test_a_file_of_bodies_has_bodies():
    for scene in BODIES.values():
        assert ("body" in scene.to_dict()) is not scene.is_gears


def test_gears_with_noise_on_a_wheel_are_gears():
    assert dat21(0.1, noise=2).words.wheel == "wheel"


@pytest.mark.parametrize("closure", ["published", "corrected"])
def test_the_closures_of_the_paper_are_for_gears(closure):
    scene = Scene(
        alpha=0.0, epsilon=0.8, wheels=[Wheel(**BALL_VALUES)], start=Start(0.0, 0.0, -3.0)
    )
    with refusal(f"{closure} is the paper's", "scene"):
        mean_map(scene, impacts=2, closure=closure)
