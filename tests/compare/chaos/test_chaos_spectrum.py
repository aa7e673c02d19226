import numpy as np
import pytest
from scipy import signal

from rattle.compare.chaos.section import NOISY, ORBIT, bifurcation, paper_noise, sections, vary
from rattle.compare.chaos.spectrum import FALSE_ALARM, SEQUENCE, TIME, spectra, spectra_tables, welch
from rattle.scene import DAT21, Scene

DAT = Scene.from_gears(DAT21, sigma=1.5**0.5)


def test_the_band_covers_white_noise():
    """60 spectra of 127 bins; neighbours are correlated, so 4 standard errors of half as many bins are 0.015."""
    rng, inside, bins = np.random.default_rng(5), 0, 0
    for _ in range(60):
        low, high = (s := welch([rng.normal(size=20_000)], 256, 1.0)).band
        inside += int(((low < 2.0) & (high > 2.0)).sum())
        bins += s.power.size
    assert inside / bins == pytest.approx(0.95, abs=0.015)
    narrow = s.power * s.dof / 2.0 / np.array([[0.5 * s.dof * 1.02], [0.5 * s.dof * 0.98]])
    assert ((narrow[0] < 2.0) & (narrow[1] > 2.0)).mean() < 0.8  # a band that is too narrow does not


@pytest.mark.parametrize("colour", [0.0, 0.6])
def test_noise_has_no_lines(colour):
    """300 spectra, white and red, whose slope is smooth over 65 bins: 3 alarms at most are expected, 9 once in 1000."""
    rng = np.random.default_rng(7)
    alarms = 0
    for _ in range(300):
        x = signal.lfilter([1.0], [1.0, -colour], rng.normal(size=60_000))
        alarms += len(welch([x], 2048, 1.0).lines) > 0
    assert alarms <= 3 * 300 * FALSE_ALARM


def test_a_line_added_to_noise_is_found_with_its_frequency_and_power():
    rng, n = np.random.default_rng(8), np.arange(200_000)
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
    found = spectra(DAT, impacts=40_000)
    assert len(found) == 8
    _, _, summary = spectra_tables(found)
    assert (summary["line_share"] + summary["floor_share"]).to_numpy() == pytest.approx(1.0)
    drive = found[ORBIT, TIME, "y1"].lines
    assert drive["frequency"][0] == pytest.approx(1.0, abs=1e-3)  # the excitation itself
    s = found[NOISY, SEQUENCE, "y1"]
    assert s.power.sum() * (s.frequency[1] - s.frequency[0]) == pytest.approx(2.8, rel=0.1)


def test_sections_hold_every_point_and_do_not_depend_on_workers():
    one, two = (sections(DAT, points=6001, workers=n) for n in (1, 2))
    assert list(one) == [ORBIT, "mean map (corrected)", NOISY]
    for side, s in one.items():
        assert (s.counts.sum(axis=(1, 2)) > 0.999 * s.points).all()
        assert (s.counts.sum(axis=(1, 2)) <= s.points).all()
        assert (s.counts == two[side].counts).all()
        assert s.table["count"].sum() == s.counts.sum()
    assert one[ORBIT].points == one[NOISY].points == 6001


def test_bifurcations_hold_every_point_of_any_field():
    b = bifurcation(vary(DAT, "epsilon", (0.5, 0.7, 0.9)), "epsilon", points=3000)
    for side in (ORBIT, NOISY):
        assert ((b.cells[side].sum(axis=1) > 2980) & (b.cells[side].sum(axis=1) <= 3000)).all()
    sticking = bifurcation(vary(DAT, "alpha", (0.05, 0.4), paper_noise), points=1000)
    assert sticking.cells[ORBIT].sum(axis=1).tolist()[0] == 0
    assert sticking.reasons[ORBIT] == ["sticks often", ""]
