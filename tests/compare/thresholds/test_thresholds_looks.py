"""An undecided test is given more paths, up to its budget; what that leaves undecided does not pass unless allowed."""

import math

import pandas as pd
import pytest

from rattle.compare.thresholds.claim import PROFILES, Settings
from rattle.compare.thresholds.decision import choose_next, merge_looks
from rattle.compare.validation.verdict import widest

HEAD = """
import pytest
from rattle.closure import mean_map
from rattle.scene import DAT21, Scene
"""
SUITE = (
    HEAD
    + """
@pytest.mark.rattle(scene=Scene.from_gears(DAT21, sigma=0.02), impacts=2, quantities="y1", within=5e-3, paths=2048)
def test_close(rattle):
    rattle.check("saltation")
"""
)
HOPELESS = SUITE.replace("5e-3", "1e-3")
ROWS = 4


def test_a_gate_that_decides_nothing_fails_unless_that_is_allowed(run):
    """The negative control: all that the session claims is undecided."""
    result = run(HOPELESS)
    result.assert_outcomes(failed=1)
    assert result.ret == pytest.ExitCode.TESTS_FAILED
    result.stdout.fnmatch_lines(
        [
            "rattle: saltation is undecided in * of 4 rows; * paths would decide",
            "16384 paths; intervals of *",
            "Undecided is not passed: give it more paths (budget=* in its marker, or --rattle-budget), or *",
            "checks     4 rows in 1 test: * passed, 0 failed, * undecided",
        ]
    )
    allowed = HOPELESS.replace("within=", "undecided='skip', within=")
    for suite, options in ((HOPELESS, ["--rattle-undecided=skip"]), (allowed, [])):
        result = run(suite, *options)
        result.assert_outcomes(skipped=1)
        assert result.ret == pytest.ExitCode.OK
    refused = run(HOPELESS.replace("within=", "undecided='fail', within="), "--rattle-undecided=skip")
    assert refused.ret == pytest.ExitCode.TESTS_FAILED


def test_more_paths_decide(run, said):
    once = run(SUITE, "--rattle-budget=2048")
    once.assert_outcomes(failed=1)
    assert said(once, r"intervals of (\S+) standard") == f"{widest(ROWS, 0.01):.2f}"
    more = run(SUITE)
    more.assert_outcomes(passed=1)
    assert said(more, r"intervals  (\S+) standard") == f"{widest(4 * ROWS, 0.01):.2f}"


def test_a_look_that_cannot_decide_is_left_out(run, said, tmp_path):
    result = run(HOPELESS, cache=tmp_path)
    assert said(result, r"ensembles  (\d+) simulated") == "2"  # 2048 and 16384
    assert said(run(HOPELESS, cache=tmp_path), r"(\d+ simulated in \S+ s, \d+)") == "0 simulated in 0.0 s, 2"


def test_the_budget_that_the_message_asks_for_decides(run, said):
    suite = SUITE.replace("paths=2048", "paths=2048, budget=2048")
    budget = said(run(suite), r"give it more paths \(budget=(\S+) in its marker")
    assert int(budget) > 2048
    run(suite.replace("budget=2048", f"budget={budget}")).assert_outcomes(passed=1)


def test_a_failure_takes_no_further_look(run, said, tmp_path):
    model = "def wrong(scene, impacts):\n    s = mean_map(scene, impacts=impacts).section\n"
    model += "    return s.assign(sd_y1=1.3 * s['sd_y1'])\n"
    result = run(HOPELESS.replace(HEAD, HEAD + model).replace("'saltation'", "wrong").replace('"saltation"', "wrong"),
                 cache=tmp_path)  # fmt: skip
    result.assert_outcomes(failed=1)
    assert said(result, r"ensembles  (\d+) simulated") == "1"
    result.stdout.fnmatch_lines(["rattle: wrong exceeds the allowed error in 2 of 4 rows, 2 undecided", "2048 paths;*"])


def test_an_accuracy_is_looked_at_once(run, said):
    result = run(HOPELESS.replace("paths=2048", "accuracy=0.01"))
    result.assert_outcomes(failed=1)
    assert said(result, r"intervals of (\S+) standard") == f"{widest(ROWS, 0.01):.2f}"
    result.stdout.fnmatch_lines(
        ["Undecided is not passed: ask for a smaller accuracy than 0.01, or allow a larger error*"]
    )


def test_the_looks_of_a_claim_are_fixed_beforehand():
    assert Settings().sizes(None, None) == tuple(PROFILES["quick"] * 2**j for j in range(4))
    assert Settings(profile="full").sizes(None, None)[-1] == 2**23
    assert Settings(budget=100_000).sizes(None, None) == (32_768, 65_536, 100_000)
    assert Settings(budget=100_000).sizes(None, 40_000) == (32_768, 40_000)
    assert Settings(budget=1000).sizes(None, None) == (32_768,)


def rows(outcomes, needed):
    return pd.DataFrame({"outcome": outcomes, "paths_needed": needed, "look": 1})


def test_the_next_look_is_the_first_that_should_decide():
    nothing = math.nan
    assert choose_next([2, 4, 8], rows(["undecided", "undecided"], [2.5, nothing])) == 4
    assert choose_next([2, 4, 8], rows(["undecided"], [1e9])) == 8
    assert choose_next([2, 4, 8], rows(["undecided"], [nothing])) is None
    assert choose_next([2, 4, 8], rows(["pass", "pass"], [nothing, nothing])) is None
    assert choose_next([2, 4, 8], rows(["fail", "undecided"], [nothing, 3.0])) is None
    assert choose_next([], rows(["undecided"], [3.0])) is None


def test_what_was_decided_stands():
    first = rows(["pass", "undecided", "undecided"], math.nan)
    second = rows(["undecided", "fail", "undecided"], math.nan).assign(look=2)
    both = merge_looks(first, second)
    assert both["outcome"].tolist() == ["pass", "fail", "undecided"]
    assert both["look"].tolist() == [1, 2, 2]
