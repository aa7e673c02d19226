"""judge: samples of any simulation in any form, and what is said of them."""

import numpy as np
import pandas as pd
import pytest
from commands import rattle
from programs import python
from refusals import refusal, refusal_in_words
from scenes import dat21
from scipy import stats
from scipy.signal import lfilter

import rattle as rt
from rattle import InputError

WALKS = 4000
WALK_ROWS = 3
WALK_TIMES = pd.Index([0.1, 0.2, 0.3], name="time")
ROW = ["moment", "quantity", "time"]
INTERVAL = ["low", "high"]


@pytest.fixture(scope="module")
def samples():
    """Two correlated random walks, shape (paths, rows, 2)."""
    walks = np.random.default_rng(7).normal(size=(WALKS, WALK_ROWS, 2)).cumsum(axis=1)
    walks[:, :, 1] += 0.5 * walks[:, :, 0]
    return walks


@pytest.fixture
def predicted():
    """The exact moments of these walks."""
    k = np.arange(1.0, WALK_ROWS + 1.0)
    columns = {"x": 0.0 * k, "sd_x": np.sqrt(k), "v": 0.0 * k, "sd_v": np.sqrt(1.25 * k)}
    return pd.DataFrame(columns | {"rho_x_v": 0.5 / np.sqrt(1.25)}, index=WALK_TIMES)


def as_long(samples):
    """The samples as a long table."""
    paths, rows, _ = samples.shape
    table = pd.DataFrame(samples.reshape(-1, 2), columns=["x", "v"])
    table["path"] = np.repeat(np.arange(paths), rows)
    table["time"] = np.tile(WALK_TIMES.to_numpy(), paths)
    return table


def forms(samples, folder):
    """The same samples in every form."""
    import xarray as xr

    long = as_long(samples)
    long.to_csv(folder / "all.csv", index=False, float_format="%.17g")
    parts = folder / "parts"
    parts.mkdir()
    for number in range(4):
        long[long["path"] % 4 == number].to_parquet(parts / f"{number}.parquet")
    return {
        "array": samples,
        "mapping": {"x": samples[:, :, 0], "v": samples[:, :, 1]},
        "long table": long,
        "indexed table": long.set_index(["path", "time"]),
        "dataset": xr.DataArray(
            samples, {"time": WALK_TIMES, "name": ["x", "v"]}, ("path", "time", "name")
        ).to_dataset("name"),
        "csv": str(folder / "all.csv"),
        "folder": parts,
        "blocks": iter(np.array_split(samples, 5)),
    }


def test_every_form_gives_the_same_verdicts(samples, predicted, tmp_path):
    """Form by form the same table, but for the order of summation."""
    tables = [
        rt.judge(predicted, form, names=["x", "v"]).table.set_index(ROW).sort_index()
        for form in forms(samples, tmp_path).values()
    ]
    for table in tables:
        pd.testing.assert_frame_equal(table, tables[0], rtol=1e-9)
    assert set(tables[0]["verdict"]) <= {"accurate", "undecided"}


def test_a_reduced_table_gives_the_same_means_and_sds(samples, predicted):
    """Moments and errors alone decide as the samples do, but for the skewness of the sampling."""
    claim = predicted.drop(columns="rho_x_v")
    found = rt.judge(claim, samples).table
    tidy = found[[*ROW, "simulated", "se", "paths"]]
    one, two = (table.set_index(ROW) for table in (found, rt.judge(claim, tidy).table))
    pd.testing.assert_frame_equal(one[INTERVAL], two[INTERVAL], atol=3e-3, check_like=True)


def test_an_exact_reference_decides_everything(predicted):
    """Standard errors of 0: no interval, no sentence on paths; a planted error is found."""
    exact = predicted.drop(columns="rho_x_v")
    reference = exact.join(0.0 * exact.add_prefix("se_"))
    right = rt.judge(exact, reference)
    assert right.accurate
    assert "exact" in right.answer[1]
    wrong = rt.judge(exact.assign(sd_x=1.101 * exact["sd_x"]), reference)
    assert wrong.counts.loc["prediction"].tolist() == [9, 3, 0]


def test_planted_errors_are_found_where_there_are_enough_paths():
    """0.1 sd in a mean and 20 % in an sd, with the number of paths that is called enough."""
    draws = np.random.default_rng(11).normal(size=(30_000, 200))  # rows judged as if each alone
    table = rt.judge(
        pd.DataFrame({"x": 0.1, "sd_x": 1.2}, index=range(1, 201)), {"x": draws}, checks=2
    ).table
    enough = table[table["enough_paths"]]
    found = (enough["verdict"] == "inaccurate").groupby(enough["moment"]).mean()
    assert set(found.index) == {"mean", "sd"}
    assert (found >= 0.95).all()


def share_called_inaccurate(draws, mean, variance, skew, kurt):
    """Of 1,000 exact closures, each judged by a column of draws."""
    claim = {"x": mean, "sd_x": np.sqrt(variance), "skew_x": skew, "kurt_x": kurt}
    table = rt.judge(pd.DataFrame(claim, index=range(1, 1001)), {"x": draws}, checks=4).table
    return table.query("verdict == 'inaccurate'")["row"].nunique() / 1000


def of_mixture():
    """With one value in ten thousand that is ten sds off."""
    rng = np.random.default_rng(3)
    draws = rng.normal(size=(4000, 1000)) + 10.0 * (rng.random((4000, 1000)) < 1e-4)
    variance = 1.0 + 1e-2 * (1.0 - 1e-4)
    return share_called_inaccurate(draws, 1e-3, variance, 0.1 / 1.01**1.5, 4.06 / 1.01**2 - 3.0)


def test_an_exact_closure_is_seldom_called_inaccurate():
    """At most the stated 5 %, heavy tails included."""
    draws = np.random.default_rng(3).lognormal(size=(500, 1000))
    assert share_called_inaccurate(draws, *stats.lognorm(1.0).stats("mvsk")) <= 0.05
    assert of_mixture() <= 0.05


def test_without_what_is_unseen_the_rate_is_not_held(monkeypatch):
    """Negative control, by four standard errors."""
    monkeypatch.setattr(
        "rattle.compare.judge.reference._unseen", lambda moment, paths: (0.0 * paths, 0.0 * paths)
    )
    assert of_mixture() > 0.05 + 4.0 * np.sqrt(0.05 * 0.95 / 1000)


def test_correlated_groups_widen_the_intervals(predicted):
    """Paths that come in tens alike: judged as independent their error is too small by sqrt(10)."""
    walks = np.random.default_rng(5).normal(size=(1000, WALK_ROWS)).cumsum(axis=1)
    alike = {"x": np.repeat(walks, 10, axis=0)}
    claim = predicted[["x", "sd_x"]]
    of_groups = rt.judge(claim, alike, groups=np.repeat(np.arange(1000), 10)).table
    independent = rt.judge(claim, alike).table
    np.testing.assert_allclose(of_groups["se"] / independent["se"], np.sqrt(10.0), rtol=2e-3)


def test_draws_of_chains_have_the_errors_of_arviz(predicted):
    """An autoregression: its standard error is sqrt((1 + a) / (1 - a)) of an independent one's."""
    pytest.importorskip("arviz_stats")
    import xarray as xr

    chain = lfilter([0.6], [1.0, -0.8], np.random.default_rng(5).normal(size=(4, 5000, 1)), axis=1)
    data = xr.Dataset({"x": (("chain", "draw", "time"), chain)}, coords={"time": [0.1]})
    row = rt.judge(
        pd.DataFrame({"x": [0.0], "sd_x": [1.0]}, index=WALK_TIMES[:1]), data
    ).table.iloc[0]
    assert row["se"] / (1.0 / np.sqrt(20_000)) == pytest.approx(3.0, rel=0.15)


def test_a_coarser_step_shows_the_bias_and_widens_the_intervals(samples, predicted):
    """On the same noise, on another, and reduced; its rest covers orders from a half on."""
    bias = 0.02
    fine = {"x": samples[:, :, 0] + bias}
    coarse = {"x": samples[:, :, 0] + 2.0 * bias}
    claim = predicted[["x", "sd_x"]]
    same = rt.judge(claim, fine, coarser=coarse).table.query("moment == 'mean'")
    np.testing.assert_allclose(same["bias"], bias, rtol=1e-9)
    np.testing.assert_allclose(same["error"], -samples[:, :, 0].mean(axis=0), atol=1e-12)
    other = {"x": samples[:2000, :, 1] * np.sqrt(0.8) + 2.0 * bias}
    assert (
        rt.judge(claim, fine, coarser=other).table.query("moment == 'mean'")["high"] > same["high"]
    ).all()


def test_a_reference_whose_step_is_too_long_cannot_be_believed(samples, predicted):
    """A bias beyond the tolerance leaves rows undecided, and the answer says so."""
    found = rt.judge(
        predicted[["x", "sd_x"]],
        {"x": samples[:, :, 0] + 0.3},
        coarser={"x": samples[:, :, 0] + 0.6},
    )
    assert set(found.table.query("moment == 'mean'")["verdict"]) == {"undecided"}
    assert "cannot be believed" in "\n".join(found.answer)


def test_a_coarser_reduced_table_corrects_a_reduced_one(predicted):
    """Both without the paths themselves."""
    claim = predicted[["x", "sd_x"]]
    table = claim.assign(x=0.1, se_x=0.001, se_sd_x=0.001, paths=WALKS)
    found = rt.judge(claim, table, coarser=table.assign(x=0.2)).table
    means = found.query("moment == 'mean'")
    np.testing.assert_allclose(means["bias"], 0.1)
    np.testing.assert_allclose(means["error"], 0.0, atol=1e-12)


def test_other_forms_of_predictions(samples, predicted, tmp_path):
    """A dataset with units, a file with a column impact, rows without labels."""
    claim = predicted[["x", "sd_x"]]
    dataset = claim.to_xarray()
    dataset["x"].attrs["units"] = "mm"
    assert rt.judge(dataset, {"x": samples[:, :, 0]}).label == "time"
    claim.set_index(pd.Index([1, 2, 3], name="impact")).to_csv(tmp_path / "mine.csv")
    found = rt.judge(tmp_path / "mine.csv", {"x": samples[:, :, 0]})
    assert found.label == "impact"
    assert found.closures == ("mine",)
    found = rt.judge(claim.reset_index(drop=True).assign(mesh=1), samples, names=["x", "v"])
    assert found.label == "row"
    assert "Not compared, as the samples have no such quantity: `mesh`." in found.answer
    assert "Nothing is predicted of `v`." in found.answer


def test_paths_that_end_are_counted_by_row(samples, predicted):
    """Half of the paths end before the last row."""
    ended = samples.copy()
    ended[: WALKS // 2, 2] = np.nan
    found = rt.judge(predicted, ended)
    assert found.table.groupby("time")["paths"].first().tolist() == [WALKS, WALKS, WALKS // 2]
    assert "time 0.3 is reached by 2,000 of 4,000 paths." in found.answer


def test_several_closures_and_a_function(samples, predicted):
    """A mapping of names, a table with a column closure, and a function."""
    found = rt.judge({"exact": predicted, "mine": lambda: predicted.assign(x=1.0)}, samples)
    assert found.closures == ("exact", "mine")
    assert found.counts["inaccurate"]["mine"] == WALK_ROWS
    assert rt.judge(
        pd.concat([predicted.assign(closure="a"), predicted.assign(closure="b")]), samples
    ).closures == ("a", "b")


def test_result_as_dataset_page_and_text(samples, predicted, tmp_path):
    """Everything that a result offers."""
    found = rt.judge(predicted, samples, units={"x": "mm"})
    dataset = found.to_xarray()
    assert dataset["verdict"].dims == ("closure", "time", "quantity", "moment")
    assert dataset["quantity"].attrs == found.units == {"x": "mm", "v": ""}
    assert "Can the closure be believed?" in found.report(tmp_path / "page").read_text()
    assert repr(found).startswith("Judgement of x, v at 3 rows")
    assert "<table" in found._repr_html_()


def test_no_compiler_is_loaded(tmp_path):
    """On samples of one's own; shown in another process."""
    script = (
        "import sys, numpy as np, rattle as rt\n"
        "x = np.random.default_rng(1).normal(size=(100, 2, 1))\n"
        "rt.judge({'x': [0.0, 0.0], 'sd_x': [1.0, 1.0]}, x)\n"
        "assert 'numba' not in sys.modules\n"
    )
    python("-c", script, cwd=tmp_path)


def test_section_rows_of_validate_bit_for_bit():
    """The heart is one: what validate says of section moments, judge says of the run's samples."""
    run = rt.validate(dat21(0.01), impacts=3, closures=["saltation"], paths=4000)
    found = rt.judge(run.predictions["saltation"], run.run.to_samples(), checks=2 * 6 * 3 + 2 * 3)
    expected = run.table.query("kind == 'section'").drop(columns="time")
    pd.testing.assert_frame_equal(
        found.table[list(expected)], expected, check_exact=True, check_dtype=False
    )


def wrong_predictions(predicted):
    """By what the message has to name."""
    return {
        "did you mean 'x'": predicted.rename(columns={"sd_x": "sd_xx"}),
        "quantit": {"speed": [1.0, 2.0, 3.0]},
        "order": predicted[::-1],
        "samples have": predicted.set_axis(WALK_TIMES + 1.0),
        "must be 0 or greater": predicted.assign(sd_x=-1.0),
        "give a table": [1.0],
        "give real numbers": predicted.assign(x="a"),
        "is infinite": predicted.assign(x=np.inf),
        "stands twice": pd.concat([predicted, predicted]),
    }


def wrong_samples(samples, folder):
    """By what the message has to name."""
    bad = folder / "bad.parquet"
    bad.write_text("no table")
    late = samples.copy()
    late[3, 0] = np.nan
    infinite = samples.copy()
    infinite[5, 1, 1] = np.inf
    long = as_long(samples)
    x = {"x": samples[:, :, 0]}
    exact = pd.DataFrame({"x": 0.0, "se_x": 0.0}, index=WALK_TIMES)
    return {
        "real": samples.astype(complex),
        "equal": np.repeat(samples[:1], 10, axis=0),
        "is no table": bad,
        "does not exist": folder / "none.csv",
        "path 3, row 1": late,
        "path 5, row 2, v": infinite,
        "give an array": 3.0,
        "3 are predicted": samples[:, :2],
        "has 1 dimensions": samples[:, 0, 0],
        "no column 'path'": long[["x", "v"]],
        "two rows": pd.concat([long] * 2),
        "no block": iter([]),
        "unit": 1e-200 * samples,
        "same paths and rows": {**x, "v": samples[:, :2, 1]},
        "(paths, rows)": {"x": samples[:, 0, 0]},
        "other quantities": iter([long, x]),
        "must be 0 or greater": exact.assign(se_x=-0.1),
        "add the column 'sd_x'": exact,
        "se_x": exact.rename(columns={"se_x": "se_y"}),
    }


def test_columns_that_are_not_asked_for_or_empty_are_left_out(samples, predicted):
    """One of two quantities of a table; and the moments of a wheel that is not there."""
    assert set(rt.judge(predicted, as_long(samples), names=["x"]).table["quantity"]) == {"x"}
    single = dat21(0.05, stages=1)
    found = rt.judge(
        rt.mean_map(single, impacts=2),
        rt.simulate(single, paths=1000, impacts=2, rng=7).to_samples(),
    )
    assert found.quantities == ["tau", "flight", "x1", "y1"]


def test_bad_input_is_named(samples, predicted, tmp_path):
    """Field, value and remedy, case by case."""
    for part, claim in wrong_predictions(predicted).items():
        with refusal_in_words(part):
            rt.judge(claim, as_long(samples))
    for part, given in wrong_samples(samples, tmp_path).items():
        names = ["x", "v"] if isinstance(given, np.ndarray) else None
        with refusal_in_words(part):
            rt.judge(predicted[["x"]], given, names=names)
    predicted.attrs["units"] = {"x": "m"}
    with refusal("convert one of them"):
        rt.judge(predicted, samples, names=["x", "v"], units={"x": "mm"})


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("level", 1.0),
        ("groups", "family"),
        ("groups", np.zeros(WALKS)),
        ("tolerances", 0.1),
        ("coarser", np.zeros((WALKS, WALK_ROWS + 1, 2))),
    ],
)
def test_bad_options_are_named(samples, predicted, option, value):
    """Each by its name."""
    with pytest.raises(InputError) as caught:
        rt.judge(predicted, samples, **{option: value})
    assert caught.value.field.startswith(option)


def test_command_line(samples, predicted, tmp_path):
    """Files in, a page and exit codes out."""
    good, bad, paths = (tmp_path / name for name in ("good.csv", "bad.csv", "samples.parquet"))
    as_long(samples).to_parquet(paths)
    predicted.to_csv(good)
    predicted.assign(x=1.0).to_csv(bad)
    rattle("judge --require accurate", bad, paths, "--out", tmp_path / "page", code=3)
    assert (tmp_path / "page/judge.html").is_file()
    rattle("judge --mean 0.5 --sd 0.5 --rho 0.5 --require accurate --json", good, paths)


def test_of_a_mean_map_those_quantities_are_judged_that_a_simulator_has(tmp_path):
    """The speeds of a mass on a spring before its impacts, as another program would give them."""
    scene = rt.Scene.load("examples/oscillator.toml").with_sigma(0.01)
    closure = rt.mean_map(scene, impacts=2)
    run = rt.simulate(scene, paths=20_000, impacts=2, rng=5, record=rt.Record(raw=True))
    speeds = run.records[["y1"]]
    speeds.to_csv(tmp_path / "speeds.csv")
    closure.section.to_csv(tmp_path / "map.csv")
    found = rt.judge(closure, speeds).table
    assert set(found["quantity"]) == {"y1"}
    assert "inaccurate" not in set(found["verdict"])
    again = rattle(f"judge {tmp_path / 'map.csv'} {tmp_path / 'speeds.csv'} --out {tmp_path / 'r'}")
    assert "Not compared, as the samples have no such quantity: `tau`, `flight`" in again.output
    wrong = closure.section.assign(sd_y1=1.3 * closure.section["sd_y1"])
    table = rt.judge(wrong, speeds).table.query("moment == 'sd'")
    assert set(table["verdict"]) == {"inaccurate"}
