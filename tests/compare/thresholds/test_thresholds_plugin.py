"""The plugin as its users meet it: pytest on suites of tests."""

import re
from pathlib import Path

import pytest
from programs import python

OUTCOMES_SUITE = """
pytestmark = pytest.mark.rattle(scene=Scene.from_gears(DAT21, sigma=0.02), impacts=2, paths=2048)

def right(scene, impacts):
    return mean_map(scene, impacts=impacts).section

def wrong_sd(scene, impacts):
    section = right(scene, impacts)
    return section.assign(sd_y1=1.3 * section["sd_y1"])

def wrong_mean(scene, impacts):
    section = right(scene, impacts)
    return section.assign(tau=section["tau"] + 0.2 * section["sd_tau"])

def test_passes(rattle):
    table = rattle.check("saltation")
    assert len(table) == 12 and set(table["verdict"]) == {"accurate"}

@pytest.mark.rattle(moments="mean")
def test_fails(rattle):
    rattle.check("corrected")

@pytest.mark.rattle(within=1e-3, quantities="y1")
def test_undecided(rattle):
    rattle.check("saltation")

@pytest.mark.rattle(within=0.1)
@pytest.mark.parametrize("model", [right, wrong_sd, wrong_mean])
def test_planted(rattle, model):
    rattle.check(model)

def test_not_marked_by_itself():
    pass
"""


def test_three_outcomes_and_planted_errors(run, said, width):
    result = run(OUTCOMES_SUITE, "-rA")
    result.assert_outcomes(passed=3, failed=4)
    text = result.stdout.str()
    failed = re.findall(r"FAILED .*::test_(\S+)", text)
    assert {"fails", "planted[wrong_sd]", "planted[wrong_mean]"} < {*failed}
    low, high = (width(rows, 4) for rows in (4, 12))
    result.stdout.fnmatch_lines(
        [f"intervals  {low} to {high} standard errors, so that a test whose claim is true *0.01"]
    )
    assert "wrong_sd exceeds the allowed error in 2 of 12 rows" in text
    assert re.search(r"sd y1 at 1 .* \+0\.\d{4} +\+0\.\d{4} +\+0\.\d{4} +0\.1000", text)
    said(result, r"undecided  .*test_undecided \(saltation\) (after 16,384 paths:)")


def test_a_failure_leaves_a_figure(run, said):
    result = run(OUTCOMES_SUITE, "-k", "wrong_mean")
    result.assert_outcomes(failed=1, deselected=6)
    drawn = Path(said(result, r"Figure: (.*\.svg)")).read_text()
    assert drawn.startswith("<?xml")
    assert len(re.findall("impact", drawn)) >= 12  # a row for each check


def test_a_verdict_does_not_depend_on_the_tests_beside_it(run, said):
    alone = run(OUTCOMES_SUITE, "-k", "undecided")
    beside = run(OUTCOMES_SUITE, "-k", "undecided or passes or planted")
    for pattern in (r"(sd y1 at 2 .*)", r"(\d+ paths; intervals of \S+)", r"budget=(\S+)"):
        assert said(alone, pattern) == said(beside, pattern)


def test_without_a_cache_nothing_is_kept(run, pytester, said):
    result = run(OUTCOMES_SUITE, "-k", "passes or undecided", "-p", "no:cacheprovider", cache="")
    assert said(result, r"ensembles  (\d+ simulated in .*)").endswith(
        "1 from memory; they are kept only with a cache (--rattle-cache)"
    )
    assert not list(pytester.path.rglob("*.parquet"))
    assert not list(pytester.path.rglob("*.svg"))
    assert "Figure" not in result.stdout.str()


def test_nothing_is_simulated_twice(run, tmp_path, said):
    some = ("-k", "passes or undecided")
    # and the second look
    first = run(OUTCOMES_SUITE, *some, cache=tmp_path)
    assert said(first, r"ensembles  (\d+) simulated") == "2"
    from_cache = said(
        run(OUTCOMES_SUITE, *some, cache=tmp_path), r"(\d+ simulated in \S+ s, \d+ from the cache)"
    )
    assert from_cache == "0 simulated in 0.0 s, 3 from the cache"
    assert len(list(tmp_path.glob("*.parquet"))) == 2
    run(OUTCOMES_SUITE, *some, "--rattle-seed=1", cache=tmp_path)
    assert len(list(tmp_path.glob("*.parquet"))) == 4


@pytest.mark.slow
def test_workers_of_xdist_give_one_summary(run_workers):
    result = run_workers(OUTCOMES_SUITE)
    result.assert_outcomes(passed=3, failed=4)
    result.stdout.fnmatch_lines(
        ["checks * 58 rows in 6 tests*", "intervals  3.42 to 3.71 standard errors*"]
    )


BAD_MODELS = {
    "'saltations'": "closure = 'saltations': did you mean 'saltation'?",
    "3": "model = 3: give the name of a closure, package.module:function, or a function",
    "lambda s, k: right(s, k)[['tau', 'y1']]": "'y2' is missing; return it",
    "lambda s, k: right(s, k).rename(columns={'tau': 'y1'})": "columns of <lambda> = ",
    "lambda s, k: right(s, k) * float('inf')": (
        "tau of <lambda> at impact 1 = nan: is not a finite number"
    ),
    "'corrected'": "sd_tau of corrected at impact 1 = nan: is not a finite number",
}


def test_bad_models_fail_before_anything_is_simulated(run, tmp_path):
    tests = [
        f"def test_bad_{i}(rattle):\n    rattle.check({m})\n" for i, m in enumerate(BAD_MODELS)
    ]
    result = run(OUTCOMES_SUITE.split("def test_passes")[0] + "\n".join(tests), cache=tmp_path)
    result.assert_outcomes(failed=len(BAD_MODELS))
    for message in BAD_MODELS.values():
        assert message in result.stdout.str()
    assert not list(tmp_path.glob("*.parquet"))


def test_a_test_has_a_marker_and_makes_one_check(run):
    twice = "def test_twice(rattle):\n    rattle.check('saltation'), rattle.check('saltation')\n"
    result = run(OUTCOMES_SUITE.split("def test_passes")[0] + twice)
    result.stdout.fnmatch_lines(["rattle: a test makes one check; parametrize the test for more"])
    bare = run("def test_bare(rattle): rattle.check('saltation')")
    bare.assert_outcomes(errors=1)
    bare.stdout.fnmatch_lines(["rattle: the test has no marker; give it one*"])


def test_an_idle_plugin_loads_nothing(tmp_path):
    (tmp_path / "test_idle.py").write_text(
        "import sys\ndef test_idle():\n    heavy = {'numpy', 'pandas', 'scipy', 'numba',"
        " 'matplotlib', 'scene', 'closure', 'montecarlo'}\n    assert not heavy &"
        " sys.modules.keys()\n    assert 'rattle.compare.thresholds.plugin' in sys.modules\n"
    )
    words = ("-p", "rattle.compare.thresholds.plugin", "-W", "error", ".")
    said = python("-m", "pytest", *words, cwd=tmp_path).stdout
    assert "1 passed" in said, said
    assert "rattle" not in said.split("collected")[1]


LONG_RUN_SUITE = """
PAIR = Scene(alpha=0.25, epsilon=0.5, beta1=0.02, gamma1=0.0, stages=1, sigma=0.002)
pytestmark = pytest.mark.rattle(scene=PAIR, impacts=1)

def test_right(rattle):
    means = ["rate", "energy", "power", "rms_speed_above", "q95_speed_above"]
    rattle.check("saltation", quantities=means)

def test_wrong(rattle):
    rattle.check(lambda scene, names: {name: 1.0 for name in names}, quantities=["rate"])
"""


def test_checks_of_the_long_run_have_their_lines(run, tmp_path):
    lines = ["long run   6 rows in 2 tests: 5 passed, 1 failed, 0 undecided", "intervals  * stand*"]
    for line in ("1 simulated in * s, 1 from", "0 simulated in 0.0 s, 2 from"):
        result = run(LONG_RUN_SUITE, cache=tmp_path)
        result.assert_outcomes(passed=1, failed=1)
        result.stdout.fnmatch_lines([*lines, f"long runs  {line} the cache *"])


def test_a_closure_of_ones_own_is_the_same_by_its_function_its_object_and_its_module(
    run, pytester, monkeypatch
):
    monkeypatch.chdir(pytester.path)
    (pytester.path / "own_model.py").write_text(
        "from rattle import Closure, mean_map\ndef mine(scene, impacts):\n    return"
        " mean_map(scene, impacts=impacts, closure='saltation').section[['tau', 'sd_tau']]\nbetter"
        " = Closure('better', mine, predicts=('tau', 'sd_tau'))\n"
    )
    marker = (
        "@pytest.mark.rattle(scene=Scene.from_gears(DAT21, sigma=0.01), impacts=1,"
        " quantities='tau', paths=4096)\n"
    )
    models = ("own_model.mine", "own_model.better", "'own_model:mine'", "'own_model:better'")
    tests = [f"{marker}def test_{i}(rattle): rattle.check({m})\n" for i, m in enumerate(models)]
    run("import sys; sys.path.insert(0, '.')\nimport own_model\n" + "".join(tests)).assert_outcomes(
        passed=4
    )


ITINERARY_SUITE = """
def off(scene, impacts):
    return mean_map(scene, impacts=impacts).section.assign(sd_y2=lambda s: 1.3 * s["sd_y2"])

def of_all(scene, impacts):
    return mean_map(scene, impacts=impacts, closure="branching").section

pytestmark = pytest.mark.rattle(
    scene=Scene.from_gears(DAT21, sigma=0.1), kind="itinerary", quantities="y2", moments="sd"
)

@pytest.mark.rattle(impacts=[3])
@pytest.mark.parametrize("model", ["branching", off, of_all])
def test_apart(rattle, model):
    rattle.check(model)

@pytest.mark.rattle(impacts=12)
def test_another(rattle):
    rattle.check("published")

@pytest.mark.rattle(scene=Scene.from_gears(DAT21, sigma=1.0), impacts=12)
def test_few(rattle):
    rattle.check("saltation")
"""


def test_a_claim_about_the_paths_on_the_itinerary(run):
    result = run(ITINERARY_SUITE, "-rA")
    result.assert_outcomes(passed=1, failed=4)
    text = result.stdout.str()
    assert "off exceeds the allowed error in 1 of 1 rows" in text
    # a rare branch has a third of the variance
    assert "of_all exceeds the allowed error in 1 of 1 rows" in text
    assert "published follows another itinerary than the noise-free path" in text
    assert "fewer than half of the paths follow this itinerary up to here" in text
