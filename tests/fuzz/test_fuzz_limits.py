"""Limits of what is admitted, refused at the boundary by name, and what fuzzing has found at
them."""

import numpy as np
import pytest

from rattle import Sampling, validate
from rattle.closure import follow, mean_map
from rattle.compare.study.design import read_axes
from rattle.montecarlo import simulate
from rattle.scene import DAT21, FileError, InputError, Scene, Start, Tolerance
from rattle.scene.files import read_text, read_toml
from rattle.scene.impact import safe_time

PLAIN = {
    "alpha": 1.5,
    "epsilon": 0.9,
    "beta1": 0.08,
    "beta2": 0.08,
    "gamma1": 0.06,
    "gamma2": 0.03,
    "mu": 0.6,
}
DAT = Scene.from_gears(DAT21, sigma=0.1)


def scene(**changed):
    return Scene(**(PLAIN | {"sigma": 0.1} | changed))


@pytest.mark.parametrize(
    ("field", "inside", "beyond"),
    [
        ("alpha", (0, 1e-30, 1e6), (5e-324, 1e-31, 1.1e6, 1e200)),
        ("beta1", (0, 5e-324, 1e4), (1.1e4, 1e300)),
        ("beta2", (0, 5e-324, 1e4), (1.1e4, 1e300)),
        ("gamma1", (0, 1e-30, 1e6), (5e-324, 1.1e6)),
        ("gamma2", (0, 1e-30, 1e6), (5e-324, 1.1e6)),
        ("sigma", (0, 1e-30, 1e6), (5e-324, 1e-81, 1.1e6)),
        ("epsilon", (0, 5e-324, 1.0), (-1e-30, 1.1)),
        ("mu", (1e-30, 1.0 - 2.0**-53), (5e-324, 1.0, 0.0)),
        ("gap1", (1e-9, 1e6), (0.0, 9e-10, 1.1e6)),
        ("gap2", (1e-9, 1e6), (0.0, 9e-10, 1.1e6)),
        ("start.y1", (0.0, -1e6, 5e-324), (1.1e6, -1e7)),
        ("start.tau", (-1e12, 1e12, 5e-324), (1.1e12,)),
    ],
)
def test_the_range_of_a_field(field, inside, beyond):
    make = Start if "." in field else scene
    name = field.removeprefix("start.")
    for value in inside:
        assert getattr(make(**{name: value}), name) == value
    for value in beyond:
        with pytest.raises(InputError, match=f"^{field} = "):
            make(**{name: value})


def test_a_tolerance_whose_variance_would_vanish_is_refused():
    with pytest.raises(InputError, match="c1_max"):
        Tolerance(1e-300)


@pytest.mark.parametrize(
    "value", [10**30, "x" * 10_000, np.array([0.5, 0.6]), [[]], 1j, {}], ids=type
)
def test_any_value_is_refused_in_a_short_message(value):
    with pytest.raises(InputError, match=r"^alpha = ") as caught:
        scene(alpha=value)
    assert len(str(caught.value)) < 500
    with pytest.raises(InputError, match=r"^tolerance.distribution = "):
        Tolerance(0.1, distribution=value)


def test_keys_and_texts_of_any_kind():
    for data in (5, {5: 1.0}, {"scene": {5: 1.0}}, []):
        with pytest.raises(InputError):
            Scene.from_dict(data)
    with pytest.raises(FileError):
        read_toml("a = " + "9" * 5000)
    for path in ("\x00", 5, None):
        with pytest.raises(FileError, match="is no path"):
            read_text("scene file", path)


def test_clock_times_end_with_the_orbit_and_not_with_its_shifted_mean():
    m = mean_map(scene(sigma=1e6), impacts=3)
    last = follow(m.scene, 3).tau[m.trace.found]
    assert len(m.at_times([0.5 * last])) == 1
    with pytest.raises(InputError, match="times"):
        m.at_times([last + 1e9])
    for bad in ("", "abc", 3.0j, [None], [[1.0], [2.0, 3.0]], [np.nan]):
        with pytest.raises(InputError, match="times"):
            m.at_times(bad)


def test_a_displacement_on_its_wall_has_no_density():
    for closure in ("saltation", "branching"):
        m = mean_map(scene(sigma=0.0), impacts=1, closure=closure)
        assert m.density(1, "x1", np.array([0.0])) is None
        with pytest.raises(InputError, match="impact"):
            m.density({"a": 1}, "y1", np.array([0.0]))
    assert mean_map(DAT, impacts=1).density(1, "y1", np.array([-1.8])) is not None


@pytest.mark.parametrize("paths", [2, 3])
def test_a_control_of_few_paths_is_none(paths):
    """Three coefficients through three paths leave an error of 1e-10."""
    settings = {"paths": paths, "impacts": 1, "scheme": "exact-flight", "dt": 0.01}
    with_control, without = (
        simulate(DAT, **settings, sampling=Sampling(control=c)).section for c in (True, False)
    )
    assert with_control["se_y1"].to_list() == pytest.approx(without["se_y1"].to_list(), rel=1e-12)
    assert with_control["se_y1"].loc[1] > 1e-4


@pytest.mark.parametrize(
    "bad", [{"closures": 3.0}, {"closures": object()}, {"dt": "x"}, {"paths": None}]
)
def test_a_validation_is_refused_before_anything_is_computed(bad):
    with pytest.raises(InputError, match=next(iter(bad))):
        validate(DAT, impacts=1, **bad)


@pytest.mark.parametrize(
    ("tables", "word"),
    [
        (5, "axes"),
        ("abc", "axes"),
        ([{"sigma": [[1], [2]]}], "axes.sigma"),
        ([{"sigma": {"log": [1e-3, 1.0, 10**9]}}], "POINTS"),
        ([{"sigma": {"linear": [0, 1, 1000]}}, {"alpha": {"linear": [0, 1, 1000]}}], "axes"),
    ],
)
def test_axes_that_are_none_or_too_long(tables, word):
    with pytest.raises(InputError, match=word):
        read_axes(tables)


@pytest.mark.parametrize("jerk", [0.1, 1.0, 30.0])
def test_a_safe_time_is_safe_where_the_acceleration_grows_as_fast_as_it_may(jerk):
    rng = np.random.default_rng(3)
    for d, v, a in rng.normal(size=(2000, 3)) * 10.0 ** rng.uniform(-9.0, 1.0, (2000, 3)):
        most = abs(a) + 10.0 ** rng.uniform(-3.0, 3.0)
        t = safe_time(abs(d), v, a, most, jerk)
        turn = (most - a) / jerk  # from then on the acceleration is the largest
        s = np.linspace(0.0, t, 400)[1:-1]
        early = np.minimum(s, turn)
        late = np.maximum(s - turn, 0.0)
        speed = v + a * early + 0.5 * jerk * early**2
        gone = (
            v * early
            + 0.5 * a * early**2
            + jerk * early**3 / 6.0
            + speed * late
            + 0.5 * most * late**2
        )
        assert (gone <= abs(d) * (1.0 + 1e-9) + 1e-25).all(), (d, v, a, most)
