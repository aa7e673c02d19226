"""Two-point increments: moments of a normal up to the third, the same weak limit, one bit a step."""

import numpy as np
import pytest
from mc_checks import agrees, dat21
from mc_checks import stepped as simulate

from rattle.montecarlo.noise.philox import Word, fill_signs, fill_words, key_of
from rattle.montecarlo.settings import Sampling


def signs(paths, steps):
    key, numbers = key_of(np.random.SeedSequence(3)), np.arange(paths, dtype=np.uint64)
    bits, z, found = np.zeros(paths, np.uint64), np.zeros(paths), []
    for n in range(steps):
        if n % 64 == 0:
            fill_words(key, numbers, Word(n // 64), paths, bits)
        fill_signs(bits, n % 64, paths, z)
        found.append(z.copy())
    return np.array(found)


def test_increments_are_fair_independent_signs():
    z = signs(512, 640)
    assert set(np.unique(z)) == {-1.0, 1.0}
    n = z.size
    checks = [z.mean(), (z[1:] * z[:-1]).mean(), (z[:, 1:] * z[:, :-1]).mean(), (z[64:] * z[:-64]).mean()]
    assert agrees(np.array(checks), 0.0, 1.0 / np.sqrt(n - 64 * 512))
    by_place = z.reshape(10, 64, 512).mean(axis=(0, 2))  # no bit of a word is loaded
    assert agrees(by_place, 0.0, 1.0 / np.sqrt(n / 64))


@pytest.mark.parametrize("scheme", ["euler-maruyama", "euler-maruyama-located"])
def test_section_moments_are_those_of_gaussian_increments(scheme):
    settings = {"paths": 40_000, "impacts": 4, "dt": 2e-3, "scheme": scheme, "workers": 2}
    two = simulate(dat21(1.0), sampling=Sampling(increments="two-point"), rng=1, **settings).section
    normal = simulate(dat21(1.0), rng=2, **settings).section
    for name in ("tau", "y1", "y2", "sd_tau", "sd_y1", "sd_y2"):
        error = np.hypot(two["se_" + name], normal["se_" + name])
        assert agrees(two[name], normal[name], error)
        assert not agrees(1.03 * two[name], normal[name], error)
