"""judge: samples of any simulation in any form, and what is said of them."""

import numpy as np
import pandas as pd
import pytest
from commands import rattle
from programs import python
from refusals import refusal, refusal_in_words
from scenes import dat21
from scipy.signal import lfilter

import rattle as rt
from rattle import InputError

WALKS = 4000
WALK_ROWS = 3
WALK_TIMES = pd.Index([0.1, 0.2, 0.3], name="time")


@pytest.fixture(scope="module")
def samples():
    """Two correlated random walks, shape (paths, rows, 2)."""
    rng = np.random.default_rng(7)
    steps = rng.normal(size=(WALKS, WALK_ROWS, 2))
    walks = steps.cumsum(axis=1)
    walks[:, :, 1] += 0.5 * walks[:, :, 0]
    return walks


@pytest.fixture(scope="module")
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
    long.to_parquet(folder / "all.parquet")
    parts = folder / "parts"
    parts.mkdir()
    for number in range(4):
        long[long["path"] % 4 == number].to_parquet(parts / f"{number}.parquet")
    dims = ("path", "time")
    return {
        "array": samples,
        "mapping": {"x": samples[:, :, 0], "v": samples[:, :, 1]},
        "long table": long,
        "indexed table": long.set_index(["path", "time"]),
        "dataset": xr.Dataset(
            {"x": (dims, samples[:, :, 0]), "v": (dims, samples[:, :, 1])},
            coords={"time": WALK_TIMES},
        ),
        "csv": folder / "all.csv",
        "parquet": str(folder / "all.parquet"),
        "folder": parts,
        "blocks": iter(np.array_split(samples, 5)),
        "blocks of tables": (table for _, table in long.groupby(long["path"] // 1000)),
    }


def test_every_form_gives_the_same_verdicts(samples, predicted, tmp_path):
    """Form by form the same table, but for the order of summation."""
    known = None
    for name, form in forms(samples, tmp_path).items():
        found = rt.judge(predicted, form, names=["x", "v"])
        table = found.table.sort_values(["moment", "quantity", "time"]).reset_index(drop=True)
        known = table if known is None else known
        pd.testing.assert_frame_equal(table, known, rtol=1e-9, obj=name)
    assert set(known["verdict"]) <= {"accurate", "undecided"}


def test_a_reduced_table_gives_the_same_means_and_sds(samples, predicted):
    """Moments and errors alone decide as the samples do, but for the skewness of the sampling."""
    found = rt.judge(predicted.drop(columns="rho_x_v"), samples).table
    reduced = pd.DataFrame({"paths": WALKS}, index=WALK_TIMES)
    for row in found.to_dict("records"):
        name = {"mean": "", "sd": "sd_"}[row["moment"]] + row["quantity"]
        reduced.loc[row["time"], [name, f"se_{name}"]] = row["simulated"], row["se"]
    again = rt.judge(predicted.drop(columns="rho_x_v"), reduced).table
    keys = ["moment", "quantity", "time"]
    one, two = (table.sort_values(keys)[["low", "high"]] for table in (found, again))
    np.testing.assert_allclose(one, two, atol=3e-3)


def test_an_exact_reference_decides_everything(predicted):
    """Standard errors of 0: no interval, no sentence on paths; a planted error is found."""
    exact = predicted.drop(columns="rho_x_v")
    reference = exact.assign(**{f"se_{name}": 0.0 for name in exact})
    right = rt.judge(exact, reference)
    assert right.accurate
    assert right.exact
    assert "exact" in right.answer[1]
    wrong = rt.judge(exact.assign(sd_x=1.101 * exact["sd_x"]), reference)
    assert wrong.counts.loc["prediction"].tolist() == [9, 3, 0]


def test_planted_errors_are_found_where_there_are_enough_paths():
    """0.1 sd in a mean and 20 % in an sd, with the number of paths that is called enough."""
    rng = np.random.default_rng(11)
    replicas = 200  # rows that are judged as if each were alone
    draws = rng.normal(size=(30_000, replicas))
    wrong = {"x": np.full(replicas, 0.1), "sd_x": np.full(replicas, 1.2)}
    table = rt.judge(wrong, {"x": draws}, checks=2).table
    enough = table[table["enough_paths"]]
    found = enough.groupby("moment")["verdict"].agg(lambda v: (v == "inaccurate").mean())
    assert set(found.index) == {"mean", "sd"}
    assert (found >= 0.95).all()


DISTRIBUTIONS = {
    "normal": (lambda r, s: r.normal(size=s), {"x": 0.0, "sd_x": 1.0, "skew_x": 0.0}),
    "log-normal": (
        lambda r, s: r.lognormal(size=s),
        {
            "x": np.exp(0.5),
            "sd_x": np.sqrt((np.e - 1.0) * np.e),
            "skew_x": (np.e + 2.0) * np.sqrt(np.e - 1.0),
            "kurt_x": np.e**4 + 2.0 * np.e**3 + 3.0 * np.e**2 - 6.0,
        },
    ),
    "mixture": (
        lambda r, s: r.normal(size=s) + 10.0 * (r.random(s) < 1e-4),
        {
            "x": 1e-3,
            "sd_x": np.sqrt(1.0 + 1e-2 * (1.0 - 1e-4)),
            "skew_x": 0.1 / 1.01**1.5,
            "kurt_x": (3.0 + 0.06 + 1.0) / 1.01**2 - 3.0,
        },
    ),
}


def share_called_inaccurate(name, paths):
    """Of 1,000 exact closures, each judged by as many paths."""
    draw, moments = DISTRIBUTIONS[name]
    draws = draw(np.random.default_rng(3), (paths, 1000))
    claim = {column: np.full(1000, value) for column, value in moments.items()}
    table = rt.judge(claim, {"x": draws}, checks=len(moments)).table
    return table[table["verdict"] == "inaccurate"]["row"].nunique() / 1000


@pytest.mark.parametrize(
    ("name", "paths"), [("normal", 500), ("log-normal", 500), ("mixture", 4000)]
)
def test_an_exact_closure_is_seldom_called_inaccurate(name, paths):
    """At most the stated 5 %, heavy tails included."""
    assert share_called_inaccurate(name, paths) <= 0.05


def test_without_what_is_unseen_the_rate_is_not_held(monkeypatch):
    """Negative control, by four standard errors."""
    nothing = "rattle.compare.judge.reference._unseen"
    monkeypatch.setattr(nothing, lambda moment, paths: (0.0 * paths, 0.0 * paths))
    limit = 0.05 + 4.0 * np.sqrt(0.05 * 0.95 / 1000)
    assert share_called_inaccurate("mixture", 4000) > limit


def test_correlated_groups_widen_the_intervals(predicted):
    """Paths that come in tens alike: judged as independent their error is too small by sqrt(10)."""
    rng = np.random.default_rng(5)
    walks = rng.normal(size=(1000, WALK_ROWS)).cumsum(axis=1)
    alike = np.repeat(walks, 10, axis=0)
    claim = predicted[["x", "sd_x"]]
    groups = np.repeat(np.arange(1000), 10)
    of_groups = rt.judge(claim, {"x": alike}, groups=groups).table
    independent = rt.judge(claim, {"x": alike}).table
    np.testing.assert_allclose(of_groups["se"] / independent["se"], np.sqrt(10.0), rtol=2e-3)


def test_draws_of_chains_have_the_errors_of_arviz(predicted):
    """An autoregression: its standard error is sqrt((1 + a) / (1 - a)) of an independent one's."""
    pytest.importorskip("arviz_stats")
    import xarray as xr

    rng = np.random.default_rng(5)
    chain = lfilter([0.6], [1.0, -0.8], rng.normal(size=(4, 5000, 1)), axis=1)
    data = xr.Dataset({"x": (("chain", "draw", "time"), chain)}, coords={"time": [0.1]})
    claim = pd.DataFrame({"x": [0.0], "sd_x": [1.0]}, index=WALK_TIMES[:1])
    row = rt.judge(claim, data).table.iloc[0]
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
    independent = rt.judge(claim, fine, coarser=other).table.query("moment == 'mean'")
    assert (independent["high"] > same["high"]).all()


def test_a_reference_whose_step_is_too_long_cannot_be_believed(samples, predicted):
    """A bias beyond the tolerance leaves rows undecided, and the answer says so."""
    claim = predicted[["x", "sd_x"]]
    found = rt.judge(claim, {"x": samples[:, :, 0] + 0.3}, coarser={"x": samples[:, :, 0] + 0.6})
    means = found.table.query("moment == 'mean'")
    assert set(means["verdict"]) == {"undecided"}
    assert "cannot be believed" in "\n".join(found.answer)


def test_a_coarser_reduced_table_corrects_a_reduced_one(predicted):
    """Both without the paths themselves."""
    claim = predicted[["x", "sd_x"]]
    table = claim.assign(x=0.1, se_x=0.001, se_sd_x=0.001, paths=WALKS)
    found = rt.judge(claim, table, coarser=table.assign(x=0.2)).table
    means = found[found["moment"] == "mean"]
    np.testing.assert_allclose(means["bias"], 0.1)
    np.testing.assert_allclose(means["error"], 0.0, atol=1e-12)


def test_other_forms_of_predictions(samples, predicted, tmp_path):
    """A dataset with units, a file with a column impact, rows without labels."""
    dataset = predicted[["x", "sd_x"]].to_xarray()
    dataset["x"].attrs["units"] = "mm"
    assert rt.judge(dataset, {"x": samples[:, :, 0]}).label == "time"
    table = predicted[["x", "sd_x"]].reset_index(drop=True).assign(impact=[1, 2, 3])
    table.to_csv(tmp_path / "mine.csv", index=False)
    found = rt.judge(tmp_path / "mine.csv", {"x": samples[:, :, 0]})
    assert found.label == "impact"
    assert found.closures == ("mine",)
    unlabelled = predicted[["x", "sd_x"]].reset_index(drop=True).assign(mesh=1)
    found = rt.judge(unlabelled, samples, names=["x", "v"])
    assert found.label == "row"
    lines = found.answer
    assert "Not compared, as the samples have no such quantity: `mesh`." in lines
    assert "Nothing is predicted of `v`." in lines


def test_paths_that_end_are_counted_by_row(samples, predicted):
    """Half of the paths end before the last row."""
    ended = samples.copy()
    ended[: WALKS // 2, 2] = np.nan
    found = rt.judge(predicted, ended)
    paths = found.table.groupby("time")["paths"].first()
    assert paths.tolist() == [WALKS, WALKS, WALKS // 2]
    assert "time 0.3 is reached by 2,000 of 4,000 paths." in found.answer


def test_several_closures_and_a_function(samples, predicted):
    """A mapping of names, a table with a column closure, and a function."""
    given = {"exact": predicted, "mine": lambda: predicted.assign(x=1.0)}
    found = rt.judge(given, samples)
    assert found.closures == ("exact", "mine")
    assert found.counts.loc["mine", "inaccurate"] == WALK_ROWS
    together = pd.concat([predicted.assign(closure="a"), predicted.assign(closure="b")])
    assert rt.judge(together, samples).closures == ("a", "b")


def test_result_as_dataset_page_and_text(samples, predicted, tmp_path):
    """Everything that a result offers."""
    found = rt.judge(predicted, samples, units={"x": "mm"})
    dataset = found.to_xarray()
    assert dataset["verdict"].dims == ("closure", "time", "quantity", "moment")
    assert dataset["quantity"].attrs == found.units == {"x": "mm", "v": ""}
    page = found.report(tmp_path / "page")
    assert "Can the closure be believed?" in page.read_text(encoding="utf-8")
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
    scene = dat21(0.01)
    run = rt.validate(scene, impacts=3, closures=["saltation"], paths=4000, rng=7)
    found = rt.judge(run.predictions["saltation"], run.run.to_samples(), checks=2 * 6 * 3 + 2 * 3)
    expected = run.table[run.table["kind"] == "section"].reset_index(drop=True)
    columns = expected.columns.drop("time")
    pd.testing.assert_frame_equal(
        found.table[columns], expected[columns], check_exact=True, check_dtype=False
    )


def refusals(samples, predicted, tmp_path):
    """What the message has to name, and bad input: a prediction and samples."""
    bad = tmp_path / "bad.parquet"
    bad.write_text("no table")
    late = samples.copy()
    late[3, 0] = np.nan
    infinite = samples.copy()
    infinite[5, 1, 1] = np.inf
    alike = np.repeat(samples[:1], 10, axis=0)
    return [
        ("did you mean 'x'", predicted.rename(columns={"sd_x": "sd_xx"}), samples),
        ("quantit", {"speed": [1.0, 2.0, 3.0]}, samples),
        ("order", predicted[::-1], as_long(samples)),
        ("samples have", predicted.set_axis(WALK_TIMES + 1.0), as_long(samples)),
        ("3 rows", predicted[:2], samples),
        ("must be 0 or greater", predicted.assign(sd_x=-1.0), samples),
        ("real", predicted, samples.astype(complex)),
        ("equal", predicted, alike),
        ("is no table", predicted, bad),
        ("does not exist", predicted, tmp_path / "none.csv"),
        ("path 3, row 1", predicted, late),
        ("path 5, row 2, v", predicted, infinite),
        ("give an array", predicted, 3.0),
        ("give a table", [1.0], samples),
        ("give real numbers", predicted.assign(x="a"), samples),
        ("is infinite", predicted.assign(x=np.inf), samples),
        ("stands twice", pd.concat([predicted, predicted]), as_long(samples)),
        ("has 1 dimensions", predicted, samples[:, 0, 0]),
        ("no column 'path'", predicted, as_long(samples)[["x", "v"]]),
        ("two rows", predicted, pd.concat([as_long(samples)] * 2)),
        ("no block", predicted, iter([])),
        ("is no table", predicted, tmp_path),
        ("unit", predicted, 1e-200 * samples),
        ("same paths and rows", predicted, {"x": samples[:, :, 0], "v": samples[:, :2, 1]}),
        ("(paths, rows)", predicted, {"x": samples[:, 0, 0]}),
        (
            "other quantities",
            predicted,
            iter([as_long(samples), {"x": samples[:, :, 0]}]),
        ),
        (
            "must be 0 or greater",
            predicted[["x"]],
            pd.DataFrame({"x": 0.0, "se_x": -0.1}, index=WALK_TIMES),
        ),
        (
            "add the column 'sd_x'",
            predicted[["x"]],
            pd.DataFrame({"x": 0.0, "se_x": 0.1}, index=WALK_TIMES),
        ),
        ("se_x", predicted[["x"]], pd.DataFrame({"x": 0.0, "se_y": 0.1}, index=WALK_TIMES)),
    ]


def test_columns_that_are_not_asked_for_or_empty_are_left_out(samples, predicted):
    """One of two quantities of a table; and the moments of a wheel that is not there."""
    table = as_long(samples)
    assert set(rt.judge(predicted, table, names=["x"]).table["quantity"]) == {"x"}
    single = rt.Scene(alpha=1.5, epsilon=0.6, beta1=0.1, gamma1=0.1, sigma=0.05, stages=1)
    run = rt.simulate(single, paths=1000, impacts=2, rng=7)
    found = rt.judge(rt.mean_map(single, impacts=2, closure="saltation"), run.to_samples())
    assert found.quantities == ["tau", "flight", "x1", "y1"]


def test_bad_input_is_named(samples, predicted, tmp_path):
    """Field, value and remedy, case by case."""
    for part, claim, given in refusals(samples, predicted, tmp_path):
        names = ["x", "v"] if isinstance(given, np.ndarray) else None
        with refusal_in_words(part):
            rt.judge(claim, given, names=names)
    predicted = predicted.copy()
    predicted.attrs["units"] = {"x": "m"}
    with refusal("convert one of them"):
        rt.judge(predicted, samples, names=["x", "v"], units={"x": "mm"})


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("level", 1.0),
        ("checks", 0),
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
    assert (tmp_path / "page" / "judge.html").is_file()
    rattle("judge --mean 0.5 --sd 0.5 --rho 0.5 --require accurate --json", good, paths)


def test_of_a_mean_map_those_quantities_are_judged_that_a_simulator_has(tmp_path):
    """The speeds of a mass on a spring before its impacts, as another program would give them."""
    scene = rt.Scene.load("examples/oscillator.toml").with_sigma(0.01)
    closure = rt.mean_map(scene, impacts=2)
    run = rt.simulate(scene, paths=20_000, impacts=2, rng=5, record=rt.Record(raw=True))
    speeds = run.records[["y1"]]
    speeds.to_csv(tmp_path / "speeds.csv")
    closure.section.to_csv(tmp_path / "map.csv")
    found = rt.judge(closure, speeds)
    assert (found.table["quantity"] == "y1").all()
    assert not (found.table["verdict"] == "inaccurate").any()
    assert {"tau", "flight"} <= set(found.not_compared)
    assert "sd_tau" not in found.not_compared
    again = rattle(f"judge {tmp_path / 'map.csv'} {tmp_path / 'speeds.csv'} --out {tmp_path / 'r'}")
    assert "Not compared, as the samples have no such quantity: `tau`, `flight`" in again.output
    wrong = closure.section.assign(sd_y1=1.3 * closure.section["sd_y1"])
    verdicts = rt.judge(wrong, speeds).table.query("moment == 'sd'")["verdict"]
    assert (verdicts == "inaccurate").all()
