"""Every bound that moments of a distribution satisfy, with a set of moments that violates each."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import dat21
from scipy.linalg import block_diag

from rattle import mean_map
from rattle.compare.validation.realizability import CHECKS, first_failures, realizability_table
from rattle.scene.moments import gaussian_raw_moments

ALGEBRAIC = [name for name in CHECKS if "negative mass" not in name]


def table_of(closure, sigma, order=4):
    return realizability_table([mean_map(dat21(sigma), closure=closure, order=order)])


def with_moments(raw, covariance=None, skew=None):
    """The table of a closure of one impact whose stages have these moments."""
    prediction = mean_map(dat21(0.1), impacts=1, closure="corrected")
    trace = prediction.trace
    trace.raw[1] = raw
    stage = [[raw[2, 0], raw[1, 1]], [raw[1, 1], raw[0, 2]]]
    trace.covariance[1] = block_diag(stage, stage) if covariance is None else covariance
    if skew is not None:
        trace = replace(trace, skew=np.where(trace.sd > 0.0, skew, np.nan))
    return realizability_table([replace(prediction, trace=trace)])


def failing(raw, **changed):
    return set(first_failures(with_moments(raw, **changed))["check"])


@pytest.mark.parametrize("sigma", [0.01, 1.5**0.5])
def test_published_first_fails_at_impact_2_in_its_moments(sigma):
    table = table_of("published", sigma)
    first = first_failures(table[table["check"].isin(ALGEBRAIC)]).set_index("check")["impact"]
    assert first.to_dict() == {
        "variance of displacement": 2,
        "variance of velocity": 2,
        "covariance eigenvalue": 2,
        "kurtosis": 2,
        "moment matrix": 2,
        "|rho|": 7 if sigma > 1.0 else 3,  # the first at which a rho > 1 has its variances
    }
    # values are not clipped: the negative variance is in the table
    assert table.query("check == 'variance of displacement'")["value"].min() < 0.0


@pytest.mark.parametrize("closure", ["corrected", "saltation"])
@pytest.mark.parametrize("order", [2, 6])
def test_closures_with_a_covariance_are_realizable(closure, order):
    table = table_of(closure, 1.5**0.5, order=order)
    rows = table[table["check"].isin(ALGEBRAIC)]
    assert rows["holds"].all()
    assert set(rows["check"][rows["holds"].isna()]) == (set() if order >= 4 else {"kurtosis"})
    assert (rows["excess"][rows["holds"].notna()] == 0.0).all()


@pytest.mark.parametrize(
    ("changed", "checks"),
    [
        ({}, set()),
        ({(2, 0): -2.0}, {"variance of displacement", "covariance eigenvalue", "moment matrix"}),
        ({(0, 2): -1.0}, {"variance of velocity", "covariance eigenvalue", "moment matrix"}),
        ({(1, 1): 1.5}, {"|rho|", "covariance eigenvalue", "moment matrix"}),
        ({(4, 0): 0.9 * 4.0}, {"kurtosis", "moment matrix"}),
        ({(0, 4): 1.5, (0, 3): 0.8}, {"kurtosis", "moment matrix"}),  # kurtosis 1.5 < 0.64 + 1
        ({(2, 2): 0.1}, {"moment matrix"}),  # below m11^2: no marginal shows it
    ],
)
@pytest.mark.parametrize("scale", [1e-5, 1e5])
def test_unrealizable_moments_are_caught(changed, checks, scale):
    """Moments of a distribution, and negative controls: moments that none has."""
    raw = gaussian_raw_moments(2.0, 0.4, 1.0, 4)
    for place, value in changed.items():
        raw[place] = value
    table = with_moments(raw * scale ** np.add(*np.indices(raw.shape)))
    rows = table[table["check"].isin(ALGEBRAIC) & (table["stage"] > 0)]
    failed = rows[rows["holds"].isin([False])]
    assert set(failed["check"]) == checks
    assert (failed["excess"] > 0.0).all()


def test_covariance_across_the_stages_is_judged():
    whole = np.eye(4)
    whole[0, 2] = whole[2, 0] = 1.2  # each stage is fine by itself
    table = with_moments(gaussian_raw_moments(1.0, 0.0, 1.0, 4), whole)
    (failed,) = table[table["holds"].isin([False])].to_dict("records")
    assert (failed["stage"], failed["check"]) == (0, "covariance eigenvalue")
    assert failed["excess"] == pytest.approx(0.2)
    published = table_of("published", 0.1).query("stage == 0 and check == 'covariance eigenvalue'")
    assert published[["holds", "excess"]].isna().all(axis=None)


def test_negative_densities_are_caught():
    """The series of a Gaussian is Mehler's in powers of rho; truncated at order 4 it has only two,
    too few from a quarter on."""
    raw = gaussian_raw_moments(1.0, 0.24, 1.0, 4)
    assert failing(raw, skew=0.05) == set()
    assert failing(raw, skew=0.5) == {"section negative mass"}
    assert failing(gaussian_raw_moments(1.0, 0.26, 1.0, 4)) == {"negative mass"}
    raw[3, 0] = 0.6
    # realizable moments, but no density by this series
    assert failing(raw) == {"negative mass"}
