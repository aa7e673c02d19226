"""Measured orders: correct for changes of known order, NaN where noise hides them, and plausible for the schemes."""

import numpy as np
import pytest

from rattle.compare.tradeoff.weak_order import changes_from, order_from, weak_orders
from rattle.scene import DAT21, InputError, Scene

STEPS = (0.04, 0.02, 0.01)


def made_up(order, noise, seed=1, replicates=6, rows=30):
    """Changes of a known order with measurement noise of a known standard error."""
    rng = np.random.default_rng(seed)
    size = np.linspace(0.5, 1.5, rows) * np.array(STEPS)[:, None] ** order
    se = np.full((replicates, len(STEPS), rows), noise)
    return size + noise * rng.standard_normal(se.shape), se


@pytest.mark.parametrize("order", [0.5, 1.0, 2.0])
def test_known_order_lies_in_the_interval(order):
    bias, se = made_up(order, 0.02 * STEPS[-1] ** order)
    _, low, high, last = order_from(bias, se, STEPS)
    assert low < order < high
    assert high - low < 0.1
    assert last == pytest.approx(STEPS[-1] ** order * np.sqrt(np.mean(np.linspace(0.5, 1.5, 30) ** 2)), rel=0.05)
    assert not low < order + 0.2 < high


def test_interval_of_a_change_covers_as_often_as_it_says():
    true = np.array(STEPS) * np.sqrt(np.mean(np.linspace(0.5, 1.5, 30) ** 2))
    inside, beside = 0, 0
    for seed in range(100):
        change, low, high = changes_from(*made_up(1.0, 0.3 * STEPS[-1], seed=seed))
        np.testing.assert_allclose(change, np.sqrt(low * high), rtol=1e-12)
        inside += int(((low < true) & (true < high)).sum())
        beside += int(((low < 1.5 * true) & (1.5 * true < high)).sum())
    assert inside > 255  # of 300; 285 expected, sd 4; the jackknife of a ratio is a little narrow
    assert beside < 30


def test_interval_covers_as_often_as_it_says():
    inside = 0
    for seed in range(200):
        _, low, high, _ = order_from(*made_up(1.0, 0.3 * STEPS[-1], seed=seed), STEPS)
        inside += low < 1.0 < high
    assert inside > 170  # 190 expected, sd 3; the jackknife of a ratio is a little narrow


def test_noise_is_not_taken_for_change():
    bias, se = made_up(1.0, 10.0)
    assert np.isnan(order_from(np.zeros_like(bias) + 1e-9 * bias, se, STEPS)[0])


def test_located_scheme_has_order_one_and_both_have_the_right_limit():
    table, changes = weak_orders(Scene.from_gears(DAT21, sigma=1.0), impacts=2, paths=4096, replicates=4, rng=2)
    assert set(table["scheme"]) == {"euler-maruyama", "euler-maruyama-located"}
    assert set(table["moment"]) == {"mean", "sd", "itinerary"}
    means = table[table["moment"] == "mean"].set_index("scheme")
    for scheme in means.index:
        assert 0.6 < means.at[scheme, "order"] < 1.4
    assert (table["limit_z"] < 1.5 * table["limit_allowed"]).all()
    seen = changes.dropna()
    assert ((seen["low"] < seen["change"]) & (seen["change"] < seen["high"])).all()
    last = changes[changes["moment"] == "mean"].groupby("scheme")["change"].last()
    assert last.to_dict() == means["change"].to_dict()


def test_one_replicate_is_no_interval():
    with pytest.raises(InputError, match="replicates = 1"):
        weak_orders(Scene.from_gears(DAT21, sigma=1.0), replicates=1)
