"""What fuzzing has found, kept as the smallest case of each."""

import json
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from settings import recorded

from rattle.closure import follow, mean_map
from rattle.closure.long_orbit import LongOrbit
from rattle.compare import validate
from rattle.compare.cli.main import main
from rattle.compare.report import manifest
from rattle.compare.study.design import read_axes
from rattle.compare.study.folder import load_study
from rattle.compare.study.store import Content, Store
from rattle.compare.validation.answer import answer
from rattle.compare.validation.errors import first_failure
from rattle.montecarlo import Record, simulate, simulate_to
from rattle.montecarlo.settings.plan import _noise_free_step
from rattle.montecarlo.settings.sampling import Sampling
from rattle.scene import DAT21, FileError, Gears, InputError, Scene, Start, Tolerance
from rattle.scene.files import read_text, read_toml
from rattle.scene.impact import next_impact, safe_time
from rattle.scene.moments import semidefinite
from rattle.scene.tangent import strike_frame

PLAIN = {"alpha": 1.5, "epsilon": 0.9, "beta1": 0.08, "beta2": 0.08, "gamma1": 0.06, "gamma2": 0.03, "mu": 0.6}
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
    ],
)
def test_the_range_of_a_field(field, inside, beyond):
    for value in inside:
        assert getattr(scene(**{field: value}), field) == value
    for value in beyond:
        with pytest.raises(InputError, match=f"^{field} = "):
            scene(**{field: value})


@pytest.mark.parametrize("field", ["y1", "tau"])
def test_the_range_of_a_start(field):
    for value in {"y1": (0.0, -1e6, 5e-324), "tau": (-1e12, 1e12, 5e-324)}[field]:
        assert getattr(Start(**{field: value}), field) == value
    for value in {"y1": (1.1e6, -1e7), "tau": (1.1e12,)}[field]:
        with pytest.raises(InputError, match=rf"^start\.{field} = "):
            Start(**{field: value})


def test_a_tolerance_whose_variance_would_vanish_is_refused():
    with pytest.raises(InputError, match="c1_max"):
        Tolerance(1e-300)


@pytest.mark.parametrize("value", [10**400, 10**5000, "x" * 10_000, np.array([0.5, 0.6]), [[]], 1j, {}], ids=type)
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
    for text in ("a = " + "9" * 5000, "a = " + "[" * 5000, None):
        with pytest.raises(FileError):
            read_toml(text)
    for path in ("\x00", 5, None):
        with pytest.raises(FileError, match="is no path"):
            read_text("scene file", path)


def test_equal_dampings_leave_the_second_stage_without_noise_and_realizable():
    """Its variance is the rounding error of a difference; a negative one is no breakdown."""
    for sigma in (0.001, 0.03, 0.3, 1.0):
        m = mean_map(scene(sigma=sigma), impacts=3)
        assert m.section["realizable"].to_list()[:1] == [True]
        rho = m.section[["rho1", "rho2"]].to_numpy()
        assert (np.isnan(rho) | (np.abs(rho) <= 1.0 + 1e-12)).all()


def test_rounding_is_taken_out_of_a_covariance_and_nothing_else():
    scale = np.array([1.0, 1.0])
    good = np.array([[1.0, 0.3], [0.3, 1.0]])
    assert np.array_equal(semidefinite(good, scale), good)
    assert np.array_equal(semidefinite(np.diag([1.0, 1e-15]), scale), np.diag([1.0, 1e-15]))
    assert np.array_equal(semidefinite(np.diag([1.0, 1e-16]), scale), np.diag([1.0, 0.0]))
    assert np.array_equal(semidefinite(np.array([[1.0, 1e-20], [0.0, 0.0]]), scale), np.diag([1.0, 0.0]))
    assert np.array_equal(semidefinite(np.diag([1.0, -1e-30]), np.array([1.0, 0.0])), np.diag([1.0, 0.0]))
    assert np.array_equal(semidefinite(np.diag([1.0, 1e-30]), np.array([1.0, 0.0])), np.diag([1.0, 1e-30]))
    corrected = semidefinite(np.array([[1.0, 1.0], [1.0, 1.0 - 1e-15]]), scale)
    assert np.linalg.eigvalsh(corrected)[0] >= -1e-16
    assert np.abs(corrected - 1.0).max() < 1e-15


def test_a_mean_flight_below_nothing_is_a_breakdown_of_the_series():
    m = mean_map(scene(alpha=1.0, sigma=1.0, beta1=0.03, gamma1=0.02, gap1=1.0, stages=1), impacts=3)
    assert m.section["flight"].min() < 0.0
    assert m.breakdown.stage == 0
    assert "mean time of flight" in m.breakdown.reason
    assert not m.section.loc[m.breakdown.impact, "realizable"]


def test_the_itinerary_ends_where_saltation_does():
    start = Start(1e9, -1.0, -2e-9, 0.9, -1e-7, mesh=1)
    m = mean_map(scene(gap1=1.0, gap2=1.0, start=start), impacts=3)
    assert m.stopped == "a mesh sticks after impact 0"
    assert set(m.itinerary[m.trace.found :]) <= {0}


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


def test_a_flight_that_is_damped_away_is_no_part_of_the_branching_closure():
    heavy = scene(alpha=0.0093, beta1=0.03, beta2=1e4, gamma1=0.0, gamma2=0.0, gap1=1e3, sigma=1.0)
    m = mean_map(heavy, impacts=2, closure="branching")
    assert "probability is discarded" in m.stopped
    assert m.section["tau"].isna().all()


def test_a_mesh_that_touches_at_rest_without_pull_stays_there():
    s = scene(
        alpha=0.36, epsilon=1.0, beta1=0.1, beta2=0.1, gamma1=0.0, gamma2=0.0, gap1=1.0, gap2=1.0,
        start=Start(0.0, 0.999, 1e-20, 1.0, 1e-20, mesh=2),
    )  # fmt: skip
    orbit = follow(s, 2)
    assert (orbit.found, orbit.before[1, 2], orbit.sticking) == (2, s.gap2, ())


def test_growth_without_restitution_is_minus_infinity_and_never_nan():
    s = LongOrbit(scene(epsilon=0.0, beta1=1000.0, beta2=1000.0, stages=1)).stretch(2)
    assert not np.isnan(s.growth).any()
    frame, growth = np.eye(4), np.zeros(4)
    frame[:, 1] = 0.0  # damped to nothing
    strike_frame(DAT.constants, 1, 0.1, 1.0, 0.5, frame, growth)
    assert growth[1] == -np.inf
    assert np.allclose(frame.T @ frame, np.eye(4))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("impacts", 10**9), ("paths", 10**30), ("workers", 10**6), ("horizon", 1e300),
        ("itineraries", 5), ("itineraries", {"mine": 5}),
    ],
)  # fmt: skip
def test_settings_without_end_are_refused(name, value):
    with pytest.raises(InputError, match=name):
        simulate(DAT, **recorded({"paths": 2, "impacts": 1} | {name: value}))


def test_an_accuracy_takes_no_fixed_times():
    with pytest.raises(InputError, match="times"):
        simulate_to(DAT, 0.1, record=Record(times=np.array([0.5, 0.6])))


@pytest.mark.parametrize("paths", [2, 3])
def test_a_control_of_few_paths_is_none(paths):
    """Three coefficients through three paths leave an error of 1e-10."""
    settings = {"paths": paths, "impacts": 1, "scheme": "exact-flight", "dt": 0.01}
    with_control, without = (simulate(DAT, **settings, sampling=Sampling(control=c)).section for c in (True, False))
    assert with_control["se_y1"].to_list() == pytest.approx(without["se_y1"].to_list(), rel=1e-12)
    assert with_control["se_y1"].loc[1] > 1e-4


@pytest.mark.parametrize("bad", [{"closures": 3.0}, {"closures": object()}, {"dt": "x"}, {"paths": None}])
def test_a_validation_is_refused_before_anything_is_computed(bad):
    with pytest.raises(InputError, match=next(iter(bad))):
        validate(DAT, impacts=1, **bad)


@pytest.mark.parametrize(
    ("tables", "word"),
    [
        (5, "axes"), ("abc", "axes"), ([{"sigma": [[1], [2]]}], "axes.sigma"),
        ([{"sigma": {"log": [1e-3, 1.0, 10**9]}}], "POINTS"),
        ([{"sigma": {"linear": [0, 1, 1000]}}, {"alpha": {"linear": [0, 1, 1000]}}], "axes"),
    ],
)  # fmt: skip
def test_axes_that_are_none_or_too_long(tables, word):
    with pytest.raises(InputError, match=word):
        read_axes(tables)


@pytest.mark.parametrize("at", [0, 5, 0.1, 0.3, 0.5, 0.9, -20, -8, -5, -1])
def test_a_cell_is_not_parsed_unless_it_is_what_was_written(tmp_path, monkeypatch, at):
    """On a damaged footer pyarrow may end the process in place of an error (a level histogram of another size)."""
    table = pd.DataFrame({"a": [1.0, 2.0]}, index=pd.RangeIndex(1, 3, name="impact"))
    store, cell = Store(tmp_path), SimpleNamespace(key="k", restore=lambda content: content)
    store.write(cell, Content(table, {"seconds": 1.0}))
    assert store.read(cell).table.equals(table)
    assert pd.read_parquet(store.path(cell)).equals(table)  # and by any other reader
    content = bytearray(store.path(cell).read_bytes())
    content[int(at * len(content)) if 0 < abs(at) < 1 else at] ^= 4
    store.path(cell).write_bytes(content)
    monkeypatch.setattr("rattle.compare.study.store.pq.ParquetFile", None)
    assert store.read(cell) is None
    assert "not what was written" in next(store.aside.glob("*.txt")).read_text()


def test_a_changed_manifest_is_refused(tmp_path):
    record = manifest.seal({"settings": {"paths": 64}, "table_sha256": "x"})
    assert manifest.is_whole(json.loads(json.dumps(record)))
    record["settings"]["paths"] = 65
    path = tmp_path / "manifest.json"
    path.write_text(json.dumps(record), encoding="utf-8")
    with pytest.raises(FileError, match="was changed"):
        manifest.read_settings(path)


@pytest.mark.parametrize("changed", [
    {"epsilon": 5e-324, "beta1": 0.03, "beta2": 0.03, "gamma1": 0.0, "gamma2": 0.0, "gap1": 0.2175899396752370},
    {"start": Start(-3.1975900465201548, -0.5, -5e-324, 0.5, -5e-324, mesh=1)},
])  # fmt: skip
def test_impacts_of_hardly_any_speed_leave_the_growth_below_infinity(changed):
    for start in (2, 3):
        assert (LongOrbit(scene(**changed), start).stretch(3).growth < np.inf).all()  # nor NaN; what is forgotten: -inf


def test_instants_in_flights_shorter_than_a_step_are_left_out():
    """Put on the grid of steps, they would lie beyond the impact that ends their flight."""
    s = Scene(
        alpha=0.8755034123303632, epsilon=0.001, beta1=0.0, gamma1=0.0, gamma2=1e-30, mu=0.6,
        gap1=0.003914641380533484, gap2=1000.0, sigma=1.4065959840509155,
    )  # fmt: skip
    found = validate(s, impacts=2, paths=64, scheme="exact-flight")
    assert found.table["paths_needed"].dtype == float


def test_the_control_has_its_last_impact_whatever_rounding_says():
    """Memory was read that nobody had written: flights of one step of 1e-8, at a phase of -5.4."""
    s = Scene(
        alpha=1e-16, epsilon=1.0 - 2.0**-53, beta1=0.17720538247223122, gamma1=1e-12, gap1=1.1883738780892684e-08,
        sigma=1e-30, stages=1, tolerance=Tolerance(1.1883738780892682e-28, 0.0),
        start=Start(-5.425158500910333, -1.1883738780892684e-08, 2.0),
    )  # fmt: skip
    run = simulate(s, paths=64, impacts=2, scheme="exact-flight", rng=0, sampling=Sampling(control=True))
    assert (run.plan.control.at_step < len(run.plan.control.carry)).all()


def test_paths_that_had_their_impacts_are_finished_though_the_linear_path_has_not():
    s = Scene(alpha=1e-30, epsilon=1.0, beta1=0.0, gamma1=0.007, gap1=1e6, sigma=1e6, stages=1)
    run = simulate(
        s, paths=8, impacts=2, scheme="exact-flight", dt=0.01, sampling=Sampling(horizon=20.0, control=True), rng=1
    )
    assert run.unfinished + run.section["paths"].loc[2] == 8


def test_a_scene_in_another_unit_is_not_refused_for_its_size():
    """The closures' own unit made wide second gaps inadmissible."""
    s = Scene(alpha=1e4, epsilon=0.03, beta1=1e-12, gamma1=0.03, gamma2=1e6, mu=4e-11, gap1=0.38, gap2=1e6, sigma=1.0)
    assert s.scaled(8.0).gap2 == 8e6
    section = mean_map(s, impacts=3, closure="branching").section
    assert (section["sd_x1"] == 0.0).all()
    assert section["skew_x1"].isna().all()


def test_a_covariance_that_is_lost_in_rounding_is_symmetric():
    """Taken from one triangle it was semidefinite, from the other its correlation was 1.18."""
    s = Scene(
        alpha=1e4, epsilon=0.03179008125016407, beta1=1.9195592817075356e-12, gamma1=0.03179008125016407, beta2=1e-30,
        gamma2=1e6, mu=4.340089884983708e-11, gap1=0.38067671133308817, gap2=1e6, sigma=1.0,
    )  # fmt: skip
    assert mean_map(s, impacts=3, order=2).section["realizable"].all()


def test_validate_asks_a_closure_only_for_times_that_it_tells_of():
    """The second-order mean of the last impact was later than the orbit that the closure follows."""
    start = Start(1e-300, -5e-10, 0.0, 0.5, 1e-16)
    s = Scene(
        alpha=56.23413251903491, epsilon=0.5, beta1=0.0547, gamma1=3.683252915887947e-05, gap1=1e-9, sigma=1.0,
        stages=1, start=start,
    )  # fmt: skip
    m = mean_map(s, impacts=2)
    assert m.trace.span[1] < m.trace.tau[m.trace.found]
    assert len(validate(s, impacts=2, paths=64, scheme="exact-flight").table)


SLOW_START = Start(-5e-324, 0.2511719249323631, 1.2058368112506402e-12, -0.25, 2.0, mesh=1)


def test_a_flight_that_begins_without_speed_and_acceleration_takes_few_steps():
    """Steps that held the acceleration to its largest grew to 1e5 for one impact, and `branching` to half a minute."""
    s = Scene(
        alpha=1.9211969040880859, epsilon=0.163, beta1=7e-7, gamma1=1e-30, gap1=0.2511719249323631, sigma=1.58,
        stages=1, start=SLOW_START,
    )  # fmt: skip
    c = s.constants
    steps, t = 0, 0.0
    x, y = c.wall1, -1.7e-11
    while t < 0.1 and steps < 1000:  # away from the wall
        f, jerk = -c.alpha * np.sin(t), c.alpha
        t += safe_time(c.wall1 - x, y, f, c.alpha, jerk)
        x, y = c.wall1 - 1.7e-11 * t - c.alpha * t**3 / 6.0, -1.7e-11 - c.alpha * t * t / 2.0
        steps += 1
    assert steps < 100
    t, mesh, side, *_ = next_impact(c, 0.0, c.wall1, -1.7e-11, 0.0, 0.0, 20.0)
    assert (mesh, side) == (1, -1)
    fine = np.cumsum(np.full(200_000, 1e-5))
    crossed = -1.7e-11 * fine + c.alpha * (np.sin(fine) - fine)
    assert t == pytest.approx(np.interp(2.0 * c.wall1, -crossed, fine), rel=1e-6)


@pytest.mark.parametrize("jerk", [0.1, 1.0, 30.0])
def test_a_safe_time_is_safe_where_the_acceleration_grows_as_fast_as_it_may(jerk):
    rng = np.random.default_rng(3)
    for d, v, a in rng.normal(size=(2000, 3)) * 10.0 ** rng.uniform(-9.0, 1.0, (2000, 3)):
        most = abs(a) + 10.0 ** rng.uniform(-3.0, 3.0)
        t = safe_time(abs(d), v, a, most, jerk)
        turn = (most - a) / jerk  # from then on the acceleration is the largest
        s = np.linspace(0.0, t, 400)[1:-1]
        early, late = np.minimum(s, turn), np.maximum(s - turn, 0.0)
        speed = v + a * early + 0.5 * jerk * early**2
        gone = v * early + 0.5 * a * early**2 + jerk * early**3 / 6.0 + speed * late + 0.5 * most * late**2
        assert (gone <= abs(d) * (1.0 + 1e-9) + 1e-25).all(), (d, v, a, most)


def test_instants_that_no_path_has_impacts_for_are_not_waited_for():
    """The orbit's flights last for 2e6 steps of paths that are shaken through a gap of 1e-9."""
    s = Scene(
        alpha=6.85e-7, epsilon=5e-324, beta1=1e-30, beta2=1e-20, gamma1=0.0, gamma2=1e-11, mu=1e-12, gap1=1e-9,
        gap2=0.5, sigma=1.0, tolerance=Tolerance(1e-11, 0.005, "normal", "path"),
        start=Start(4.458512519081175, 1e-9, 1e-30, -0.2475, 0.0, mesh=1),
    )  # fmt: skip
    found = validate(s, impacts=2, paths=64, scheme="exact-flight")
    assert set(found.table["kind"]) == {"section"}
    assert found.run.plan.control.at_step.size == 0


def test_a_path_without_noise_is_not_followed_by_the_steps_of_noise():
    """It sticks after one impact, and ten million steps were taken to see that no other comes."""
    s = Scene(
        alpha=4.8e-12, epsilon=0.0, beta1=0.0865, beta2=0.215, gamma1=1.0, gamma2=0.0, mu=1e-12, gap1=1.6531566127e-08,
        gap2=1.0, sigma=654.0, start=Start(1e-300, -1.6531566127e-08, -0.0729, -0.5, 0.0, mesh=1),
    )  # fmt: skip
    assert s.noise_free.sigma == 0.0
    assert _noise_free_step(s, 2, 1e-7) > 0.01


def test_coarse_paths_that_are_not_finished_leave_the_others_finished():
    s = Scene(alpha=0.0, epsilon=0.0029, beta1=0.0, gamma1=1e-16, gap1=0.5, sigma=0.0029, stages=1,
              start=Start(5.94, 0.5, 0.26698, 0.5, 2.0, mesh=1))  # fmt: skip
    run = simulate(
        s,
        paths=64,
        impacts=2,
        dt=0.002,
        scheme="euler-maruyama-located",
        sampling=Sampling(horizon=20.0),
        record=Record(step_bias=True),
    )
    assert run.unfinished + run.section["paths"].loc[2] == 64


def test_a_published_mean_of_zero_still_has_a_side():
    s = Scene(alpha=1.0, epsilon=0.65, beta1=1e-16, beta2=1e-16, gamma1=0.1, gamma2=2.2e-10, mu=7.7e-9, gap1=1.0,
              gap2=1.0, sigma=0.1, start=Start(-8.85, 1.0, 1.0, 0.0, 1.0, mesh=1))  # fmt: skip
    m = mean_map(s, impacts=3, closure="published")
    assert set(m.itinerary[: m.trace.found]) <= {-2, -1, 1, 2}


def test_a_corrected_variance_that_cancels_is_zero(recwarn):
    """Two wheels of one mass, no damping: the second stage has no spread of its own after an impact of the first."""
    s = Scene(alpha=3.6e-12, epsilon=0.7, beta1=1e-12, beta2=1e-12, gamma1=1e-30, gamma2=1e-30, mu=1.0 - 2.0**-53,
              gap2=0.7247324509712859, sigma=1e6)  # fmt: skip
    section = mean_map(s, impacts=3, closure="corrected", order=6).section
    assert (section["sd_x2"] >= 0.0).all()
    assert section["realizable"].all()
    assert not recwarn.list


@pytest.mark.parametrize(("closure", "order"), [("corrected", 6), ("published", 6), ("published", 4)])
def test_a_spread_whose_powers_are_no_floats_has_no_series(closure, order):
    """A first flight of 5e-25: the sixth power of the sd of x1 is 0, and the window's means were 0 / 0."""
    s = Scene(
        alpha=1e-16, epsilon=0.9, beta1=0.0, gamma1=1e-30, beta2=0.0, gamma2=0.0446, mu=9.7e-9, gap1=1.625, gap2=1e-9,
        sigma=4.46e-7, start=Start(0.0, 1.625, 1e6, -9.99999999999999e-10, -2.0, mesh=1),
    )  # fmt: skip
    m = mean_map(s, impacts=3, closure=closure, order=order)
    assert np.isfinite(m.section[["tau", "x1", "y1", "x2", "y2"]].iloc[: m.trace.found].to_numpy()).all()


def test_parts_that_differ_by_less_than_a_float_can_square_have_no_density(recwarn):
    gears = Gears(
        alpha=1.5, epsilon=5e-324, omega=425.5446430873588, inertia1=3094.203978801337, inertia2=176449.90308106618,
        radius1=41.0, radius2=83.48413022844521, backlash1=0.15471019894006688, backlash2=0.632455532033676,
        damping1=100.0, damping2=60122.40662962755, torque1=100.0, torque2=50.0,
    )  # fmt: skip
    m = mean_map(Scene.from_gears(gears, sigma=0.7735509947003343), impacts=2, closure="branching")
    for k in range(1, m.trace.found + 1):
        for q in ("tau", "flight", "x1", "y1", "x2", "y2"):
            density = m.density(k, q, m.section.loc[[k], q].to_numpy())
            assert density is None or np.isfinite(density).all()
    assert not recwarn.list


def test_validate_asks_for_no_instant_after_its_paths_are_given_up():
    """No path had its impacts; after minutes fixed times were refused that the user had not given."""
    s = Scene(alpha=0.0, epsilon=0.5, beta1=0.0, gamma1=1e-4, gap1=1.0, stages=1, start=Start(0.0, 1.0, 0.0153, mesh=1))
    found = validate(s, impacts=2, paths=2, scheme="exact-flight", closures=["saltation"])
    assert follow(s, 2).tau[1] > 100.0
    assert set(found.table["verdict"]) == {"not predicted"}


def test_a_skewness_of_what_hardly_varies_is_told_or_left_out(recwarn):
    """0 / 0, and 1e13, where the cube of an sd is no float: each impact takes eight digits of the speed."""
    s = Scene(
        alpha=3.3333333333333335e-12, epsilon=2.3141804585167484e-08, beta1=7.43137815095566,
        gamma1=5.811388217317941e-12, gap1=1.236979994325671e-09, beta2=0.6976810485237064,
        gamma2=2.147816449777596e-10, gap2=1.236979994325671e-09, mu=0.8736728783000797, sigma=1.0732068947548498e-07,
        start=Start(0.0, 1.2369799943195137e-09, 4.936831408669641e-10, -1.236979994325671e-09, -6.2622e-11, mesh=2),
    )  # fmt: skip
    table = mean_map(s, impacts=64, order=6).section
    for q in ("tau", "flight", "x1", "y1", "x2", "y2"):
        cube = table[f"sd_{q}"] ** 3
        assert table.loc[cube > 1e-289, f"skew_{q}"].notna().all()
        assert table.loc[cube < 1e-290, f"skew_{q}"].isna().all()
    assert ((table["sd_x2"] > 0.0) & (table["sd_x2"] ** 3 < 1e-290) & (table["sd_x2"] ** 3 > 0.0)).any()
    assert not recwarn.list


def test_a_growth_whose_square_is_no_float_is_told():
    """A nearly grazing impact under a strong force separates neighbours by 1e155."""
    frame, growth = np.eye(4), np.zeros(4)
    strike_frame(scene(alpha=1e6).constants, 1, 0.1, 1e-200, 0.5, frame, growth)
    assert np.isfinite(growth).all()
    assert 355.0 < growth.max() < 360.0
    assert np.linalg.norm(frame, axis=0) == pytest.approx(1.0)


def test_nothing_to_judge_is_a_table_without_rows():
    """No closure has an impact, no fixed time lies between two: the command ended in a KeyError."""
    still = scene(alpha=0.0, gamma1=0.0, beta1=0.0, stages=1, gap1=1e6, start=Start())
    found = validate(still, impacts=1, paths=2, scheme="exact-flight", closures=["saltation"])
    assert first_failure(found.correlation, "saltation") is None
    assert answer([found], None)


def test_an_accuracy_is_not_refused_for_a_step_that_nobody_has_given():
    """A gap of 1e-9 at a speed of 9e4: the provisional step was longer than the longest admissible one."""
    fast = scene(sigma=0.0, gap1=1e-9, start=Start(0.0, 1e-9, 9e4, 0.5, 2.0, mesh=1), stages=1)
    run = simulate_to(fast, 0.5, impacts=1, scheme="euler-maruyama-located")
    assert run.dt < 1e-12
    assert run.section["paths"].loc[1] == run.paths == 1


STILL = """
[study]
impacts = 1
closures = ["saltation"]
paths = 64
[scene]
alpha = 0.0
epsilon = 0.0
beta1 = 0.325
gamma1 = 1e-8
gap1 = 0.0572
stages = 1
tolerance = { c1_max = 1e-30 }
[scene.start]
tau = 0.0
x1 = 0.0
[[axes]]
sigma = [0.0, 2.9e-11]
"""


def test_a_study_in_which_no_path_has_an_impact_has_a_page(tmp_path, recwarn):
    """Means of no batches, an interval of a share of none, and a logarithmic axis for spreads that are not there."""
    (tmp_path / "study.toml").write_text(STILL, encoding="utf-8")
    done = CliRunner().invoke(main, ["study", str(tmp_path / "study.toml"), "--workers", "1"], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    tables = load_study(tmp_path / "study")
    assert (tables.sections["paths"] == 0).all()
    assert set(tables.errors["verdict"]) == {"not predicted"}
    assert not recwarn.list


def test_a_report_of_a_speed_that_varies_by_less_than_a_float(tmp_path):
    start = Start(8.27597051186902, 5.211304781746529, 965.9243053385085, 3.2010607983637507, 0.9828226909473343, 2)
    file = tmp_path / "fast.toml"
    file.write_text(
        Scene(
            alpha=9.507045049299355, epsilon=0.9999999999999999, beta1=0.0019562748254586862, gamma1=0.6462975974376286,
            gap1=5.211304781746529, beta2=0.09335714439263738, gamma2=0.0, gap2=3.2010607983637507,
            mu=1.3375156798484208e-15, start=start,
        ).to_toml()
    )  # fmt: skip
    words = ["validate", file, "--impacts", 1, "--paths", 2, "--no-validity", "--out", tmp_path / "report"]
    found = CliRunner().invoke(main, [str(word) for word in words])
    assert found.exit_code == 0, found.output + repr(found.exception)
