from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from places import ORDINARY_PAIR
from refusals import refusal
from scenes import FOUR, PAPER_SIGMA, dat21
from scipy import signal

from rattle import Scene, Start, Tolerance, Wheel
from rattle.compare.chaos import sweep as sweeps
from rattle.compare.chaos.exponents import (
    crossings,
    drift_exponents,
    finite_size,
    fit,
    lyapunov,
    ratio_mean,
    sqrt_law,
)
from rattle.compare.chaos.measure import mean_maps
from rattle.compare.chaos.record import Regime, noisy_record
from rattle.compare.chaos.section import NOISY, ORBIT_SECTION, sections
from rattle.compare.chaos.spectrum import (
    FALSE_LINE,
    SEQUENCE,
    VELOCITY_IN_TIME,
    spectra,
    spectra_tables,
    welch,
)
from rattle.compare.chaos.sweep import FieldSweep, paper_noise, vary
from rattle.scene import Restitution

LOUD_DAT21 = dat21(PAPER_SIGMA)


def at(alpha, **changes):
    return replace(LOUD_DAT21, alpha=alpha, start=None, **changes)


FALLING = Scene(
    alpha=1.5,
    epsilon=0.9,
    sigma=0.5,
    wheels=[Wheel(beta=0.1, gamma=0.1, restitution=Restitution(speed=1.0))],
)
"""Its restitution falls with the speed: without the slope of that the sum is off by 0.2."""
OF_PAPER = [
    paper_noise(at(alpha, stages=stages)) for alpha, stages in ((1.5, 1), (0.3, 2), (2.5, 2))
]
ADDED = [
    *product((lyapunov, drift_exponents), OF_PAPER),
    (lyapunov, FALLING),
    (drift_exponents, FOUR.with_sigma(0.5)),
]


@pytest.mark.parametrize(("measure", "scene"), ADDED)
def test_exponents_add_up_exactly_of_orbit_and_noisy_path(measure, scene):
    """The determinant of an impact is ``epsilon(w)`` times the slope of ``epsilon(w) w``."""
    found = measure(scene, impacts=10_000)
    assert found.value.size == 2 * scene.stages
    assert abs(found.sum_error) < 1e-10
    assert (np.diff(found.value) <= 0.0).all()


def test_an_interval_from_batches_covers_correlated_records_and_a_naive_one_does_not():
    """AR(1) with coefficient 0.9 about 1: 400 records; 3.3 standard errors of a share of 0.95 are
    0.036."""
    rng = np.random.default_rng(3)
    missed = 0
    naive = 0
    for _ in range(400):
        y = 1.0 + signal.lfilter([1.0], [1.0, -0.9], rng.normal(size=3200 + 100))[100:]
        m = ratio_mean(y, np.ones(y.size))
        missed += abs(m.value - 1.0) > m.half
        naive += abs(y.mean() - 1.0) > 1.96 * y.std() / y.size**0.5
    assert missed / 400 < 0.05 + 0.036
    assert missed / 400 > 0.005
    assert naive / 400 > 0.4


def test_a_record_is_lengthened_until_its_interval_is_narrow_enough():
    assert (
        lyapunov(LOUD_DAT21, impacts=10_000).width > 0.01 >= lyapunov(LOUD_DAT21, width=0.01).width
    )
    with refusal("at least 8192"):
        lyapunov(LOUD_DAT21, impacts=100)
    with refusal("epsilon"):
        lyapunov(replace(LOUD_DAT21, epsilon=0.0))


def test_an_orbit_that_sticks_often_goes_on_and_has_no_section():
    scene = at(0.05)
    found = lyapunov(scene)
    assert found.regime.kind == "sticks often"
    assert found.regime.closed == pytest.approx(0.006, abs=0.0006)
    reason = "it comes loose after each, and a mesh is closed 0.56 % of the time"
    assert reason in found.regime.reason
    assert np.isnan(found.value).all()
    missing = {}
    assert list(sections(scene, points=2000, missing=missing)) == ["noisy system"]
    assert missing == {"the Poincaré section of the orbit": "the orbit sticks often"}


ORDINARY_GEARS = Scene.load(ORDINARY_PAIR).gears
NOISY_PAIR = Scene.from_gears(ORDINARY_GEARS, sigma=0.03, stages=1)
RANDOM = replace(LOUD_DAT21, sigma=0.1, tolerance=Tolerance(0.05, 0.05, distribution="uniform"))
# undamped, the drag holds mesh 1 closed
PRESSED_STAGE = Scene(alpha=0.5, epsilon=0.5, beta1=0.0, gamma1=1.0, stages=1)
SILENT = replace(PRESSED_STAGE, alpha=0.1, beta1=1.0, gamma1=0.0, gap1=5.0, start=Start(y1=0.1))


@pytest.mark.parametrize(
    ("measure", "scene", "kind", "said"),
    [
        (drift_exponents, NOISY_PAIR, "sticks often", "sticks 31 % of the time"),
        (drift_exponents, RANDOM, "not followed", "random gaps"),
        (lyapunov, PRESSED_STAGE, "sticks for good", "impacts end"),
        (lyapunov, SILENT, "silent", "ends"),
    ],
)
def test_a_motion_without_exponents_says_why(measure, scene, kind, said):
    found = measure(scene, width=0.1)
    assert np.isnan(found.value).all()
    assert found.regime.kind == kind
    assert said in found.regime.reason


def test_random_gaps_leave_out_the_section_of_the_noisy_system():
    missing = {}
    assert NOISY not in sections(RANDOM, points=200, missing=missing)
    assert "random gaps" in missing["the Poincaré section of the noisy system"]


def test_exponents_whose_sum_is_off_are_not_reported():
    """Slow impacts lose the growth of neighbours in rounding; the exact sum of the exponents shows
    it."""
    gears = replace(ORDINARY_GEARS, inertia2=1500.0, radius2=50.0)
    scene = Scene.from_gears(gears, sigma=0.2)
    record = [
        [s.growth.sum(), s.flight.sum(), s.flight.size]
        for s, _ in noisy_record(scene, 0, Regime(), steps=2000)
    ]
    growth, time, impacts = np.sum(record, axis=0)
    assert not abs(growth - impacts * 2.0 * np.log(gears.epsilon)) / time < 0.01
    found = drift_exponents(scene, width=0.1)
    assert np.isnan(found.value).all()
    assert found.regime.kind == "sticks often"


def test_sweeps_do_not_depend_on_workers_and_mark_what_sticks():
    one, two = (
        FieldSweep(vary(LOUD_DAT21, "alpha", (0.05, 0.4, 1.5), paper_noise), workers=n).exponents(
            0.1
        )
        for n in (1, 2)
    )
    assert one.equals(two)
    orbit = one[one["of"] == "orbit"]
    assert orbit["regime"].tolist()[:2] == ["sticks often", "runs"]
    assert orbit["regime"].tolist()[2] in ("runs", "sticks at times")  # chaotic: rounding decides
    assert crossings(one)[["low", "high", "to"]].to_numpy().tolist() == [[0.4, 1.5, 1]]
    assert (one["sum_error"].abs().dropna() < 1e-10).all()


def test_an_interrupted_sweep_computes_what_is_missing(tmp_path, monkeypatch):
    """And holds every point of each value, where the orbit does not stick often."""
    scenes = vary(replace(LOUD_DAT21, epsilon=0.7), "alpha", (0.05, 0.4), paper_noise)
    sweep = FieldSweep(scenes, folder=tmp_path)
    whole = sweep.bifurcation(500)
    (sticks, goes_on), noisy = (whole.cells[side].sum(axis=1) for side in (ORBIT_SECTION, NOISY))
    assert (sticks, whole.reasons[ORBIT_SECTION]) == (0, ["sticks often", ""])
    assert all(495 < count <= 500 for count in (goes_on, *noisy))
    begun = []
    next((tmp_path / "cells").glob("*.parquet")).unlink()
    own = sweeps.VelocitiesAt.evaluate
    monkeypatch.setattr(
        sweeps.VelocitiesAt, "evaluate", lambda cell, blocks=None: begun.append(cell) or own(cell)
    )
    assert sweep.bifurcation(500).table.equals(whole.table)
    assert len(begun) == 1


def test_mean_maps_report_where_they_break_down():
    maps = mean_maps(LOUD_DAT21, lyapunov(LOUD_DAT21, impacts=10_000)).set_index("closure")
    assert maps["not_realizable"]["published"] == 2
    assert np.isnan(maps["largest"]["published"])
    assert maps["ends"]["published"] < maps["followed"]["published"]
    assert (maps["exponents"][["corrected", "saltation"]] == "the orbit's").all()
    assert (maps["too_wide"][["corrected", "saltation"]] < 20).all()


@pytest.mark.slow
@pytest.mark.parametrize("scene", [LOUD_DAT21, FALLING])
def test_the_square_root_law_has_its_exponent_and_its_prefactor(scene):
    """Seven ratios whose 95 % intervals are widened to 99.9 % together: 1.96 -> 3.8 standard
    errors."""
    law = sqrt_law(scene, impacts=3000, seed=2)
    assert law.low < 0.5 < law.high
    assert law.high - law.low < 0.02
    half = 0.5 * (law.table["high"] - law.table["low"])
    assert (np.abs(law.table["ratio"] - 1.0) < 3.8 / 1.96 * half).all()
    assert (half < 0.06).all()  # so that 10 % more noise, 21 % in this ratio, would be seen


def test_another_exponent_is_rejected():
    """Negative control: the same noise with delta^0.55."""
    deltas = np.geomspace(1e-6, 1e-3, 7)
    z = np.random.default_rng(4).normal(size=(3000, 7))
    _, low, high = fit(deltas, deltas**0.55 * z)
    assert not low < 0.5 < high


def test_the_finite_size_exponent_is_lyapunovs_without_noise_and_has_no_limit_with_noise():
    orbit = lyapunov(LOUD_DAT21, impacts=100_000)
    table = finite_size(LOUD_DAT21.with_sigma(0.0), deltas=(1e-7, 1e-5), events=3000)
    for _, row in table.iterrows():
        half = np.hypot(0.5 * (row["high"] - row["low"]), orbit.half[0])
        assert abs(row["exponent"] - orbit.value[0]) < 2.0 * half
        assert half < 0.1 * orbit.value[0]
    noisy = finite_size(LOUD_DAT21, deltas=(1e-7, 1e-5, 1e-3), events=1000)
    assert (noisy["low"].to_numpy()[:-1] > noisy["high"].to_numpy()[1:]).all()
    assert noisy["low"][0] > 10.0 * orbit.value[0]


def test_the_band_covers_white_noise():
    """60 spectra of 127 bins; neighbours are correlated, so 4 standard errors of half as many bins
    are 0.015."""
    rng = np.random.default_rng(5)
    inside = 0
    bins = 0
    for _ in range(60):
        low, high = (s := welch([rng.normal(size=20_000)], 256, 1.0)).band
        inside += int(((low < 2.0) & (high > 2.0)).sum())
        bins += s.power.size
    assert inside / bins == pytest.approx(0.95, abs=0.015)
    # a band that is too narrow does not
    assert ((s.power / 1.02 < 2.0) & (s.power / 0.98 > 2.0)).mean() < 0.8


@pytest.mark.parametrize("colour", [0.0, 0.6])
def test_noise_has_no_lines(colour):
    """150 spectra, white and red, whose slope is smooth over 65 bins: 1.5 alarms at most are
    expected, more than 6 once in 1000."""
    rng = np.random.default_rng(7)
    alarms = 0
    for _ in range(150):
        x = signal.lfilter([1.0], [1.0, -colour], rng.normal(size=60_000))
        alarms += len(welch([x], 2048, 1.0).lines) > 0
    assert alarms <= 4 * 150 * FALSE_LINE


def test_a_line_added_to_noise_is_found_with_its_frequency_and_power():
    rng = np.random.default_rng(8)
    n = np.arange(200_000)
    x = rng.normal(size=n.size) + 0.5 * np.sin(2.0 * np.pi * 0.1234 * n)
    lines = welch([x], 1024, 1.0).lines
    assert len(lines) == 1
    assert lines["frequency"][0] == pytest.approx(0.1234, abs=2e-4)
    assert lines["share"][0] == pytest.approx(0.125 / 1.125, rel=0.05)
    assert lines["narrow"][0]


def test_a_wide_band_added_to_noise_is_not_taken_for_narrow():
    rng = np.random.default_rng(9)
    b, a = signal.iirpeak(0.2, 30.0)
    x = rng.normal(size=200_000) + 5.0 * signal.lfilter(b, a, rng.normal(size=200_000))
    lines = welch([x], 1024, 1.0).lines
    assert len(lines) >= 1
    assert not lines["narrow"][0]


def test_spectra_integrate_to_the_variance_and_shares_add_up():
    found = spectra(LOUD_DAT21, impacts=40_000)
    assert len(found) == 8
    _, _, summary = spectra_tables(found)
    assert (summary["line_share"] + summary["floor_share"]).to_numpy() == pytest.approx(1.0)
    drive = found[ORBIT_SECTION, VELOCITY_IN_TIME, "y1"].lines
    assert drive["frequency"][0] == pytest.approx(1.0, abs=1e-3)  # the excitation itself
    s = found[NOISY, SEQUENCE, "y1"]
    assert s.power.sum() * (s.frequency[1] - s.frequency[0]) == pytest.approx(2.8, rel=0.1)


def test_sections_hold_every_point_and_do_not_depend_on_workers():
    one, two = (sections(LOUD_DAT21, points=6001, workers=n) for n in (1, 2))
    assert list(one) == [ORBIT_SECTION, "mean map (corrected)", NOISY]
    for side, s in one.items():
        held = s.counts.sum(axis=(1, 2))
        assert ((held > 0.999 * s.points) & (held <= s.points)).all()
        assert (s.counts == two[side].counts).all()
    assert one[ORBIT_SECTION].points == one[NOISY].points == 6001
