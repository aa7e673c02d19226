"""The plugin as its users meet it: pytest on suites of tests."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from compare.moments import widest
from compare.thresholds import sessions

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent

SUITE = """
import pytest
from closure import mean_map
from scene import DAT21, Scene

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
    assert len(table) == 12 and set(table["outcome"]) == {"pass"}

@pytest.mark.rattle(moments="mean")
def test_fails(rattle):
    rattle.check("mended")

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
ROWS = 12 + 6 + 4 + 3 * 12


@pytest.fixture(scope="module")
def ensembles(tmp_path_factory):
    return tmp_path_factory.mktemp("ensembles")


@pytest.fixture
def run(pytester, ensembles):
    """Pytest on a suite, with ensembles that the tests of this file share."""

    def running(suite, *options, cache=ensembles):
        pytester.makepyfile(test_suite=suite)
        return pytester.runpytest_inprocess("-p", "compare.thresholds.plugin", f"--rattle-cache={cache}", *options)

    return running


def said(result, pattern):
    found = re.search(pattern, result.stdout.str())
    assert found, result.stdout.str()
    return found.group(1)


def test_three_outcomes_and_planted_errors(run):
    result = run(SUITE, "-rA")
    result.assert_outcomes(passed=3, failed=3, skipped=1)
    text = result.stdout.str()
    assert re.search(r"FAILED .*::test_fails", text)
    assert re.search(r"FAILED .*::test_planted\[wrong_sd\]", text)
    assert re.search(r"FAILED .*::test_planted\[wrong_mean\]", text)
    z = f"{widest(ROWS, 0.01):.2f}"
    result.stdout.fnmatch_lines(
        [f"intervals *{z} standard errors, for a false-alarm rate of 0.01 over the {ROWS} rows*"]
    )
    assert "wrong_sd is outside what is allowed in 2 of 12 rows" in text
    assert re.search(r"sd y1 at 1 .* \+0\.\d{4} +\+0\.\d{4} +\+0\.\d{4} +0\.1000", text)
    assert (
        float(said(result, r"undecided  .*test_undecided \(saltation\): (\S+) paths would decide").replace(",", ""))
        > 2048
    )


def test_a_failure_leaves_a_figure(run):
    result = run(SUITE, "-k", "wrong_mean")
    result.assert_outcomes(failed=1, deselected=6)
    drawn = Path(said(result, r"Figure: (.*\.svg)")).read_text()
    assert drawn.startswith("<?xml")
    assert len(re.findall("impact", drawn)) >= 12  # a row for each check
    result.stdout.fnmatch_lines(["*over the 12 rows that were collected"])  # of the selected tests


def test_undecided_may_fail(run):
    run(SUITE, "--rattle-undecided=fail", "-k", "undecided").assert_outcomes(failed=1, deselected=6)


def test_the_number_of_paths_that_would_decide_does(run):
    suite = SUITE.replace("within=1e-3", "within=5e-3")
    needed = said(run(suite, "-k", "undecided"), r"(\S+) paths would decide")
    paths = 1.5 * float(needed.replace(",", ""))  # the error moves as well
    more = run(suite.replace("within=5e-3", f"paths={paths:.0f}, within=5e-3"), "-k", "undecided")
    more.assert_outcomes(passed=1, deselected=6)


def test_nothing_is_simulated_twice(run, tmp_path):
    some = ("-k", "passes or undecided")
    first = run(SUITE, *some, cache=tmp_path)
    assert said(first, r"ensembles  (\d+ simulated)") == "1 simulated"
    kept = {p: p.stat().st_mtime_ns for p in tmp_path.glob("*.parquet")}
    second = run(SUITE, *some, cache=tmp_path)
    assert said(second, r"(\d+ simulated in \S+ s, \d+ from the cache)") == "0 simulated in 0.0 s, 2 from the cache"
    assert {p: p.stat().st_mtime_ns for p in tmp_path.glob("*.parquet")} == kept
    assert len(kept) == 1
    run(SUITE, *some, "--rattle-seed=1", cache=tmp_path)
    assert len(list(tmp_path.glob("*.parquet"))) == 2


def test_profiles_and_settings_of_the_configuration_file(run, pytester):
    suite = SUITE.replace(", paths=2048", "").replace("impacts=2", "impacts=1")
    pytester.makeini("[pytest]\nrattle_false_alarm = 0.05\nrattle_undecided = fail\n")
    result = run(suite, "-k", "fails", "--rattle-workers=2")
    result.stdout.fnmatch_lines(["*32768 paths*", "*false-alarm rate of 0.05*"])
    assert sessions.PROFILES["full"] == 2**20
    run(SUITE, "-k", "undecided").assert_outcomes(failed=1, deselected=6)


def test_workers_of_xdist_count_the_same_rows(pytester, ensembles):
    pytester.makepyfile(test_suite=SUITE)
    result = pytester.runpytest_subprocess(
        "-p", "compare.thresholds.plugin", "-p", "xdist", "-n2", f"--rattle-cache={ensembles}"
    )
    result.assert_outcomes(passed=3, failed=3, skipped=1)
    result.stdout.fnmatch_lines(["checks * 58 rows in 6 tests*", f"*over the {ROWS} rows that were collected"])


def test_the_example_suite_holds(pytester, ensembles):
    shutil.copytree(HERE / "example_suite", pytester.path / "gate")
    result = pytester.runpytest_inprocess(
        "-p", "compare.thresholds.plugin", f"--rattle-cache={ensembles}", "--import-mode=importlib", "gate"
    )
    result.assert_outcomes(passed=5)
    result.stdout.fnmatch_lines(["checks * 70 rows in 4 tests: 70 passed, 0 failed, 0 undecided", "*1 as recorded*"])


def test_the_readme_shows_what_is_printed(pytester):
    section = (ROOT / "README.md").read_text().split("## Accuracy thresholds in pytest")[1]
    code, printed = re.search(r"```python\n(.*?)```.*?```\n(.*?)```", section, re.DOTALL).groups()
    pytester.makepyfile(test_gate=code)
    shutil.copy(HERE / "example_suite" / "dat21.toml", pytester.path)
    shown = pytester.runpytest_inprocess("-p", "compare.thresholds.plugin", "-q").stdout.str().splitlines()
    steady = [line for line in printed.splitlines() if not re.search(r"in \d+\.\d+ s|in \d+\.\d+s", line)]
    assert len(steady) >= 10
    assert [line for line in steady if line not in shown] == []


BAD_MARKERS = {
    "scene='nowhere.toml'": "scene = 'nowhere.toml': there is no file",
    "": "scene = None: give a Scene",
    "scene=S, quantities=['y1', 'speed']": "quantities = 'speed': valid are 'tau'",
    "scene=S, moments='skew'": "moments = 'skew': valid are 'mean', 'sd'",
    "scene=S, impact=3": "option of the marker rattle = 'impact': unknown key; did you mean 'impacts'?",
    "scene=S, impacts=[0, 1]": "impacts = 0: must be at least 1",
    "scene=S, within=-0.1": "within of the mean = -0.1: must be greater than 0",
    "scene=S, within={'mean': 0.1}": "within = {'mean': 0.1}: allow 'sd' an error too",
    "scene=S, within=0.1, absolute=0.1": "absolute = 0.1: within allows the mean an error already",
    "scene=S, paths=100, accuracy=0.1": "accuracy = 0.1: chooses the number of paths itself",
    "scene=S, scheme='euler'": "scheme = 'euler': valid are 'euler-maruyama', ",
    "'dat21.toml'": "marker rattle = ('dat21.toml',): name every option",
}


def test_bad_markers_end_the_session_before_anything_runs(run, tmp_path):
    tests = [f"@pytest.mark.rattle({m})\ndef test_{i}(rattle): pass\n" for i, m in enumerate(BAD_MARKERS)]
    tests.append("@pytest.mark.rattle(scene=S)\ndef test_idle(): pass\n")
    head = "import pytest\nfrom scene import DAT21, Scene\nS = Scene.from_gears(DAT21, sigma=0.02)\n"
    result = run(head + "\n".join(tests), cache=tmp_path / "none")
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    for i, message in enumerate([*BAD_MARKERS.values(), "its marker checks nothing"]):
        assert f"::test_{'idle' if i == len(BAD_MARKERS) else i}: {message}" in result.stderr.str()
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("--rattle-false-alarm=2", "rattle-false-alarm = 2.0: must lie between 0 and 1"),
        ("--rattle-false-alarm=few", "rattle-false-alarm = 'few': give a number"),
        ("--rattle-seed=-1", "rattle-seed = -1: must be at least 0"),
        ("--rattle-workers=1.5", "rattle-workers = '1.5': give a whole number"),
    ],
)
def test_bad_options_end_the_session(run, option, message):
    result = run(SUITE, option)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    assert message in result.stderr.str()


BAD_MODELS = {
    "'saltations'": "reading = 'saltations': did you mean 'saltation'?",
    "3": "model = 3: give a reading's name, or a function",
    "lambda s, k: 3": "result of <lambda> = 'int': return a DataFrame",
    "lambda s, k: right(s, k)[['tau', 'y1']]": "'y2' is missing; add it",
    "lambda s, k: right(s, k).rename(columns={'tau': 'y1'})": "columns of <lambda> = ",
    "lambda s, k: right(s, k).iloc[:1]": "index of <lambda> = [1]: must hold each impact once, from 1 to 2",
    "lambda s, k: right(s, k).assign(tau='soon')": "column 'tau' of <lambda> = ['soon', 'soon']: must hold numbers",
    "lambda s, k: right(s, k) * float('inf')": "tau of <lambda> at impact 1 = inf: is no prediction",
    "'mended'": "sd_tau of mended at impact 1 = nan: is no prediction",
}


def test_bad_models_fail_before_anything_is_simulated(run, tmp_path):
    tests = [f"def test_bad_{i}(rattle):\n    rattle.check({m})\n" for i, m in enumerate(BAD_MODELS)]
    tests.append("def test_bad_twice(rattle):\n    rattle.check('saltation'), rattle.check('saltation')\n")
    result = run(SUITE.split("def test_passes")[0] + "\n".join(tests), "-k", "not twice", cache=tmp_path)
    result.assert_outcomes(failed=len(BAD_MODELS), deselected=1)
    for message in BAD_MODELS.values():
        assert message in result.stdout.str()
    assert not list(tmp_path.glob("*.parquet"))
    twice = run(SUITE.split("def test_passes")[0] + tests[-1])
    twice.stdout.fnmatch_lines(["rattle: a test makes one check; parametrize the test for more"])


def test_the_fixture_without_a_marker_says_what_to_do(run):
    result = run("def test_bare(rattle): rattle.check('saltation')")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["rattle: the test claims nothing; mark it*"])


def test_an_idle_plugin_loads_nothing(tmp_path):
    (tmp_path / "test_idle.py").write_text(
        "import sys\ndef test_idle():\n"
        "    heavy = {'numpy', 'pandas', 'scipy', 'numba', 'matplotlib', 'scene', 'closure', 'montecarlo'}\n"
        "    assert not heavy & sys.modules.keys()\n"
        "    assert 'compare.thresholds.plugin' in sys.modules\n"
    )
    out = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "compare.thresholds.plugin", "-W", "error", "."],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "1 passed" in out.stdout, out.stdout
    assert "rattle" not in out.stdout.split("collected")[1].replace("test_idle", "")


def test_naming_the_plugin_twice_registers_it_once(tmp_path, monkeypatch):
    """By its module and by its entry point, which is made here in case the project has not been installed."""
    monkeypatch.delenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD")
    info = tmp_path / "rattle_entry-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: rattle-entry\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[pytest11]\nrattle = compare.thresholds\n")
    (tmp_path / "test_nothing.py").write_text("def test_nothing(): pass\n")
    for options in ([], ["-p", "compare.thresholds.plugin"], ["-p", "rattle"]):
        out = subprocess.run(
            [sys.executable, "-m", "pytest", "-W", "error", "--markers", *options], cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}, capture_output=True, text=True,
            check=False,
        )  # fmt: skip
        assert out.stdout.count("@pytest.mark.rattle(") == 1, (options, out.stdout[-500:], out.stderr)
