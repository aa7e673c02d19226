"""The fixture `judge` of pytest: samples of one's own pass, fail or stay undecided."""

import numpy as np
import pytest

RIGHT = {"x": [0.0, 0.0], "sd_x": [1.0, 1.0]}


def draw(paths):
    """Independent normals, (paths, 2 rows)."""
    return {"x": np.random.default_rng(3).normal(size=(paths, 2))}


def test_what_is_wrong_fails_and_is_shown(judge):
    with pytest.raises(pytest.fail.Exception) as failure:
        judge(RIGHT | {"x": [0.0, 0.3]}, draw(40_000))
    assert "1 of 4 moments are inaccurate" in str(failure.value)
    assert "mean x at 2" in str(failure.value)


def test_what_is_undecided_fails_and_says_what_to_do(judge):
    with pytest.raises(pytest.fail.Exception, match="Undecided is not passed: give more paths"):
        judge(RIGHT, draw(500))


@pytest.mark.rattle(undecided="skip")
def test_what_is_undecided_is_skipped_where_the_marker_says_so(judge):
    with pytest.raises(pytest.skip.Exception, match="4 of 4 moments are undecided"):
        judge(RIGHT, draw(500))


@pytest.mark.rattle(within=0.5)
def test_the_marker_says_what_is_allowed(judge):
    assert judge(RIGHT | {"x": [0.3, 0.3]}, draw(4000)).accurate


@pytest.mark.rattle(scene="dat21.toml")
def test_options_of_a_scene_have_no_place_here(judge):
    with pytest.raises(pytest.fail.Exception, match="'within', 'undecided'"):
        judge(RIGHT, draw(500))


def test_bad_input_fails_with_its_message(judge):
    with pytest.raises(pytest.fail.Exception, match="one path has no spread"):
        judge(RIGHT, draw(1))
    with pytest.raises(pytest.fail.Exception, match="nothing was judged"):
        judge({"x": [np.nan, np.nan]}, draw(100))


def test_the_summary_counts_what_was_judged(pytester):
    pytester.makepyfile(
        """
        import numpy as np

        def test_mine(judge):
            x = np.random.default_rng(3).normal(size=(40_000, 1))
            judge({"x": [0.0], "sd_x": [1.0]}, {"x": x})
        """
    )
    result = pytester.runpytest_inprocess("-p", "no:cacheprovider")
    result.assert_outcomes(passed=1)
    result.stdout.fnmatch_lines(["judged *2 moments in 1 comparison with samples: 2 passed*"])
