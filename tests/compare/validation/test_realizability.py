"""Every bound that moments of a distribution satisfy, with a set of moments that violates each."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import dat21

from rattle import mean_map
from rattle.closure import Edgeworth
from rattle.closure.edgeworth import coefficients
from rattle.compare.validation.realizability import (
    CHECKS,
    NEGATIVE_POINTS,
    NEGATIVE_REACH,
    QUADRATURE,
    first_failures,
    negative_mass,
    realizability_table,
)
from rattle.scene.moments import gaussian_raw_moments

REALIZED_IMPACTS = 12
ALGEBRAIC = [name for name in CHECKS if "negative mass" not in name]


def table_of(closure, sigma, **settings):
    return realizability_table(
        [mean_map(dat21(sigma), closure=closure, **{"impacts": REALIZED_IMPACTS, **settings})]
    )


def with_moments(raw, covariance=None, skew=None):
    """A closure of one impact whose stages have these moments."""
    prediction = mean_map(dat21(0.1), impacts=1, closure="corrected", order=len(raw) - 1)
    if covariance is None:
        covariance = np.zeros((4, 4))
        covariance[:2, :2] = covariance[2:, 2:] = [[raw[2, 0], raw[1, 1]], [raw[1, 1], raw[0, 2]]]
    changed = {"raw": prediction.trace.raw.copy(), "covariance": prediction.trace.covariance.copy()}
    changed["raw"][1] = raw
    changed["covariance"][1] = covariance
    if skew is not None:
        changed["skew"] = np.where(prediction.trace.sd > 0.0, skew, np.nan)
    return replace(prediction, trace=replace(prediction.trace, **changed))


def failing(prediction):
    return set(first_failures(realizability_table([prediction]))["check"])


@pytest.mark.parametrize("sigma", [0.01, 1.5**0.5])
def test_published_first_fails_at_impact_2_in_its_moments(sigma):
    table = table_of("published", sigma)
    first = first_failures(table[table["check"].isin(ALGEBRAIC)]).set_index("check")
    assert first["impact"].min() == 2
    at_2 = set(first[first["impact"] == 2].index)
    variances = {"variance of displacement", "variance of velocity", "covariance eigenvalue"}
    assert at_2 == variances | {"kurtosis", "moment matrix"}
    assert first.loc["|rho|", "impact"] == (
        7 if sigma > 1.0 else 3
    )  # the first at which a rho > 1 has its variances
    # values are not clipped: the negative variance is in the table
    assert table.query("check == 'variance of displacement'")["value"].min() < 0.0


@pytest.mark.parametrize("closure", ["corrected", "saltation"])
@pytest.mark.parametrize("order", [2, 6])
def test_closures_with_a_covariance_are_realizable(closure, order):
    table = table_of(closure, 1.5**0.5, order=order)
    rows = table[table["check"].isin(ALGEBRAIC)]
    assert rows["holds"].all()
    absent = set(rows.loc[rows["holds"].isna(), "check"])
    assert absent == (set() if order >= 4 else {"kurtosis"})
    assert (rows.loc[rows["holds"].notna(), "excess"] == 0.0).all()


def series_mass(rho):
    series = Edgeworth(coefficients(gaussian_raw_moments(1.0, rho, 1.0, 4), 1.0, 1.0), 1.0, 1.0)
    z = np.linspace(-NEGATIVE_REACH, NEGATIVE_REACH, NEGATIVE_POINTS)
    return negative_mass(series.density(*np.meshgrid(z, z)), (z[1] - z[0]) ** 2)


def test_series_of_a_gaussian_is_negative_from_a_rho_of_a_quarter_on():
    """The series is Mehler's in powers of rho; truncated at order 4 it has only two, too few for
    large rho."""
    assert series_mass(0.24) < QUADRATURE < series_mass(0.26)
    assert series_mass(1.0) == pytest.approx(0.125, abs=0.001)


def controls():
    """Moments of a distribution, and negative controls: moments that none has, and the checks that
    must fail for them."""
    base = gaussian_raw_moments(2.0, 0.4, 1.0, 4)

    def changed(**entries):
        raw = base.copy()
        for key, value in entries.items():
            raw[int(key[1]), int(key[2])] = value
        return raw

    return [
        (base, set()),
        (changed(m20=-2.0), {"variance of displacement", "covariance eigenvalue", "moment matrix"}),
        (changed(m02=-1.0), {"variance of velocity", "covariance eigenvalue", "moment matrix"}),
        (changed(m11=1.5), {"|rho|", "covariance eigenvalue", "moment matrix"}),
        (changed(m40=0.9 * 4.0), {"kurtosis", "moment matrix"}),
        (changed(m04=1.5, m03=0.8), {"kurtosis", "moment matrix"}),  # kurtosis 1.5 < 0.64 + 1
        (changed(m22=0.1), {"moment matrix"}),  # below m11^2: no marginal shows it
    ]


@pytest.mark.parametrize(("raw", "checks"), controls())
@pytest.mark.parametrize("scale", [1e-5, 1e5])
def test_unrealizable_moments_are_caught(raw, checks, scale):
    n, p = np.indices(raw.shape)
    table = realizability_table([with_moments(raw * scale ** (n + p))])
    rows = table[table["check"].isin(ALGEBRAIC) & (table["stage"] > 0)]
    failed = rows[~rows["holds"].fillna(True).astype(bool)]
    assert set(failed["check"]) == checks
    assert (failed["excess"] > 0.0).all()


def test_covariance_across_the_stages_is_judged():
    whole = np.eye(4)
    whole[0, 2] = whole[2, 0] = 1.2  # each stage is fine by itself
    table = realizability_table([with_moments(gaussian_raw_moments(1.0, 0.0, 1.0, 4), whole)])
    failed = table[~table["holds"].fillna(True).astype(bool)]
    assert failed[["stage", "check"]].to_numpy().tolist() == [[0, "covariance eigenvalue"]]
    assert failed["excess"].item() == pytest.approx(0.2)
    published = table_of("published", 0.1).query("stage == 0 and check == 'covariance eigenvalue'")
    assert published[["holds", "excess"]].isna().all(axis=None)


def test_negative_densities_are_caught():
    raw = gaussian_raw_moments(1.0, 0.0, 1.0, 4)
    assert failing(with_moments(raw, skew=0.05)) == set()
    assert failing(with_moments(raw, skew=0.5)) == {"section negative mass"}
    raw[3, 0] = 0.6
    assert failing(with_moments(raw)) == {
        "negative mass"
    }  # realizable moments, but no density by this series
