"""The branching closure's bound of its own error, and refinement until a tolerance is met."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from random_gears import gear_sets, noisy

from rattle import InputError
from rattle.closure import mean_map
from rattle.closure.branching import RESOLUTIONS, _trace
from rattle.closure.moments import advice, bounds
from rattle.montecarlo import simulate
from rattle.scene import DAT21, SECTION, Scene, Start

# 0.85 % of the paths leave the itinerary at impact 7, and carry all of the sds at impact 8
RARE = noisy(
    Scene(
        alpha=0.996160573704388,
        epsilon=0.6139620195274591,
        beta1=0.10969166194652114,
        gamma1=0.09219802698556856,
        beta2=0.11738996332821972,
        gamma2=0.14955420785133197,
        mu=0.41409678467831923,
        gap2=0.45055050940770514,
        start=Start(
            1.137492243464469, 0.5, 1.2815102379079604, 0.16496714875240295, -0.6816206655558039, 1
        ),
    ),
    0.01,
)
RARE_SD = {"y1": (0.2037, 0.0008), "y2": (0.2406, 0.0009)}
"""At impact 8, with standard errors: 2,000,000 exact flights."""
RESULTS = Path(__file__).parents[2] / "docs" / "results"


@pytest.fixture(scope="module")
def quiet():
    return mean_map(
        Scene.from_gears(DAT21, sigma=0.01), impacts=4, closure="branching", tolerance=0.05
    )


def test_a_met_tolerance_stops_the_refinement(quiet):
    """A quarter of the finest level's components at most, and it says that its tolerance is met."""
    assert max(len(w) for w, _, _ in quiet.trace.parts.values()) <= RESOLUTIONS[1].cut * 2
    assert quiet.section["within"].all()
    assert "within the tolerance 0.05" in quiet.advice
    assert "own bounds of the errors (estimates; at most one row in ten is beyond them)" in repr(
        quiet
    )


def test_an_unmet_tolerance_says_simulate():
    """Below any resolution: the finest level is reached, and rows are marked."""
    m = mean_map(Scene.from_gears(DAT21, sigma=0.5), impacts=3, closure="branching", tolerance=1e-9)
    assert not m.section["within"].all()
    assert m.advice.endswith("on: simulate")


def test_bounds_by_quantity_are_behind_the_columns(quiet):
    errors = quiet.errors
    assert isinstance(errors, pd.DataFrame)
    worst = errors.groupby("impact").max()
    np.testing.assert_allclose(worst["mean"], quiet.section["error_mean"])
    np.testing.assert_allclose(worst["sd"], quiet.section["error_sd"])
    for impact, mesh in quiet.section["mesh"].items():
        assert f"x{mesh}" not in errors.loc[impact].index
    assert mean_map(quiet.scene, impacts=2).errors is None


@pytest.mark.parametrize("tolerance", [0.0, -0.1, float("nan"), "little"])
def test_a_tolerance_is_positive(quiet, tolerance):
    with pytest.raises(InputError, match="tolerance"):
        mean_map(quiet.scene, impacts=2, closure="branching", tolerance=tolerance)


def test_only_branching_refines(quiet):
    with pytest.raises(InputError, match="cannot refine itself; leave it out, or use branching"):
        mean_map(quiet.scene, impacts=2, tolerance=0.05)


def test_advice_says_how_far_the_tolerance_is_met(quiet):
    """Before, one impact above the tolerance and nothing of the closure was to be used."""
    error = quiet.trace.error.copy()
    error[4, 1, 3] = 0.2
    assert advice(replace(quiet.trace, error=error), 0.05).endswith(
        "0.05 up to impact 3; beyond it simulate"
    )


def test_an_sd_that_few_paths_carry_is_not_within():
    """At its coarse levels the closure is wrong by a third there, beside a bound of 0.019: it was
    not refined."""
    scene = noisy(gear_sets()[9], 0.01)
    impacts = 7
    coarse, fine = (_trace(scene, impacts, 4, level) for level in RESOLUTIONS[:2])
    true = simulate(
        scene, paths=10_240, impacts=impacts, scheme="exact-flight", rng=9, workers=2
    ).section.loc[impacts]
    y1 = SECTION.index("y1")
    assert abs(fine.sd[impacts, y1] - true["sd_y1"]) > 0.1 * true["sd_y1"] + 3.0 * true["se_sd_y1"]
    assert bounds(coarse, fine)[impacts, 1, y1] > 0.1
    # the kurtosis and what is known of the weights are what mark it
    assert bounds(coarse, replace(fine, parts=None, doubted=None))[impacts, 1, y1] < 0.05
    found = (
        mean_map(scene, impacts=impacts, closure="branching", tolerance=0.05)
        .section["sd_y1"]
        .loc[impacts]
    )
    assert abs(found - true["sd_y1"]) < 0.1 * true["sd_y1"] + 3.0 * true["se_sd_y1"]


def test_bounds_hold_against_exact_flights():
    """In nine of ten impacts the worst mean and the worst sd; a planted error is beyond them."""
    scene = Scene.from_gears(DAT21, sigma=0.5)
    impacts = 8
    fine = mean_map(scene, impacts=impacts, closure="branching")
    found = simulate(
        scene, paths=20_000, impacts=impacts, scheme="exact-flight", rng=11, workers=1
    ).section

    def share_beyond(trace):
        own = replace(fine, trace=trace).section
        beyond = []
        for k in range(1, impacts + 1):
            quantities = [
                q for q in ("tau", "flight", "x1", "y1", "x2", "y2") if q != f"x{own['mesh'][k]}"
            ]
            for name, prefix in (("mean", ""), ("sd", "sd_")):
                off = [
                    abs(own[prefix + q][k] - found[prefix + q][k]) / found[f"sd_{q}"][k]
                    for q in quantities
                ]
                leeway = [
                    3.0 * found[f"se_{prefix}{q}"][k] / found[f"sd_{q}"][k] for q in quantities
                ]
                beyond.append(max(off) > fine.section[f"error_{name}"][k] + max(leeway))
        return np.mean(beyond)

    assert share_beyond(fine.trace) <= 0.1
    assert (
        share_beyond(replace(fine.trace, sd=1.4 * fine.trace.sd)) > 0.25
    )  # negative control: a planted error


@pytest.mark.parametrize("tolerance", [0.05, 0.2, None])
def test_a_branch_that_carries_an_sd_is_weighed_or_doubted(tolerance):
    """Its weight was 0.57 % at coarse levels that agreed: sds too small by 18 %, beside a bound of
    0.2 %."""
    m = mean_map(RARE, impacts=8, closure="branching", tolerance=tolerance)
    for quantity, (sd, se) in RARE_SD.items():
        error = abs(m.section[f"sd_{quantity}"].loc[8] - sd) / sd
        assert error < m.errors["sd"].loc[8, quantity] + 3.0 * se / sd
        assert error < 0.1
    # negative control: two levels that agree
    without = bounds(m.trace, replace(m.trace, doubted=None, bent=None))
    assert without[8, 1, SECTION.index("y1")] < 0.03


# gear sets of `random_gears` with few paths on another itinerary at the first impact: how many, by
# 100,000 exact flights, to 0.1 %; the noise of the whole flight, or a tail counted twice, made half
# as much again
FIRST = {(18, 0.003): 0.0187, (23, 0.03): 0.165, (12, 0.1): 0.2046}


@pytest.mark.parametrize(("gears", "noise"), FIRST)
def test_first_branches_have_their_share(gears, noise):
    """At every level, and the finer ones split the components near the boundary hundreds of
    times."""
    scene = noisy(gear_sets(sets=gears + 1)[gears], noise)
    for level in RESOLUTIONS:
        share = 1.0 - _trace(scene, 1, 4, level).agreement[1]
        assert share == pytest.approx(FIRST[gears, noise], rel=0.07, abs=1e-3)


def test_a_flight_that_begins_beyond_its_wall_is_back_at_it_in_time():
    """Noise moved back to the start puts half of the fine components there: a mean was off by 0.46
    of an sd."""
    scene = noisy(gear_sets(sets=28)[27], 0.01)
    coarse, fine = (_trace(scene, 6, 4, level) for level in (RESOLUTIONS[0], RESOLUTIONS[-1]))
    assert fine.work > 10 * coarse.work  # it is split
    assert fine.mean[6, 1] == pytest.approx(
        coarse.mean[6, 1], abs=0.02 * coarse.sd[6, SECTION.index("y1")]
    )


def test_what_the_advice_says_of_the_bounds_is_measured():
    """On random gear sets that the factors were not found on; before it was more than one row in
    ten."""
    found = pd.read_csv(RESULTS / "branching.csv").query("not seen")
    assert found["exceeded"].sum() < 0.1 * found["rows"].sum() < found["exceeded_before"].sum()
    assert found.groupby("noise")[["exceeded", "rows"]].sum().eval("exceeded / rows").max() < 0.1
