from dataclasses import replace

import numpy as np
import pytest
from places import ORDINARY_PAIR
from refusals import refusal
from scenes import FOUR, PAPER_SIGMA, dat21
from scipy import signal

from rattle import Scene, Start, Tolerance, Wheel
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


@pytest.mark.parametrize(
    ("measure", "scene"),
    [
        (drift_exponents, LOUD_DAT21),
        (lyapunov, FALLING),
        (drift_exponents, FOUR.with_sigma(0.5)),
    ],
)
def test_exponents_add_up_exactly_of_orbit_and_noisy_path(measure, scene):
    """The determinant of an impact is ``epsilon(w)`` times the slope of ``epsilon(w) w``."""
    found = measure(scene, impacts=10_000)
    assert found.value.size == 2 * scene.stages
    assert abs(found.sum_error) < 1e-10
    assert (np.diff(found.value) <= 0.0).all()


def test_an_interval_from_batches_covers_correlated_records_and_a_naive_one_does_not():
    """AR(1) with coefficient 0.9 about 1: 400 records; 3.3 standard errors of a share of 0.95 are
    0.036."""
    white = np.random.default_rng(3).normal(size=(400, 3200 + 100))
    records = 1.0 + signal.lfilter([1.0], [1.0, -0.9], white)[:, 100:]
    means = [ratio_mean(y, np.ones(y.size)) for y in records]
    missed = np.mean([abs(m.value - 1.0) > m.half for m in means])
    naive = [abs(y.mean() - 1.0) > 1.96 * y.std() / y.size**0.5 for y in records]
    assert 0.005 < missed < 0.05 + 0.036
    assert np.mean(naive) > 0.4


def test_a_record_is_lengthened_until_its_interval_is_narrow_enough():
    assert (
        lyapunov(LOUD_DAT21, impacts=10_000).width > 0.01 >= lyapunov(LOUD_DAT21, width=0.01).width
    )
    with refusal("at least 8192"):
        lyapunov(LOUD_DAT21, impacts=100)
    with refusal("epsilon"):
        lyapunov(replace(LOUD_DAT21, epsilon=0.0))


def test_what_sticks_often_and_random_gaps_have_no_section():
    missing = {}
    assert list(sections(at(0.05), points=2000, missing=missing)) == [NOISY]
    assert missing == {"the Poincaré section of the orbit": "the orbit sticks often"}
    assert NOISY not in sections(RANDOM, points=200, missing=missing)
    assert "random gaps" in missing["the Poincaré section of the noisy system"]


RANDOM = replace(LOUD_DAT21, sigma=0.1, tolerance=Tolerance(0.05, 0.05, distribution="uniform"))
# undamped, the drag holds mesh 1 closed
PRESSED_STAGE = Scene(alpha=0.5, epsilon=0.5, beta1=0.0, gamma1=1.0, stages=1)


@pytest.mark.parametrize(
    ("measure", "scene", "kind", "said"),
    [
        (drift_exponents, Scene.load(ORDINARY_PAIR), "sticks often", "sticks 31 % of the time"),
        (
            lyapunov,
            at(0.05),
            "sticks often",
            "it comes loose after each, and a mesh is closed 0.56 % of the time",
        ),
        (drift_exponents, RANDOM, "not followed", "random gaps"),
        (lyapunov, PRESSED_STAGE, "sticks for good", "impacts end"),
        (
            lyapunov,
            Scene(
                alpha=0.1,
                epsilon=0.5,
                beta1=1.0,
                gamma1=0.0,
                gap1=5.0,
                stages=1,
                start=Start(y1=0.1),
            ),
            "silent",
            "ends",
        ),
    ],
)
def test_a_motion_without_exponents_says_why(measure, scene, kind, said):
    found = measure(scene, width=0.1)
    assert np.isnan(found.value).all()
    assert found.regime.kind == kind
    assert said in found.regime.reason


def test_exponents_whose_sum_is_off_are_not_reported():
    """Slow impacts lose the growth of neighbours in rounding; the exact sum of the exponents shows
    it."""
    gears = replace(Scene.load(ORDINARY_PAIR).gears, inertia2=1500.0, radius2=50.0)
    scene = Scene.from_gears(gears, sigma=0.2)
    record = [
        [s.growth.sum() - s.flight.size * 2.0 * np.log(gears.epsilon), s.flight.sum()]
        for s, _ in noisy_record(scene, 0, Regime(), steps=2000)
    ]
    error, time = np.sum(record, axis=0)
    assert not abs(error) / time < 0.01
    assert np.isnan(drift_exponents(scene, width=0.1).value).all()


def test_sweeps_do_not_depend_on_workers_and_mark_what_sticks():
    scenes = vary(LOUD_DAT21, "alpha", (0.05, 0.4, 1.5), paper_noise)
    one, two = (FieldSweep(scenes, workers=n).exponents(0.1) for n in (1, 2))
    assert one.equals(two)
    orbit = one.query("of == 'orbit'")
    assert orbit["regime"].tolist()[:2] == ["sticks often", "runs"]
    assert orbit["regime"].tolist()[2] in ("runs", "sticks at times")  # chaotic: rounding decides
    assert crossings(one)[["low", "high", "to"]].to_numpy().tolist() == [[0.4, 1.5, 1]]
    assert (one["sum_error"].abs().dropna() < 1e-10).all()


def test_an_interrupted_sweep_computes_what_is_missing(tmp_path):
    """And holds every point of each value, where the orbit does not stick often."""
    sweep = FieldSweep(
        vary(replace(LOUD_DAT21, epsilon=0.7), "alpha", (0.05, 0.4), paper_noise), folder=tmp_path
    )
    whole = sweep.bifurcation(500)
    (sticks, goes_on), noisy = (whole.cells[side].sum(axis=1) for side in (ORBIT_SECTION, NOISY))
    assert (sticks, whole.reasons[ORBIT_SECTION]) == (0, ["sticks often", ""])
    assert all(495 < count <= 500 for count in (goes_on, *noisy))
    lost, *stored = (tmp_path / "cells").glob("*.parquet")
    lost.unlink()
    written = [cell.stat().st_mtime_ns for cell in stored]
    assert sweep.bifurcation(500).table.equals(whole.table)
    assert lost.exists()
    assert [cell.stat().st_mtime_ns for cell in stored] == written


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
    _, low, _ = fit(deltas, deltas**0.55 * np.random.default_rng(4).normal(size=(3000, 7)))
    assert low > 0.5


def test_the_finite_size_exponent_is_lyapunovs_without_noise_and_has_no_limit_with_noise():
    orbit = lyapunov(LOUD_DAT21, impacts=100_000)
    largest = orbit.value[0]
    table = finite_size(LOUD_DAT21.with_sigma(0.0), deltas=(1e-7, 1e-5), events=3000)
    half = np.hypot(0.5 * (table["high"] - table["low"]), orbit.half[0])
    assert (abs(table["exponent"] - largest) < 2.0 * half).all()
    assert (half < 0.1 * largest).all()
    noisy = finite_size(LOUD_DAT21, deltas=(1e-7, 1e-5, 1e-3), events=1000)
    assert (noisy["low"] > noisy["high"].shift(-1)).tolist() == [True, True, False]
    assert noisy["low"][0] > 10.0 * largest


def test_the_band_covers_white_noise():
    """60 spectra of 127 bins; neighbours are correlated, so 4 standard errors of half as many bins
    are 0.015."""
    found = [welch([x], 256, 1.0) for x in np.random.default_rng(5).normal(size=(60, 20_000))]
    low, high = np.stack([s.band for s in found], axis=1)
    assert ((low < 2.0) & (high > 2.0)).mean() == pytest.approx(0.95, abs=0.015)
    # a band that is too narrow does not
    power = np.stack([s.power for s in found])
    assert ((power / 1.02 < 2.0) & (power / 0.98 > 2.0)).mean() < 0.8


@pytest.mark.parametrize("colour", [0.0, 0.6])
def test_noise_has_no_lines(colour):
    """150 spectra, white and red, whose slope is smooth over 65 bins: 1.5 alarms at most are
    expected, more than 6 once in 1000."""
    white = np.random.default_rng(7).normal(size=(150, 60_000))
    spectra = [welch([x], 2048, 1.0) for x in signal.lfilter([1.0], [1.0, -colour], white)]
    assert sum(len(s.lines) > 0 for s in spectra) <= 4 * 150 * FALSE_LINE


def test_a_line_added_to_noise_is_found_with_its_frequency_and_power():
    x = np.random.default_rng(8).normal(size=200_000) + (
        0.5 * np.sin(2.0 * np.pi * 0.1234 * np.arange(200_000))
    )
    (line,) = welch([x], 1024, 1.0).lines.to_dict("records")
    assert line["frequency"] == pytest.approx(0.1234, abs=2e-4)
    assert line["share"] == pytest.approx(0.125 / 1.125, rel=0.05)
    assert line["narrow"]


def test_a_wide_band_added_to_noise_is_not_taken_for_narrow():
    white, band = np.random.default_rng(9).normal(size=(2, 200_000))
    x = white + 5.0 * signal.lfilter(*signal.iirpeak(0.2, 30.0), band)
    assert not welch([x], 1024, 1.0).lines["narrow"][0]


def test_spectra_integrate_to_the_variance_and_shares_add_up():
    found = spectra(LOUD_DAT21, impacts=40_000)
    _, _, summary = spectra_tables(found)
    assert len(summary) == 8
    assert (summary["line_share"] + summary["floor_share"]).to_numpy() == pytest.approx(1.0)
    # the excitation itself
    drive = found[ORBIT_SECTION, VELOCITY_IN_TIME, "y1"].lines
    assert drive["frequency"][0] == pytest.approx(1.0, abs=1e-3)
    s = found[NOISY, SEQUENCE, "y1"]
    assert s.power.sum() * (s.frequency[1] - s.frequency[0]) == pytest.approx(2.8, rel=0.1)


def test_sections_hold_every_point_and_do_not_depend_on_workers():
    one, two = (sections(LOUD_DAT21, points=6001, workers=n) for n in (1, 2))
    assert list(one) == [ORBIT_SECTION, "mean map (corrected)", NOISY]
    assert one[ORBIT_SECTION].points == one[NOISY].points == 6001
    for side, s in one.items():
        held = s.counts.sum(axis=(1, 2))
        assert held.min() > 0.999 * s.points >= 0.999 * held.max()
        assert (s.counts == two[side].counts).all()
