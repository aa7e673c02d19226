"""Verdicts on the paths that have followed a closure's itinerary so far, beside those on all
paths."""

import pytest
from scenes import dat21

from rattle import Closure, Record, Scene, Start, simulate, validate
from rattle.compare.judge.verdict import JUDGED
from rattle.compare.validation.answer import answer
from rattle.compare.validation.comparison import find_validity
from rattle.compare.validation.errors import NO_ITINERARY, ON_ITINERARY, TOO_FEW_FOLLOW
from rattle.compare.validation.tables import find_reach, list_leaving
from rattle.montecarlo import Ensemble
from rattle.montecarlo.ensemble.leaving import ENOUGH_EXITS

WITH_BRANCH = dat21(0.1)
IMPACTS = 3


def right(scene, impacts):
    """Another simulation's moments of the paths on the itinerary."""
    run = simulate(scene, paths=200_000, impacts=impacts, rng=99, record=Record(on_itinerary=True))
    return run.on_itinerary().section[["tau", "sd_tau", "y1", "sd_y1", "y2", "sd_y2"]]


def off(scene, impacts):
    """The same with an sd that is a third too large."""
    return right(scene, impacts).assign(sd_y2=lambda t: 1.33 * t["sd_y2"])


@pytest.fixture(scope="module")
def compared():
    methods = ["saltation", Closure("right", right, describes="itinerary"), off]
    return validate(WITH_BRANCH, impacts=IMPACTS, closures=methods, paths=40_000, rng=5)


def test_a_right_closure_is_accurate_there_and_a_wrong_one_is_caught(compared):
    rows = compared.section_rows("right", ON_ITINERARY)
    assert set(rows["verdict"]) & set(JUDGED) == {"accurate"}
    sd_y2 = "quantity == 'y2' and moment == 'sd'"
    assert set(compared.section_rows("off", ON_ITINERARY).query(sd_y2)["verdict"]) == {"inaccurate"}
    # all paths together have another sd
    assert compared.section_rows("right").query(sd_y2)["verdict"].iloc[-1] == "inaccurate"


def test_counts_and_ranges_of_all_paths_leave_these_rows_aside(compared):
    of_all = compared.table.query("closure == 'saltation' and kind != 'itinerary'")
    assert compared.counts.loc["saltation"].sum() == of_all["verdict"].isin(JUDGED).sum()
    found = find_validity(compared, "right")
    assert found.itinerary_accurate == IMPACTS > found.accurate
    assert 0.02 < found.leaving_low < found.leaving < found.leaving_high < 0.05
    assert found.leaving == pytest.approx(1.0 - compared.run.agreement["right"][IMPACTS], rel=0.1)
    assert "`right` is accurate; all paths together: it is not" in " ".join(answer([compared]))
    assert find_reach(compared)["describes"].tolist() == [
        "paths on its itinerary",
        "paths on its itinerary",
        "not stated",
    ]
    assert len(list_leaving(compared).query("mesh == 2 and side == -1"))


def test_branching_tells_the_paths_on_the_itinerary_from_all():
    v = validate(WITH_BRANCH, impacts=IMPACTS, closures=["branching"], paths=40_000, rng=6)
    assert set(v.section_rows("branching", ON_ITINERARY)["verdict"]) & set(JUDGED) == {"accurate"}
    every = v.predictions["branching"]
    assert every.section["sd_y2"][IMPACTS] > 1.1 * every.on_itinerary().section["sd_y2"][IMPACTS]


def test_where_no_itinerary_has_half_of_the_paths_it_says_so():
    loud = validate(
        WITH_BRANCH.with_sigma(1.2), impacts=IMPACTS, closures=["saltation"], paths=2000, rng=1
    )
    few = loud.section_rows("saltation", ON_ITINERARY).query("agreement < 0.5")
    assert set(few["verdict"]) == {"excluded"}
    assert set(few["remark"]) == {TOO_FEW_FOLLOW}


def test_an_orbit_at_rest_has_no_itinerary_and_says_so():
    # noise alone brings it to a wall
    found = validate(
        Scene(
            alpha=0.05, epsilon=0.5, beta1=0.5, gamma1=0.0, stages=1, sigma=0.3, start=Start(y1=0.1)
        ),
        impacts=2,
        closures=["saltation"],
        paths=64,
    )
    rows = found.section_rows("saltation", ON_ITINERARY)
    assert set(rows["verdict"]) == {"not predicted"}
    assert set(rows["remark"]) == {NO_ITINERARY}
    assert "ewer than half of the paths" in " ".join(answer([found]))


@pytest.mark.parametrize(("paths", "pilots"), [(3072, True), (3584, False)])
def test_how_it_is_known_how_many_leave_is_settled_before_they_are_counted(
    paths, pilots, monkeypatch
):
    """One of the runs counts `ENOUGH_EXITS` paths that left, the other fewer: both are treated
    alike.
    """
    asked = []
    settings = {"impacts": IMPACTS, "closures": ["saltation"], "fixed_times": False}
    found = validate(WITH_BRANCH, paths=1024, **settings).run.leaving
    monkeypatch.setattr(Ensemble, "leaving", property(lambda run: asked.append(run) or found))
    counts = []
    for seed in (3, 8):
        v = validate(WITH_BRANCH, paths=paths, rng=seed, **settings)
        v.leaving("saltation")
        counts.append(paths * (1.0 - v.run.agreement["saltation"][IMPACTS]))
    assert min(counts) < ENOUGH_EXITS < max(counts)
    assert len({id(run) for run in asked}) == 2 * pilots
