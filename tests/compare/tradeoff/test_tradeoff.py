"""The cost of accuracy: formulas, the table of levels, cost models, and the command that writes the
report."""

import json
import math
import re
from functools import partial
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from commands import rattle as command

from rattle.compare.tradeoff.measure import (
    CostModel,
    CostPoint,
    _compare,
    closure_points,
    find_plain,
    means_seconds,
    slope,
)
from rattle.compare.tradeoff.multilevel import (
    Levels,
    Rate,
    control_table,
    find_clear,
    fit,
    giles_cost,
    levels_of,
)
from rattle.compare.tradeoff.page import cheapest
from rattle.montecarlo import Record, simulate, simulate_rare
from rattle.montecarlo.accuracy.cost import cost_of
from rattle.montecarlo.diagnostics.accuracy import units
from rattle.montecarlo.kernel.block import sample
from rattle.montecarlo.settings import Sampling
from rattle.scene import DAT21, Scene

SCENE = Scene.from_gears(DAT21, sigma=0.3)
IMPACTS = 3
PATHS = 1500


def level_run(level, scene=SCENE):
    settings = {
        "paths": PATHS,
        "impacts": IMPACTS,
        "scheme": "euler-maruyama",
        "record": Record(step_bias=True),
    }
    return simulate(scene, dt=0.02 / 2**level, rng=100 + level, **settings)


@pytest.fixture(scope="module")
def runs():
    return [level_run(level) for level in range(4)]


# multilevel


@pytest.mark.parametrize("run", [simulate, simulate_rare])
def test_the_cost_of_means_is_known_however_paths_were_drawn(run):
    """One path for an accuracy of one sd; and the run's own standard errors beside it."""
    scene = Scene.from_gears(DAT21, sigma=0.1)
    settings = {"impacts": 3, "paths": 4096}
    first = simulate(scene, **settings)
    model = CostModel("exact-flight", first, 0.0, 0.0, 0.0, 0.0, run(scene, **settings))
    path = cost_of(first, 1).core_seconds
    found = means_seconds(model, 0.01, control=False, typical=True)
    assert found == pytest.approx(1e4 * path)
    assert 0.01 * found < means_seconds(model, 0.01, control=True, typical=True) < 1.5 * found


def test_giles_cost_is_that_of_the_best_allocation():
    """No allocation that reaches the accuracy is cheaper, and the one in proportion to sqrt(V/C) is
    as cheap."""
    variance = np.array([1.0, 0.2, 0.03])
    seconds = np.array([1.0, 3.0, 7.0])
    accuracy = 0.01
    least = giles_cost(variance, seconds, accuracy)
    best = np.sqrt(variance / seconds)
    for weights in (best, *np.random.default_rng(1).uniform(0.1, 1.0, (200, 3))):
        paths = weights * (variance / weights).sum() / accuracy**2
        cost = float(paths @ seconds)
        assert cost >= least * (1.0 - 1e-9)
    paths = best * (variance / best).sum() / accuracy**2
    assert float(paths @ seconds) == pytest.approx(least)


def synthetic(alpha=1.0, beta=2.0, gamma=1.0, levels=6):
    level = np.arange(levels, dtype=float)
    table = pd.DataFrame(
        {
            "level": level,
            "dt": 0.02 / 2**level,
            "variance_worst": 0.5 * 2 ** (-beta * level),
            "variance_median": 0.5 * 2 ** (-beta * level),
            "path_seconds": 1.5 * 2 ** (gamma * level),
            "alone_seconds": 2.0 ** (gamma * level),
        }
    )
    rates = (
        Rate(-alpha, 0.0, 0.0),
        Rate(-beta, 0.0, -1.0),
        Rate(gamma, 0.0, 0.0),
        Rate(-alpha, 0.0, 0.0),
    )
    return Levels(table, np.ones((levels, 1)), *rates, Rate(-beta, 0.0, -1.0))


@pytest.mark.parametrize(("beta", "power"), [(2.0, -2.0), (0.5, -2.5)])
def test_known_rates_give_the_known_complexity(beta, power):
    """Giles' theorem: accuracy^-2 where beta > gamma, accuracy^-(2 + (gamma - beta) / alpha) where
    it is less."""
    levels = synthetic(beta=beta)
    accuracies = 2.0 ** -np.arange(12.0, 22.0)
    costs = [levels.estimate(a).seconds for a in accuracies]
    assert np.polyfit(np.log(accuracies), np.log(costs), 1)[0] == pytest.approx(power, abs=0.08)


def test_an_estimate_has_the_levels_that_the_bias_asks_for():
    found = synthetic().estimate(2.0**-4)
    assert found.last == 4  # the difference at level 4 is 2^-4, and so is the sum of all finer ones


def test_table_of_levels_is_that_of_the_paths_themselves(runs):
    """Compared with differences path by path, from both step sizes of one run, which share their
    Brownian paths."""
    levels = levels_of(runs)
    unit = units(runs[-1]).to_numpy()
    raw = [sample(runs[2].plan, block).rows[:2, :, :, :6] for block in range(runs[2].plan.blocks)]
    fine, coarse = np.concatenate(raw, axis=1)
    difference = fine - coarse
    row = levels.table.iloc[2]
    mean = np.abs(difference.mean(axis=0)) / unit
    variance = difference.var(axis=0)
    assert row["mean_worst"] == pytest.approx(mean.max(), rel=1e-9)
    assert row["mean_median"] == pytest.approx(np.median(mean), rel=1e-9)
    assert row["variance_worst"] == pytest.approx((variance / unit**2).max(), rel=1e-8)
    assert row["variance_median"] == pytest.approx(np.median(variance / unit**2), rel=1e-8)
    fourth = ((difference - difference.mean(axis=0)) ** 4).mean(axis=0)
    moving = variance > 1e-20
    assert row["kurtosis"] == pytest.approx(
        (fourth[moving] / variance[moving] ** 2).max(), rel=1e-5
    )
    assert row["alarm"] == (row["kurtosis"] > 100.0)


def test_levels_are_consistent_and_a_negative_control_is_not(runs):
    sound = levels_of(runs).table["consistency"]
    assert math.isnan(sound[0])
    assert (sound[1:] < 1.0).all()
    controls = [*runs[:2], level_run(2, SCENE.with_sigma(0.45)), runs[3]]
    caught = levels_of(controls).table["consistency"]
    assert caught[2] > 1.0
    assert caught[3] > 1.0


def test_a_decay_that_noise_hides_at_fine_steps_is_that_of_coarser_ones():
    """Of one stage at large noise: a rate of NaN made its multilevel cost 65 times too low."""
    level = np.arange(7)
    table = pd.DataFrame(
        {"level": level, "mean_worst": np.maximum(0.1 * 0.5**level, 0.02), "se_mean_worst": 0.008}
    )
    assert find_clear(table)["level"].tolist() == [0, 1, 2]
    assert find_clear(table.assign(se_mean_worst=1e-4))["level"].tolist() == [2, 3, 4, 5, 6]
    assert len(find_clear(table.assign(se_mean_worst=1.0))) == 7


def test_rates_come_with_intervals():
    noisy = 2.0 ** (-np.arange(1.0, 7.0) + np.random.default_rng(0).normal(0.0, 0.2, 6))
    rate = fit(np.arange(1.0, 7.0), noisy)
    assert abs(rate.slope + 1.0) < rate.half < 0.5


# models and slopes


def model(bias=100.0, **given):
    exact = bias == 0.0
    scheme = "exact-flight" if exact else "euler-maruyama"
    settings = {"sampling": Sampling(control=exact), "record": Record(step_bias=not exact)}
    first = simulate(SCENE, paths=1024, impacts=2, dt=0.01, scheme=scheme, **settings)
    return CostModel(
        scheme,
        first,
        **{
            "path_seconds": 0.0,
            "step_seconds": 1e-9,
            "pilot_seconds": 0.0,
            "bias": bias,
            "best": first,
            **given,
        },
    )


@pytest.mark.parametrize(("bias", "power"), [(100.0, -3.0), (0.0, -2.0)])
def test_extrapolated_costs_grow_as_they_should_and_are_flagged(bias, power):
    points = [model(bias).at(a) for a in (0.01, 0.003, 0.001, 0.0003)]
    assert not any(p.measured for p in points)
    found, n = slope(pd.DataFrame(points), points[0].method, False)
    assert n == 4
    assert found == pytest.approx(power, abs=0.02)
    assert math.isnan(slope(pd.DataFrame(points), points[0].method, True)[0])
    assert all(
        p.sampling_error <= p.accuracy * 1.0001 and p.step_error <= p.accuracy * 1.0001
        for p in points
    )


def test_the_cheapest_method_is_that_of_least_counted_work():
    """Whatever the clock said while they ran."""
    rows = pd.DataFrame(
        [
            CostPoint(
                name, "scheme", 0.1, 0.1, 5000, seconds, 0.1, 0.0, 0.1, True, rows=24, work=work
            )
            for name, seconds, work in (("euler-maruyama", 1.0, 9.0), ("exact-flight", 60.0, 2.0))
        ]
    )
    assert cheapest(rows, 0.1)["method"] == "exact-flight"
    own = model(0.0)
    point = own.at(0.01)
    assert point.work == pytest.approx(
        cost_of(own.first, own.first.paths + point.paths).core_seconds
    )


def test_a_run_that_promised_too_much_is_found_out():
    """A run of too few paths to be as accurate as it says, compared with one of many paths."""
    settings = {
        "impacts": 2,
        "dt": 0.05,
        "scheme": "exact-flight",
        "sampling": Sampling(control=True),
    }
    small, large = (simulate(SCENE, paths=n, **settings) for n in (300, 30_000))
    own = model(0.0)
    point = CostPoint("exact-flight", "scheme", 0.3, 0.05, 300, 1.0, 0.1, 0.0, 0.1, True, rows=24)
    (fair,) = _compare(point, small, own, large)
    assert fair.error == 0.1
    assert not fair.missed
    missed, beside = _compare(point._replace(accuracy=0.001), small, own, large)
    assert missed.missed
    assert missed.error == missed.actual_error > 0.001
    assert not beside.measured
    assert beside.accuracy == 0.001


# closures, control, figure


def test_closures_have_errors_of_the_right_size():
    quiet = Scene.from_gears(DAT21, sigma=0.01)
    run = simulate(
        quiet,
        paths=20_000,
        impacts=2,
        dt=0.05,
        scheme="exact-flight",
        sampling=Sampling(control=True),
    )
    points = {p.method: p for p in closure_points(quiet, 2, run)}
    assert points["saltation"].error < 0.05
    assert points["corrected"].error > 0.2
    assert points["corrected"].resolved
    assert points["corrected"].rows < points["saltation"].rows == 24
    assert 0.0 < points["saltation"].median_error < points["saltation"].error
    assert all(p.core_seconds > 0.0 for p in points.values())


def test_the_control_is_worth_most_at_small_noise():
    table = control_table(SCENE, impacts=2, seed=1, workers=1, sigmas=(0.01, 1.0), paths=2048)
    assert table["means_median"][0] > 20.0 > table["means_median"][1]
    assert (table["means_smallest"] <= table["means_median"]).all()
    assert (table["time_ratio"] > 0.5).all()
    assert table["antithetic_means"][0] > 100.0 > table["antithetic_means"][1] > 0.5
    assert table["antithetic_sds"][0] == pytest.approx(0.5, abs=0.01)


def test_euler_s_paths_are_foreseen_by_plain_ones():
    runs = [
        SimpleNamespace(paths=n, plan=SimpleNamespace(mixture=m))
        for n, m in ((9, None), (50, "near"), (20, None))
    ]
    assert find_plain(runs).paths == 20


# the command


rattle = partial(command, "tradeoff")


@pytest.mark.usefixtures("undrawn")
def test_command_writes_its_folder_answer_first(tmp_path):
    (tmp_path / "loud.toml").write_text(SCENE.to_toml())
    out = tmp_path / "o"
    said = rattle(
        tmp_path / "loud.toml",
        "--impacts",
        2,
        "--accuracy",
        0.1,
        "--accuracy",
        0.001,
        "--budget",
        0.5,
        "--no-orders",
        "--out",
        out,
    ).stdout
    assert {p.name for p in out.iterdir()} == {
        *("manifest.json", "tradeoff.md", "tradeoff.html", "tradeoff.svg"),
        *("tradeoff.csv", "levels.csv", "control.csv"),
    }
    page = (out / "tradeoff.md").read_text()
    assert "weak order" not in page
    answer = json.loads((out / "manifest.json").read_text())["answer"]
    assert page.index(answer[0]) < page.index("tradeoff.svg") < page.index("| scheme |")
    assert answer[0] in said
    points = pd.read_csv(out / "tradeoff.csv")
    schemes = points[points["kind"] == "scheme"]
    assert set(points["kind"]) == {"scheme", "multilevel", "closure"}
    assert len(schemes[~schemes["missed"]]) == 6
    assert not schemes[schemes["accuracy"] == 0.001]["measured"].any()
    reached = schemes[~schemes["missed"]]
    assert reached[(reached["accuracy"] == 0.1) & (reached["method"] == "exact-flight")][
        "measured"
    ].all()
    assert (reached["error"] <= reached["accuracy"]).all()
    levels = pd.read_csv(out / "levels.csv")
    assert set(levels["scheme"]) == {"euler-maruyama", "euler-maruyama-located"}


BAD = {
    "accuracy": (["--accuracy", "0"], "accuracy = 0.0: must be greater than 0"),
    "sigma": (["--sigma", "-1"], "sigma = -1.0"),
    "no noise": (["--sigma", "0"], "sigma = 0.0: must be greater than 0"),
    "budget": (["--budget", "0"], "budget = 0.0: must be greater than 0"),
    "impacts": (["--impacts", "0"], "impacts = 0: must be at least 1"),
    "workers": (["--workers", "0"], "workers = 0: must be at least 1"),
    "seed": (["--seed", "-1"], "rng = -1: must be at least 0"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_names_value_and_remedy_and_writes_nothing(case, tmp_path):
    words, message = BAD[case]
    result = rattle(*words, "--out", tmp_path / "out", code=2)
    assert re.search(message, result.stderr)
    assert not (tmp_path / "out").exists()
