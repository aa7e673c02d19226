"""Slopes: correct for changes of known order, an order only where they settle, plausible for the
schemes."""

import numpy as np
import pytest
from scenes import dat21

from rattle.compare.tradeoff.weak_order import changes_from, find_settled, slope_from, weak_orders

HALVED_STEPS = (0.04, 0.02, 0.01)


def made_up(order, noise, seed=1):
    """Changes of a known order with measurement noise of a known standard error."""
    rng = np.random.default_rng(seed)
    size = np.linspace(0.5, 1.5, 30) * np.array(HALVED_STEPS)[:, None] ** order
    se = np.full((6, 3, 30), noise)
    return size + noise * rng.standard_normal(se.shape), se


@pytest.mark.parametrize("order", [0.5, 2.0])
def test_known_order_lies_in_the_interval(order):
    bias, se = made_up(order, 0.02 * HALVED_STEPS[-1] ** order)
    _, low, high = slope_from(bias, se, HALVED_STEPS)
    assert low < order < high
    assert high - low < 0.1


def test_interval_of_a_change_covers_as_often_as_it_says():
    true = np.array(HALVED_STEPS) * np.sqrt(np.mean(np.linspace(0.5, 1.5, 30) ** 2))
    samples = [made_up(1.0, 0.3 * HALVED_STEPS[-1], seed=seed) for seed in range(100)]
    change, low, high = np.stack([changes_from(*sample) for sample in samples], axis=1)
    np.testing.assert_allclose(change, np.sqrt(low * high), rtol=1e-12)
    # of 300; 285 expected, sd 4; the jackknife of a ratio is a little narrow
    assert ((low < true) & (true < high)).sum() > 255
    assert ((low < 1.5 * true) & (1.5 * true < high)).sum() < 30


FOUR_STEPS = (0.08, *HALVED_STEPS)


def changes_of(size):
    """Changes of the given sizes, shape (steps, rows), with relative noise of a known standard
    error."""
    se = np.broadcast_to(1e-4 * np.abs(size).max(axis=0), (6, *size.shape))
    return size + se * np.random.default_rng(3).standard_normal(se.shape), se


def test_a_slope_that_has_settled_is_an_order():
    order, low, high, turns = find_settled(
        *changes_of(np.array(FOUR_STEPS)[:, None] ** 0.95), FOUR_STEPS
    )
    assert order == pytest.approx(0.95, abs=0.01)
    assert low < 0.95 < high
    assert turns == 0


def test_a_slope_that_has_not_settled_is_no_order():
    """It rises, or the change turns its sign."""
    h = np.array(FOUR_STEPS)[:, None]
    for size, turns in ((h + 40.0 * h**2, 0), (h - 0.7 * 0.02, 1)):
        order, _, _, turned = find_settled(*changes_of(size), FOUR_STEPS)
        assert np.isnan(order)
        assert turned == turns


def test_located_scheme_has_order_one_and_both_have_the_right_limit():
    table, changes = weak_orders(dat21(1.0), impacts=2, paths=4096, replicates=4, rng=2)
    assert set(table["moment"]) == {"mean", "sd", "itinerary"}
    assert (
        table.query("moment == 'mean' and quantity in ['tau', 'y1']")["slope"]
        .between(0.6, 1.4)
        .all()
    )
    assert (table["limit_z"].dropna() < 1.5 * table["limit_allowed"].max()).all()
    row = "moment == 'mean' and quantity == 'tau'"
    last = changes.query(row).groupby("scheme")["change"].last()
    assert last.to_dict() == table.query(row).set_index("scheme")["change"].to_dict()
