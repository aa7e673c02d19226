import numpy as np
import pytest

from rattle.compare.chaos.exponents import finite_size, fit, lyapunov, ratio_mean, sqrt_law
from rattle.scene import DAT21, InputError, Scene

DAT = Scene.from_gears(DAT21, sigma=1.5**0.5)


@pytest.mark.slow
def test_the_square_root_law_has_its_exponent_and_its_prefactor():
    """Seven ratios whose 95 % intervals are widened to 99.9 % together: 1.96 -> 3.8 standard errors."""
    law = sqrt_law(DAT, impacts=3000, seed=2)
    assert law.low < 0.5 < law.high
    assert law.high - law.low < 0.02
    half = 0.5 * (law.table["high"] - law.table["low"])
    assert (np.abs(law.table["ratio"] - 1.0) < 3.8 / 1.96 * half).all()
    assert (half < 0.06).all()  # so that 10 % more noise, 21 % in this ratio, would be seen


def test_another_exponent_is_rejected():
    """Negative control: the same noise with delta^0.55, and a linear law."""
    deltas = np.geomspace(1e-6, 1e-3, 7)
    z = np.random.default_rng(4).normal(size=(3000, 7))
    for power in (0.55, 1.0):
        _, low, high = fit(deltas, deltas**power * z)
        assert not low < 0.5 < high


def test_noise_too_weak_for_the_law_is_refused():
    with pytest.raises(InputError, match="too weak"):
        sqrt_law(DAT.with_sigma(0.01))


def test_the_finite_size_exponent_of_a_known_map():
    """Fully developed logistic map: ln 2, whatever the scale; a shift of 5 % is outside the interval."""
    rng, durations, growths = np.random.default_rng(10), [], []
    a = rng.uniform()
    for _ in range(4000):  # one orbit, its partner put back beside it again and again
        b, steps = a + 1e-9, 0
        while abs(a - b) < 1e-6:
            a, b, steps = 4.0 * a * (1.0 - a), 4.0 * b * (1.0 - b), steps + 1
        durations.append(steps)
        growths.append(np.log(abs(a - b) / 1e-9))
    m = ratio_mean(np.array(growths), np.array(durations, dtype=float))
    assert m.value == pytest.approx(np.log(2.0), abs=3.0 * m.half)
    assert m.half < 0.05 * np.log(2.0)


def test_without_noise_the_finite_size_exponent_is_the_lyapunov_exponent_and_with_noise_it_has_no_limit():
    orbit = lyapunov(DAT, impacts=100_000)
    table = finite_size(DAT.with_sigma(0.0), deltas=(1e-7, 1e-5), events=3000)
    for _, row in table.iterrows():
        half = np.hypot(0.5 * (row["high"] - row["low"]), orbit.half[0])
        assert abs(row["exponent"] - orbit.value[0]) < 2.0 * half
        assert half < 0.1 * orbit.value[0]
    noisy = finite_size(DAT, deltas=(1e-7, 1e-5, 1e-3), events=1000)
    assert (np.diff(noisy["exponent"]) < 0.0).all()
    assert (noisy["low"].to_numpy()[:-1] > noisy["high"].to_numpy()[1:]).all()
    assert noisy["low"][0] > 10.0 * orbit.value[0]
    assert noisy.equals(finite_size(DAT, deltas=(1e-7, 1e-5, 1e-3), events=1000, workers=1))
