"""A sweep over sigma: its grid, its rows, its figure, and the sentence about them."""

import pandas as pd
import pytest
from scenes import dat21

from rattle import validate
from rattle.compare.judge.verdict import NOT_WRONG, WRONG
from rattle.compare.report.style import caption_of
from rattle.compare.validation.answer import validity_sentence
from rattle.compare.validation.comparison import Validity, find_validities
from rattle.compare.validation.figures import validity_figure
from rattle.compare.validation.page import CAPTIONS
from rattle.compare.validation.tables import merge_sigmas
from rattle.compare.validation.validate import sweep

SWEEP_SETTINGS = {
    "impacts": 4,
    "paths": 20_000,
    "rng": 3,
    "workers": 2,
    "closures": ["corrected", "saltation"],
}


@pytest.fixture(scope="module")
def swept():
    return sweep(dat21(), (0.02, 0.5), **SWEEP_SETTINGS)


def ended(sigma, accurate, not_inaccurate, cause="off itinerary", closure="saltation", why="so"):
    return Validity(closure, sigma, accurate, not_inaccurate, cause, why, 4, 100, 1e-3)


def test_rows_are_those_of_single_validations(swept):
    assert list(swept.validity) == list(Validity._fields)
    alone = [validate(dat21(sigma), **SWEEP_SETTINGS) for sigma in (0.02, 0.5)]
    pd.testing.assert_frame_equal(swept.validity, find_validities(alone), check_like=True)


def test_only_the_work_of_what_is_accurate_is_counted(swept):
    (row,) = swept.speed.itertuples()
    assert (row.closure, row.sigma, row.impacts) == ("saltation", 0.02, 4)
    assert 0.0 < row.median < row.worst < 0.1
    assert row.closure_seconds == pytest.approx(4 * 250e-6)
    assert row.speed_up == pytest.approx(row.simulation_seconds / row.closure_seconds)
    assert row.speed_up > 5.0


def test_neighbours_with_one_range_of_validity_and_cause_share_a_row():
    rows = merge_sigmas(
        pd.DataFrame(
            [ended(0.01, 4, 4, "holds"), ended(0.1, 1, 2, why="a"), ended(0.2, 1, 2, why="b")]
        )
    )
    assert rows["sigma"].tolist() == ["0.01", "0.1 – 0.2"]
    assert rows["why"].tolist() == ["so", "paths have left its itinerary"]


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([(0.01, 2, 4), (0.1, 4, 4)], "not shown wrong up to σ = 0.1 (too few paths to decide)."),
        ([(0.01, 4, 4), (0.1, 0, 2)], "accurate up to σ = 0.01, shown wrong at 0.1."),
        (
            [(0.01, 4, 4), (0.1, 0, 2), (0.2, 4, 4)],
            "accurate up to σ = 0.01, shown wrong at 0.1, and accurate at 0.2 (not one interval).",
        ),
        (
            [(0.01, 2, 4), (0.1, 0, 2)],
            "not shown wrong up to σ = 0.01 (too few paths to decide), shown wrong at",
        ),
        # the last one is luck
        (
            [(0.01, 4, 4), (0.1, 4, 4), (0.2, 3, 4), (0.4, 4, 4)],
            "accurate up to σ = 0.1, not shown wrong up to 0.4 (too few paths to decide).",
        ),
        ([(0.01, 0, 0), (0.1, 0, 0)], "shown wrong at σ = 0.01, the smallest."),
        (
            [(0.01, 4, 4), (0.1, 2, 2, "ended")],
            "accurate up to σ = 0.01, not followed to its end at 0.1.",
        ),
    ],
)
def test_undecided_is_neither_right_nor_wrong(rows, said):
    sentence = validity_sentence(pd.DataFrame([ended(*row) for row in rows]), 4)
    assert said in sentence
    assert "at no" not in sentence


def test_legend_and_caption_of_the_range_of_validity_name_what_is_there():
    """Where a closure is accurate everywhere, nothing is undecided and nothing shown wrong."""
    holds = [ended(s, 4, 4, closure=c) for c in ("corrected", "saltation") for s in (0.01, 0.1)]
    for rows, ends in ((holds, False), ([*holds, ended(0.2, 1, 2)], True)):
        figure = validity_figure(pd.DataFrame(rows), 4)
        assert sum(ax.get_visible() for ax in figure.axes) == 2
        words = [text.get_text() for text in figure.legends[0].get_texts()]
        said = caption_of(figure, CAPTIONS["validity"].items())
        assert (f"{NOT_WRONG} here" in words) == (WRONG in words) == ends
        assert ("to decide" in said) == ("A marker" in said) == ends
