"""The cost of accuracy: formulas, the table of levels, cost models, and the command that writes the
report."""

import math

import numpy as np
import pandas as pd
import pytest
from commands import manifest_of, rattle
from scenes import dat21
from scipy import stats

from rattle import Record, Sampling, simulate
from rattle.compare.tradeoff.measure import (
    Allowance,
    CostModel,
    CostPoint,
    _compare,
    means_seconds,
    slope,
)
from rattle.compare.tradeoff.multilevel import (
    Levels,
    Rate,
    control_table,
    find_clear,
    giles_cost,
    levels_of,
)
from rattle.compare.tradeoff.page import cheapest
from rattle.montecarlo import simulate_rare
from rattle.montecarlo.accuracy.cost import cost_of
from rattle.montecarlo.diagnostics.accuracy import units
from rattle.montecarlo.kernel.block import sample

LEVEL_SCENE = dat21(0.3)


def level_run(level, scene=LEVEL_SCENE):
    return simulate(
        scene,
        paths=1500,
        impacts=3,
        scheme="euler-maruyama",
        dt=0.02 / 2**level,
        rng=100 + level,
        record=Record(step_bias=True),
    )


@pytest.fixture(scope="module")
def runs():
    return [level_run(level) for level in range(4)]


# multilevel


@pytest.mark.parametrize("run", [simulate, simulate_rare])
def test_the_cost_of_means_is_known_however_paths_were_drawn(run):
    """One path for an accuracy of one sd; and the run's own standard errors beside it."""
    settings = {"scene": dat21(0.1), "impacts": 3, "paths": 4096}
    first = simulate(**settings)
    model = CostModel("exact-flight", first, 0.0, 0.0, 0.0, 0.0, run(**settings))
    plain, controlled = (means_seconds(model, 0.01, control=c, typical=True) for c in (False, True))
    assert plain == pytest.approx(1e4 * cost_of(first, 1).core_seconds)
    assert 0.01 * plain < controlled < 1.5 * plain


def test_giles_cost_is_that_of_the_best_allocation():
    """No allocation that reaches the accuracy is cheaper, and the one in proportion to sqrt(V/C) is
    as cheap."""
    variance = np.array([1.0, 0.2, 0.03])
    seconds = np.array([1.0, 3.0, 7.0])
    least = giles_cost(variance, seconds, 0.01)
    shares = np.vstack(
        [np.sqrt(variance / seconds), np.random.default_rng(1).uniform(0.1, 1.0, (200, 3))]
    )
    costs = 1e4 * (shares @ seconds) * (variance / shares).sum(axis=1)
    assert costs[0] == pytest.approx(least)
    assert (costs[1:] > least).all()


def synthetic(beta):
    """Levels whose bias halves and whose time doubles with each."""
    table = pd.DataFrame({"level": np.arange(6.0)}).eval(
        f"""
        dt = 0.02 / 2**level
        variance_worst = 0.5 / 2 ** ({beta} * level)
        variance_median = variance_worst
        path_seconds = 1.5 * 2**level
        alone_seconds = 2**level
        """
    )
    halved = Rate(-1.0, 0.0, 0.0)
    decay = Rate(-beta, 0.0, -1.0)
    return Levels(table, np.ones((6, 1)), halved, decay, Rate(1.0, 0.0, 0.0), halved, decay)


@pytest.mark.parametrize(("beta", "power"), [(2.0, -2.0), (0.5, -2.5)])
def test_known_rates_give_the_known_complexity(beta, power):
    """Giles' theorem: accuracy^-2 where beta > gamma, accuracy^-(2 + (gamma - beta) / alpha) where
    it is less."""
    halvings = np.arange(12.0, 22.0)
    costs = [synthetic(beta).estimate(2.0**-n).seconds for n in halvings]
    assert np.polyfit(-halvings, np.log2(costs), 1)[0] == pytest.approx(power, abs=0.08)


def test_table_of_levels_is_that_of_the_paths_themselves(runs):
    """Compared with differences path by path, from both step sizes of one run, which share their
    Brownian paths."""
    row = levels_of(runs).table.iloc[2]
    plan = runs[2].plan
    fine, coarse = np.concatenate(
        [sample(plan, block).rows[:2, :, :, :6] for block in range(plan.blocks)], axis=1
    )
    difference = (fine - coarse) / units(runs[-1]).to_numpy()
    mean = np.abs(difference.mean(axis=0))
    variance = difference.var(axis=0)
    expected = {
        "mean_worst": mean.max(),
        "mean_median": np.median(mean),
        "variance_worst": variance.max(),
        "variance_median": np.median(variance),
        "kurtosis": stats.kurtosis(difference, fisher=False)[variance > 1e-15].max(),
    }
    assert row[list(expected)].to_dict() == pytest.approx(expected, rel=1e-5)
    assert row["alarm"] == (row["kurtosis"] > 100.0)


def test_levels_are_consistent_and_a_negative_control_is_not(runs):
    sound = levels_of(runs).table["consistency"]
    assert math.isnan(sound[0])
    assert (sound[1:] < 1.0).all()
    controls = [*runs[:2], level_run(2, LEVEL_SCENE.with_sigma(0.45)), runs[3]]
    assert (levels_of(controls).table["consistency"][2:] > 1.0).all()


def test_a_decay_that_noise_hides_at_fine_steps_is_that_of_coarser_ones():
    """Of one stage at large noise: a rate of NaN made its multilevel cost 65 times too low."""
    level = np.arange(7)
    table = pd.DataFrame(
        {"level": level, "mean_worst": np.maximum(0.1 * 0.5**level, 0.02), "se_mean_worst": 0.008}
    )
    assert find_clear(table)["level"].tolist() == [0, 1, 2]
    assert find_clear(table.assign(se_mean_worst=1e-4))["level"].tolist() == [2, 3, 4, 5, 6]
    assert len(find_clear(table.assign(se_mean_worst=1.0))) == 7


# models and slopes


def model(bias):
    exact = bias == 0.0
    scheme = "exact-flight" if exact else "euler-maruyama"
    settings = {"sampling": Sampling(control=exact), "record": Record(step_bias=not exact)}
    first = simulate(LEVEL_SCENE, paths=1024, impacts=2, dt=0.01, scheme=scheme, **settings)
    return CostModel(scheme, first, 0.0, 1e-9, 0.0, bias, first)


POINT = CostPoint(
    method="exact-flight",
    kind="scheme",
    accuracy=0.3,
    dt=0.05,
    paths=300,
    core_seconds=1.0,
    sampling_error=0.1,
    step_error=0.0,
    error=0.1,
    measured=True,
    rows=24,
)


@pytest.mark.parametrize(("bias", "power"), [(100.0, -3.0), (0.0, -2.0)])
def test_extrapolated_costs_grow_as_they_should_and_are_flagged(bias, power):
    table = pd.DataFrame([model(bias).at(a) for a in (0.01, 0.003, 0.001, 0.0003)])
    assert not table["measured"].any()
    method = table["method"][0]
    assert slope(table, method, False) == (pytest.approx(power, abs=0.02), 4)
    assert math.isnan(slope(table, method, True)[0])
    assert (table[["sampling_error", "step_error"]].max(axis=1) <= table["accuracy"] * 1.0001).all()


def test_the_cheapest_method_is_that_of_least_counted_work():
    """Whatever the clock said while they ran."""
    quick = POINT._replace(method="euler-maruyama", work=9.0)
    busy = POINT._replace(core_seconds=60.0, work=2.0)
    assert cheapest(pd.DataFrame([quick, busy]), 0.3)["method"] == "exact-flight"


def test_a_run_that_promised_too_much_is_found_out():
    """A run of too few paths to be as accurate as it says, compared with one of many paths."""
    small, large = (
        simulate(LEVEL_SCENE, paths=n, impacts=2, dt=0.05, sampling=Sampling(control=True))
        for n in (300, 30_000)
    )
    own = model(0.0)
    (fair,) = _compare(POINT, small, own, large)
    assert not fair.missed
    missed, beside = _compare(POINT._replace(accuracy=0.001), small, own, large)
    assert missed.missed
    assert missed.error == missed.actual_error > 0.001
    assert not beside.measured


# closures, control, figure


def test_the_control_is_worth_most_at_small_noise():
    quiet, loud = control_table(
        LEVEL_SCENE, impacts=2, seed=1, workers=1, sigmas=(0.01, 1.0), paths=2048
    ).to_dict("records")
    assert quiet["means_median"] > 20.0 > loud["means_median"]
    assert quiet["antithetic_means"] > 100.0 > loud["antithetic_means"] > 0.5
    assert quiet["antithetic_sds"] == pytest.approx(0.5, abs=0.01)


def test_the_budget_of_a_tradeoff_is_that_of_all():
    """Points are charged; the tables rest on fewer paths, down to none where the runs do not
    fit."""
    rich = Allowance(400.0)
    assert rich.of_point == 100.0
    assert rich.scale("the levels", 0.1, 16_384, 30.0, 0) == 16_384
    assert rich.describe() == ""
    poor = Allowance(5.0)
    assert poor.of_point == pytest.approx(0.7)
    assert poor.scale("the levels", 0.1, 16_384, 2.0, 0) == 4096
    assert poor.scale("weak orders", 0.15, 40_000, 37.0, 48) == 0
    assert "4,096 of 16,384 paths for the levels, no weak orders" in poor.describe()
    # the first search for rare branches is part of what is always done; others are charged
    assert [poor.allow_search() for _ in range(3)] == [True, True, False]


# the command


@pytest.mark.usefixtures("undrawn")
def test_command_writes_its_folder_answer_first(tmp_path):
    file = tmp_path / "loud.toml"
    file.write_text(LEVEL_SCENE.to_toml())
    out = tmp_path / "o"
    words = "--impacts 2 --accuracy 0.1 --accuracy 0.001 --budget 6 --no-orders"
    said = rattle(f"tradeoff {file} {words} --out {out}").stdout
    page = (out / "tradeoff.md").read_text()
    assert "weak order" not in page
    first = manifest_of(out)["answer"][0]
    assert page.index(first) < page.index("tradeoff.svg") < page.index("| scheme |")
    assert first in said
    points = pd.read_csv(out / "tradeoff.csv")
    assert set(points["kind"]) == {"scheme", "multilevel", "closure"}
    errors = points.set_index("method")["error"]
    assert errors["branching"] < errors["corrected"]
    reached = points.query("kind == 'scheme' and not missed")
    assert len(reached) == 6
    assert (reached["error"] <= reached["accuracy"]).all()
