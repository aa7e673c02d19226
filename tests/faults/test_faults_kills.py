"""A kill in each phase of `kills`, and two where cells are written; a hundred are run by hand."""

from kills import LIFE, QUICK, campaign


def test_a_study_that_is_killed_at_any_moment_loses_nothing(tmp_path):
    assert set(campaign(tmp_path, len(LIFE), seed=1, command=QUICK)) == set(LIFE)
